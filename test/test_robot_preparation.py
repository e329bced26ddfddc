"""Robots that are new to the nodes: bounds are built in the background, and the nodes say so meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from bsp_informed_planner_msgs.msg import PlanRequest
from bsp_informed_planner_msgs.srv import EstimateKeypoints, GetPlannerInfo
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from suite import PATIENCE, SOON, Suite, gap_scene, point_request, running_suite, spin_until, until

from bsp_informed_planner.collision import bounds
from bsp_informed_planner.collision.bounds import bounds_at_hand, bounds_of
from bsp_informed_planner.collision.cover import CoverOptions
from bsp_informed_planner.collision.cover_files import cover_key
from bsp_informed_planner.collision.sharpening import SharpeningOptions
from bsp_informed_planner.nodes import robot_preparation
from bsp_informed_planner.nodes.client import SuiteClient
from bsp_informed_planner.nodes.decomposition_node import DecompositionNode
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.inference_node import InferenceNode
from bsp_informed_planner.nodes.planner_node import PlannerNode
from bsp_informed_planner.nodes.qos import LATCHED
from bsp_informed_planner.robots.arm import load_arm
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box


def slider(radius: float, name: str = "slider") -> str:
    """A ball that slides in a plane and turns: its bounds are built in no time."""
    return f"""<robot name="{name}"><link name="world"/><link name="beam"/><link name="tip"/>
<joint name="x" type="prismatic"><parent link="world"/><child link="beam"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1" velocity="1" effort="1"/></joint>
<joint name="y" type="prismatic"><parent link="beam"/><child link="tip"/><axis xyz="0 1 0"/>
<limit lower="0" upper="1" velocity="1" effort="1"/></joint>
<link name="ball"><collision><geometry><sphere radius="{radius}"/></geometry></collision></link>
<joint name="fixed" type="fixed"><parent link="tip"/><child link="ball"/></joint></robot>"""


class HeldUp:
    """Keeps bounds of a robot from being built, as long as a test likes: another thread seems to build them."""

    def __init__(self, urdf: str) -> None:
        key = cover_key(load_arm(urdf), CoverOptions(), SharpeningOptions())
        self._lock = threading.Lock()
        self._lock.acquire()
        bounds._building[key] = self._lock

    def let_go(self) -> None:
        self._lock.release()


@pytest.fixture(autouse=True)
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bsp_informed_planner.collision.cover_files.user_cache", lambda: tmp_path)
    monkeypatch.setattr(robot_preparation, "BRIEFLY", 0.01)


@pytest.fixture
def suite() -> Iterator[Suite]:
    with running_suite("point") as suite:
        yield suite


def scene() -> Scene:
    wall = Obstacle.of("wall", Box(np.array([0.05, 0.5, 0.5])), Pose.from_xyz_rpy([0.5, 0.3, 0.0]))
    return Scene.of([wall], WorkspaceBounds(-np.ones(3), 2.0 * np.ones(3)))


def request() -> PlanRequest:
    return PlanRequest(
        start=JointState(position=[0.1, 0.1]),
        goal_states=[JointState(position=[0.9, 0.1])],
        allowed_planning_time=PATIENCE,
        first_solution=True,
        seed=1,
    )


def information(client: SuiteClient) -> GetPlannerInfo.Response:
    service = client.node.create_client(GetPlannerInfo, "get_planner_info")
    spin_until(client, service.service_is_ready)
    future = service.call_async(GetPlannerInfo.Request())
    spin_until(client, future.done)
    return future.result()


def test_plans_are_refused_while_bounds_are_built_and_succeed_afterwards(suite: Suite) -> None:
    urdf = slider(0.011)
    held_up = HeldUp(urdf)
    suite.add(DecompositionNode, dimension=3)
    inference = suite.add(InferenceNode, robot="", robot_description=urdf)
    planner = suite.add(PlannerNode, robot="", robot_description=urdf)
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(scene(), PATIENCE)
    suite.settle(client)
    response = client.plan(request(), SOON)
    assert response.error_code == ErrorCode.COLLISION_CHECKING_UNAVAILABLE
    assert "bounds of robot 'slider' are being built, 0 %" in response.message
    assert "being built" in information(client).message
    assert planner.diagnostic_values()["preparation"] == "bounds of slider: 0%"
    service = client.node.create_client(EstimateKeypoints, "estimate_keypoints")
    spin_until(client, service.service_is_ready)
    future = service.call_async(EstimateKeypoints.Request(start=[0.1, 0.1], goals=[0.9, 0.1], joints=2))
    spin_until(client, future.done)
    assert future.result().error_code == ErrorCode.COLLISION_CHECKING_UNAVAILABLE
    assert "being built" in future.result().message
    held_up.let_go()
    for node in (planner, inference):
        until(lambda: not node.diagnostic_values()["preparation"])  # noqa: B023
    response = client.plan(request(), PATIENCE)
    assert response.error_code == ErrorCode.SUCCESS, response.message
    assert information(client).robot == "slider"


def test_the_newest_description_wins(suite: Suite) -> None:
    first, second = slider(0.012, "first"), slider(0.013, "second")
    held_up = HeldUp(first)
    node = suite.add(PlannerNode, robot="", use_inference=False)
    client = suite.client()
    publisher = client.node.create_publisher(String, "robot_description", LATCHED)
    publisher.publish(String(data=first))
    spin_until(client, lambda: "first" in str(node.diagnostic_values()["preparation"]))
    publisher.publish(String(data=second))
    spin_until(client, lambda: node.diagnostic_values()["robot"] == "second")
    held_up.let_go()
    # What was begun first is kept for the next time, or given up, but it is not handed over.
    spin_until(client, lambda: not [t for t in threading.enumerate() if t.name == "bounds"])
    assert node.diagnostic_values()["robot"] == "second"
    assert not node.diagnostic_values()["preparation"]


def test_other_robots_are_not_waited_for() -> None:
    urdf = slider(0.014)
    held_up = HeldUp(urdf)
    robot = load_arm(urdf)
    thread = threading.Thread(target=bounds_of, args=(robot,), daemon=True)
    thread.start()
    assert bounds_of(PointRobot(radius=0.0123)).reach > 0.0
    assert bounds_at_hand(robot) is None
    held_up.let_go()
    thread.join(PATIENCE)
    made = bounds_at_hand(robot)
    assert made is not None
    assert bounds_of(robot) is made
    # Of another robot with the same description they are read.
    assert bounds_at_hand(load_arm(urdf)) is not None


def test_progress_ends_at_the_end_and_may_end_the_work() -> None:
    told: list[tuple[int, int]] = []
    bounds_of(load_arm(slider(0.015)), lambda done, total: told.append((done, total)))
    assert told[-1][0] == told[-1][1]
    assert [done for done, _ in told] == sorted(done for done, _ in told)

    def enough(done: int, total: int) -> None:
        raise InterruptedError

    robot = load_arm(slider(0.016))
    with pytest.raises(InterruptedError):
        bounds_of(robot, enough)
    assert bounds_at_hand(robot) is None


def test_what_a_plan_needs_is_made_when_the_scene_comes(suite: Suite) -> None:
    suite.add(DecompositionNode)
    planner = suite.add(PlannerNode, use_inference=False)
    assert isinstance(planner, PlannerNode)
    client = suite.client()
    spin_until(client, lambda: client._publisher.get_subscription_count() > 0)
    for gap_at in (0.8, 0.2):
        client.publish_scene(gap_scene(gap_at), PATIENCE)
        suite.settle(client)
        until(lambda: planner._world._world is not None and planner._world._world.revision == client.revision)
        world = planner._world._world
        spin_until(client, client._plan.service_is_ready)
        assert client.plan(point_request(scene_revision=client.revision), PATIENCE).error_code == ErrorCode.SUCCESS
        assert planner._world._world is world
