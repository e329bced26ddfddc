"""What the planner node saves of plans that fail, and that it can be repeated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from suite import PATIENCE, gap_scene, point_request, running_suite

from bsp_informed_planner.errors import PlanningCancelledError, PlanningTimeoutError, SamplesExhaustedError
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.failure_records import MOST_FILES, FailureRecords
from bsp_informed_planner.nodes.world import World
from bsp_informed_planner.planning import JointGoal, Planner, PlanningProblem, PlanOptions
from bsp_informed_planner.planning.problem_file import load_recorded_problem
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.robots.reference import load_reference
from bsp_informed_planner.scene.scene import AttachedObstacle, Obstacle
from bsp_informed_planner.scene.shapes import Sphere


def test_a_failing_plan_is_saved_and_repeated(tmp_path: Path) -> None:
    folder = tmp_path / "failures"
    with running_suite("point") as suite:
        suite.add_all(save_problem_on_failure=str(folder))
        client = suite.client()
        client.wait_for_nodes(PATIENCE)
        client.publish_scene(gap_scene(0.5), PATIENCE)
        suite.settle(client)
        assert client.plan(point_request(), PATIENCE).error_code == ErrorCode.SUCCESS
        assert not folder.exists()
        # Nothing passes a wall without a gap.
        revision = client.publish_scene(gap_scene(0.5, gap=-0.1), PATIENCE)
        suite.settle(client)
        response = client.plan(point_request(allowed_planning_time=0.3, seed=0, scene_revision=revision), PATIENCE)
        assert response.error_code == ErrorCode.TIMED_OUT
        assert client.plan(point_request((0.5, 0.2)), PATIENCE).error_code == ErrorCode.GOAL_IN_COLLISION
    saved = {recorded.error_kind: recorded for recorded in map(load_recorded_problem, folder.iterdir())}
    assert set(saved) == {"StateInCollisionError", "PlanningTimeoutError"}
    recorded = saved["PlanningTimeoutError"]
    assert recorded.options.seed is not None  # the one that was drawn
    assert recorded.options.allowed_seconds == 0.3
    assert recorded.scene.revision == revision
    with pytest.raises(PlanningTimeoutError):
        Planner(load_reference(recorded.robot), recorded.scene).plan(recorded.problem, recorded.options)


def test_what_the_robot_held_is_saved(tmp_path: Path) -> None:
    body = AttachedObstacle(Obstacle.of("disc", Sphere(0.1)), "point")
    scene = replace(gap_scene(0.5), attached={"disc": body}, allowed_collisions=frozenset({frozenset(("a", "disc"))}))
    world = World(Planner(PointRobot(), scene), epoch=1)
    problem = PlanningProblem(np.array([0.2, 0.5]), [JointGoal(np.array([0.8, 0.5]))])
    path = FailureRecords(str(tmp_path)).save(PlanningTimeoutError(1.0, 5), world, problem, PlanOptions(), 1)
    assert path is not None
    recorded = load_recorded_problem(path)
    assert recorded.scene.attached["disc"].link == "point"
    assert recorded.scene.allowed_collisions == scene.allowed_collisions
    options = PlanOptions(max_samples=200, allowed_seconds=5.0)
    with pytest.raises(SamplesExhaustedError):
        Planner(load_reference(recorded.robot), recorded.scene).plan(recorded.problem, options)


def test_what_is_not_saved(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    robot, scene = PointRobot(), gap_scene(0.5)
    world = World(Planner(robot, scene), epoch=1)
    problem, options = PlanningProblem(np.zeros(2), [JointGoal(np.ones(2))]), PlanOptions()
    error = PlanningTimeoutError(1.0, 5)
    records = FailureRecords(str(tmp_path))
    assert records.save(PlanningCancelledError(), world, problem, options, 1) is None
    assert records.save(error, None, problem, options, 1) is None
    assert records.save(error, world, None, None, None) is None
    assert FailureRecords("").save(error, world, problem, options, 1) is None
    path = records.save(error, world, problem, options, 8)
    assert path is not None
    assert load_recorded_problem(path).options.seed == 8
    saved = [records.save(error, world, problem, options, None) for _ in range(MOST_FILES)]
    assert saved[-1] is None
    assert len(list(tmp_path.iterdir())) == MOST_FILES
    # A folder that cannot be made costs no answer.
    (tmp_path / "file").write_text("")
    assert FailureRecords(str(tmp_path / "file")).save(error, world, problem, options, 1) is None
    assert "could not be written" in caplog.text
