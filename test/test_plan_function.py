"""Plans through the nodes, as the viewer asks for them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from suite import PATIENCE, SOON, Suite, gap_scene, running_suite

from bsp_informed_planner.errors import PlanningCancelledError, PlanningFailedError, SceneUnavailableError
from bsp_informed_planner.nodes.client import SuiteUnavailableError
from bsp_informed_planner.nodes.plan_function import plan_request, plan_through
from bsp_informed_planner.nodes.planner_node import PlannerNode
from bsp_informed_planner.planning.problem import JointGoal, PlanOptions, PoseGoal
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.visualization.viewer.plan_answer import PlanQuestion

START, GOAL = np.array([0.1, 0.5]), np.array([0.9, 0.5])


def question(**options: object) -> PlanQuestion:
    settings = {"allowed_seconds": PATIENCE, "first_solution": True, "seed": 1, **options}
    return PlanQuestion(START, (JointGoal(GOAL),), PlanOptions(**settings))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def point() -> Iterator[Suite]:
    with running_suite("point") as suite:
        yield suite.add_all()


def test_the_nodes_answer(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    with pytest.raises(SceneUnavailableError):
        client.wait_for_scene(0.2)
    revision = client.publish_scene(gap_scene(0.8), PATIENCE)
    scene = client.wait_for_scene(PATIENCE)
    assert scene.revision == revision
    assert len(scene.obstacles) == 2
    plan = plan_through(client, PointRobot(), revision)
    answer = plan(question(planner_id="rrt_star"), lambda: False)
    np.testing.assert_allclose(answer.path[[0, -1]], [START, GOAL])
    np.testing.assert_allclose(answer.positions[[0, -1]], [START, GOAL])
    assert (np.diff(answer.times) > 0.0).all()
    assert len(answer.costs) == len(answer.cost_seconds) >= 1
    assert len(answer.keypoints) >= 1
    assert answer.cost > 0.8
    # A plan that nobody wants any more is over in the node, too.
    with pytest.raises(PlanningCancelledError):
        plan(question(first_solution=False, allowed_seconds=60.0), lambda: True)
    node = next(node for node in point.nodes if isinstance(node, PlannerNode))
    assert client.spin_until(lambda: node.diagnostic_values()["plans_in_flight"] == 0, PATIENCE)
    # So is one whose answer has not come in time: a client that waits for minus a minute and a second beyond a minute.
    request = plan_request(question(first_solution=False, allowed_seconds=60.0), PointRobot(), revision)
    with pytest.raises(SuiteUnavailableError):
        client.plan_motion(request, -59.0, lambda: False)
    assert client.spin_until(lambda: node.diagnostic_values()["plans_in_flight"] == 0, SOON)
    # One on a scene that is not in force any more.
    client.publish_scene(gap_scene(0.2), PATIENCE)
    point.settle(client)
    with pytest.raises(PlanningFailedError, match=str(revision)):
        plan(question(), lambda: False)


def test_a_question_becomes_a_request() -> None:
    pose = Pose.from_xyz_rpy([0.2, 0.3, 0.0])
    options = PlanOptions(padding=0.01, max_samples=100, velocity_scaling=0.5)
    asked = PlanQuestion(START, (JointGoal(GOAL), PoseGoal(pose)), options)
    request = plan_request(asked, PointRobot(), 7)
    assert list(request.start.position) == START.tolist()
    assert [list(goal.position) for goal in request.goal_states] == [GOAL.tolist()]
    assert request.goal_poses[0].pose.position.x == 0.2
    assert request.goal_poses[0].header.frame_id == PointRobot().root_frame
    assert (request.padding, request.max_samples, request.max_velocity_scaling_factor) == (0.01, 100, 0.5)
    assert (request.scene_revision, request.seed, request.planner_id) == (7, 0, "anytime")
