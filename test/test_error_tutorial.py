"""The table of docs/tutorials/errors.md: each request is made, each answer compared."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from bsp_informed_planner_msgs.msg import PlanRequest
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState
from suite import running_suite

from bsp_informed_planner.nodes.client import SuiteClient
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box

PAGE = Path(__file__).parent.parent / "docs" / "tutorials" / "errors.md"
ROWS = re.findall(r"^\| (.+?) \| (-\d+) `(.+)` \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)

START, INSIDE = (0.9, -1.2, 1.2, -1.57, -1.57, 0.0), (0.0, -0.6, 1.0, -1.57, -1.57, 0.0)


def starting(position: tuple[float, ...], names: tuple[str, ...] = ()) -> Callable[[PlanRequest], None]:
    def change(request: PlanRequest) -> None:
        request.start = JointState(name=names, position=position)

    return change


def aiming(*goals: JointState, pose: tuple[float, float, float] | None = None) -> Callable[[PlanRequest], None]:
    def change(request: PlanRequest) -> None:
        request.goal_states = list(goals)
        if pose is not None:
            goal = PoseStamped()
            goal.header.frame_id = "world"
            goal.pose.position.x, goal.pose.position.y, goal.pose.position.z = pose
            goal.pose.orientation.x = 1.0
            request.goal_poses = [goal]

    return change


def setting(name: str, value: object) -> Callable[[PlanRequest], None]:
    return lambda request: setattr(request, name, value)


#: What was asked, as the page has it: what of a good request is changed.
ASKED = {
    "no start, and nobody publishes `joint_states`": starting(()),
    "a start with 9 rad in the first joint": starting((9.0, *START[1:])),
    "a joint `shoulder_pan`": starting((0.9,), ("shoulder_pan",)),
    "a goal inside the box": aiming(JointState(position=INSIDE)),
    "a goal pose 2 m away": aiming(pose=(2.0, 0.0, 0.0)),
    "nothing to reach": aiming(),
    "`planner_id` `rrt-connect`": setting("planner_id", "rrt-connect"),
    "a scene revision that is not there": setting("scene_revision", 99),
    "`uniform_fraction` 2": setting("uniform_fraction", 2.0),
}


@pytest.fixture(scope="module")
def client() -> Iterator[SuiteClient]:
    with running_suite("ur5") as suite:
        client = suite.add_all().client()
        client.wait_for_nodes(60.0)
        box = Obstacle.of("box", Box(np.array([0.2, 0.4, 0.4])), Pose.from_xyz_rpy([0.5, 0.0, 0.2]))
        client.publish_scene(Scene.of([box], WorkspaceBounds(np.full(3, -1.0), np.full(3, 1.0)), frame="world"))
        yield client


@pytest.mark.parametrize(("asked", "code", "answer"), ROWS, ids=[row[0] for row in ROWS])
def test_answer_is_the_one_of_the_page(client: SuiteClient, asked: str, code: str, answer: str) -> None:
    request = PlanRequest(allowed_planning_time=2.0, seed=1)
    request.start = JointState(position=START)
    request.goal_states = [JointState(position=(-0.9, *START[1:]))]
    ASKED[asked](request)
    response = client.plan(request, 20.0)
    pattern = ".*".join(re.escape(part) for part in answer.split("..."))
    assert re.fullmatch(pattern, response.message), response.message
    assert response.error_code == int(code)
    assert not response.trajectory.points
    assert math.isnan(response.cost) or response.cost == 0.0


def test_the_page_has_them_all() -> None:
    assert {row[0] for row in ROWS} == set(ASKED)
