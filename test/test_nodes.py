"""The three nodes, spun in this process, called as outside clients would."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from bsp_informed_planner_msgs.msg import KeypointGraph, ObstacleScene, PlanRequest, PlanResponse
from bsp_informed_planner_msgs.srv import SampleConfigurations
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState
from suite import (
    LONG,
    PATIENCE,
    SOON,
    Suite,
    gap_scene,
    guided_request,
    motion_client,
    outcome_of,
    point_request,
    running_suite,
    spin_until,
    start_motion,
    status_of,
    waypoints,
)

from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.nodes.client import SuiteClient
from bsp_informed_planner.nodes.decomposition_node import DecompositionNode
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.inference_node import InferenceNode
from bsp_informed_planner.nodes.planner_node import PlannerNode
from bsp_informed_planner.nodes.qos import LATCHED, LATCHED_UPDATES, UPDATES
from bsp_informed_planner.nodes.scene_conversions import scene_to_msg
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene
from bsp_informed_planner.scene.shapes import PointCloud


@pytest.fixture(scope="module")
def point() -> Iterator[Suite]:
    with running_suite("point") as suite:
        yield suite.add_all()


@pytest.fixture(scope="module")
def ur5() -> Iterator[Suite]:
    with running_suite("ur5") as suite:
        yield suite.add_all()


def plan(client: SuiteClient, request: PlanRequest) -> PlanResponse:
    """On the scene that the client has heard of, which the planner may hear of a little later."""
    request.scene_revision = request.scene_revision or client.revision
    return client.plan(request, PATIENCE)


def assert_passes_gap(response: PlanResponse, gap_at: float) -> None:
    """The path is a success, verified anew, and leads through the gap."""
    assert response.error_code == ErrorCode.SUCCESS, response.message
    path = waypoints(response)
    checker = ExactChecker(PointRobot(), gap_scene(gap_at))
    assert response.certified
    assert all(checker.is_edge_free(a, b, 1e-4) for a, b in zip(path[:-1], path[1:], strict=True))
    index = int(np.argmax(path[:, 0] > 0.5))
    before, after = path[index - 1], path[index]
    crossing = before + (0.5 - before[0]) / (after[0] - before[0]) * (after - before)
    assert abs(crossing[1] - gap_at) <= 0.05


def test_plan_through_a_gap(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    revision = client.publish_scene(gap_scene(0.8), PATIENCE)
    response = plan(client, guided_request(scene_revision=revision))
    assert_passes_gap(response, 0.8)
    assert response.scene_revision == revision
    assert (response.planner_id, response.sampler_id, response.fallback_reason) == ("rrt_star", "keypoint_tube", "")
    assert len(response.keypoints) >= 1
    assert response.statistics.edges_checked > 0
    assert response.statistics.cells > 0
    points = response.trajectory.points
    assert list(response.trajectory.joint_names) == ["x", "y"]
    assert np.allclose(points[0].positions, [0.1, 0.5])
    assert np.allclose(points[-1].positions, [0.9, 0.5])
    stamps = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in points]
    assert (np.diff(stamps) > 0.0).all()


def test_a_scene_update_between_two_plans_counts(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    first = client.publish_scene(gap_scene(0.8), PATIENCE)
    assert_passes_gap(plan(client, point_request(scene_revision=first)), 0.8)
    second = client.publish_scene(gap_scene(0.2), PATIENCE)
    assert second == first + 1
    assert_passes_gap(plan(client, point_request(scene_revision=second)), 0.2)
    stale = plan(client, point_request(scene_revision=first))
    assert stale.error_code == ErrorCode.MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE
    assert str(first) in stale.message


def test_a_measured_wall(point: Suite) -> None:
    """The wall as a camera sees it: the gap is at the same place, up to a voxel."""
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    scene = gap_scene(0.8)
    rng = np.random.default_rng(0)
    points = rng.uniform([0.48, 0.0, -0.05], [0.52, 1.0, 0.05], (20_000, 3))
    points = points[np.abs(points[:, 1] - 0.8) > 0.05]
    camera = Pose.from_xyz_rpy([0.3, 0.2, 1.0], [2.5, 0.1, 0.4])
    cloud = PointCloud(camera.inverse().apply(points), 0.01)
    measured = Scene.of([Obstacle.of("seen", cloud, camera)], scene.bounds)
    revision = client.publish_scene(measured, PATIENCE)
    response = plan(client, point_request(scene_revision=revision))
    assert response.error_code == ErrorCode.SUCCESS, response.message
    assert response.certified
    path = waypoints(response)
    checker = ExactChecker(PointRobot(), measured)
    assert all(checker.is_edge_free(a, b, 1e-4) for a, b in zip(path[:-1], path[1:], strict=True))
    # A cloud that names a frame that it is not in is refused, and the scene stays as it is.
    message = _message(measured)
    message.obstacles[0].point_clouds[0].header.frame_id = "camera_optical_frame"
    refused = _plan_after(point, client, message)
    assert "camera_optical_frame" in refused.message
    assert client.publish_scene(measured, PATIENCE) == revision + 1


def test_plans_in_sequence_and_at_once(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    clients = [point.client() for _ in range(4)]
    for other in clients:
        other.wait_for_nodes(PATIENCE)
    responses: list[PlanResponse] = []
    threads = [
        threading.Thread(target=lambda other=other: responses.append(plan(other, point_request()))) for other in clients
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(responses) == 4
    responses += [plan(client, point_request()) for _ in range(3)]
    for response in responses:
        assert_passes_gap(response, 0.8)
    # The same seed gives the same path, alone or in company.
    assert all(np.array_equal(waypoints(response), waypoints(responses[0])) for response in responses)


def test_late_nodes_learn_the_scene() -> None:
    with running_suite("point") as suite:
        early = suite.client()
        early._publisher.publish(_message(gap_scene(0.8)))
        suite.add_all()
        early.wait_for_nodes(PATIENCE)
        # The decomposition node heard a scene from before its time; the others hear it from the node.
        assert_passes_gap(_plan_when_scene_is_there(early), 0.8)
        late = suite.client()
        late.wait_for_nodes(PATIENCE)
        assert_passes_gap(plan(late, point_request()), 0.8)


def test_planner_goes_on_without_inference() -> None:
    with running_suite("point") as suite:
        suite.add(DecompositionNode)
        inference = suite.add(InferenceNode)
        suite.add(PlannerNode)
        client = suite.client()
        client.wait_for_nodes(PATIENCE)
        client.publish_scene(gap_scene(0.8), PATIENCE)
        assert plan(client, guided_request()).fallback_reason == ""
        suite.remove(inference)
        end = time.monotonic() + PATIENCE
        while (response := plan(client, guided_request())).fallback_reason == "" and time.monotonic() < end:
            time.sleep(0.1)
        assert_passes_gap(response, 0.8)
        assert "estimate_keypoints" in response.fallback_reason
        assert response.sampler_id == "keypoint_tube"


def test_no_scene_yet_is_said_at_once() -> None:
    with running_suite("point") as suite:
        suite.add_all()
        client = suite.client()
        client.wait_for_nodes(PATIENCE)
        begin = time.monotonic()
        response = plan(client, point_request(allowed_planning_time=LONG))
        assert response.error_code == ErrorCode.COLLISION_CHECKING_UNAVAILABLE
        assert "obstacle_scene" in response.message
        assert time.monotonic() - begin < SOON


def test_refused_scenes_stop_planning_until_mended(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    revision = client.publish_scene(gap_scene(0.8), PATIENCE)
    broken = _message(gap_scene(0.8))
    broken.obstacles[1].primitives[0].dimensions = [0.05, -1.0, 0.2]
    response = _plan_after(point, client, broken)
    assert response.error_code == ErrorCode.SENSOR_INFO_STALE
    assert "'upper'" in response.message
    assert response.scene_revision == revision
    wrong_frame = _message(gap_scene(0.8))
    wrong_frame.header.frame_id = "camera"
    assert "unknown frame 'camera'" in _plan_after(point, client, wrong_frame).message
    assert client.publish_scene(gap_scene(0.8), PATIENCE) == revision + 1
    assert_passes_gap(plan(client, point_request()), 0.8)


def test_empty_scenes_are_refused(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    scene = gap_scene(0.8)
    client.publish_scene(type(scene).of([], scene.bounds), PATIENCE)
    response = plan(client, point_request())
    assert response.error_code == ErrorCode.UNABLE_TO_ACQUIRE_SENSOR_DATA
    assert "allow_empty_scene" in response.message


def _states(*positions: list[float], names: list[str] | None = None) -> list[JointState]:
    return [JointState(name=names or [], position=list(position)) for position in positions]


BAD_REQUESTS: dict[str, tuple[Callable[[PlanRequest], None], ErrorCode, str]] = {
    "NaN start": (lambda r: setattr(r.start, "position", [0.1, np.nan]), ErrorCode.START_STATE_INVALID, "joint 'y'"),
    "twice": (
        lambda r: setattr(r, "start", JointState(name=["x", "y", "x"], position=[0.1, 0.2, 0.3])),
        ErrorCode.START_STATE_INVALID,
        "joint 'x' is named twice",
    ),
    "short start": (lambda r: setattr(r.start, "position", [0.1]), ErrorCode.START_STATE_INVALID, "1 positions"),
    "infinite goal": (
        lambda r: setattr(r, "goal_states", _states([np.inf, 0.5])),
        ErrorCode.GOAL_STATE_INVALID,
        "joint 'x'",
    ),
    "unknown joint": (
        lambda r: setattr(r, "goal_states", _states([0.9, 0.5], names=["x", "elbow"])),
        ErrorCode.INVALID_ROBOT_STATE,
        "elbow",
    ),
    "missing joint": (
        lambda r: setattr(r, "goal_states", _states([0.9], names=["x"])),
        ErrorCode.GOAL_STATE_INVALID,
        "y",
    ),
    "start outside limits": (
        lambda r: setattr(r.start, "position", [-0.2, 0.5]),
        ErrorCode.START_STATE_VIOLATES_PATH_CONSTRAINTS,
        "joint 'x' at -0.2000",
    ),
    "goal outside limits": (
        lambda r: setattr(r, "goal_states", _states([0.9, 1.5])),
        ErrorCode.GOAL_VIOLATES_PATH_CONSTRAINTS,
        "joint 'y' at 1.5000",
    ),
    "start in collision": (
        lambda r: setattr(r.start, "position", [0.5, 0.1]),
        ErrorCode.START_STATE_IN_COLLISION,
        "'lower'",
    ),
    "goal in collision": (
        lambda r: setattr(r, "goal_states", _states([0.5, 0.95])),
        ErrorCode.GOAL_IN_COLLISION,
        "'upper'",
    ),
    "no goal": (lambda r: setattr(r, "goal_states", []), ErrorCode.INVALID_GOAL_CONSTRAINTS, "no goal"),
    "unknown planner": (lambda r: setattr(r, "planner_id", "prm"), ErrorCode.INVALID_GROUP_NAME, "'prm'"),
    "unknown sampler": (lambda r: setattr(r, "sampler_id", "magic"), ErrorCode.INVALID_GROUP_NAME, "'magic'"),
    "unknown goal frame": (
        lambda r: r.__init__(start=r.start, goal_frame="hand", goal_poses=[PoseStamped()]),
        ErrorCode.FRAME_TRANSFORM_FAILURE,
        "'hand'",
    ),
    "uniform fraction": (lambda r: setattr(r, "uniform_fraction", 1.5), ErrorCode.PLANNING_FAILED, "uniform_fraction"),
    "negative time": (
        lambda r: setattr(r, "allowed_planning_time", -1.0),
        ErrorCode.PLANNING_FAILED,
        "allowed_planning_time",
    ),
    "endless time": (
        lambda r: setattr(r, "allowed_planning_time", np.inf),
        ErrorCode.PLANNING_FAILED,
        "allowed_planning_time",
    ),
    "no time at all": (
        lambda r: setattr(r, "allowed_planning_time", -np.inf),
        ErrorCode.PLANNING_FAILED,
        "allowed_planning_time",
    ),
    "time that is no number": (
        lambda r: setattr(r, "allowed_planning_time", np.nan),
        ErrorCode.PLANNING_FAILED,
        "allowed_planning_time",
    ),
    "too much time": (
        lambda r: setattr(r, "allowed_planning_time", 1e4),
        ErrorCode.PLANNING_FAILED,
        "allowed_planning_time",
    ),
    "scaling": (
        lambda r: setattr(r, "max_velocity_scaling_factor", 2.0),
        ErrorCode.PLANNING_FAILED,
        "max_velocity_scaling_factor",
    ),
}


@pytest.mark.parametrize("name", BAD_REQUESTS)
def test_bad_requests_are_named_at_once(point: Suite, name: str) -> None:
    spoil, code, culprit = BAD_REQUESTS[name]
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    request = point_request(allowed_planning_time=LONG)
    spoil(request)
    begin = time.monotonic()
    response = plan(client, request)
    assert response.error_code == code, response.message
    assert culprit in response.message
    assert not response.trajectory.points
    assert time.monotonic() - begin < SOON


def test_nothing_found_is_said_in_time(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8, gap=-0.1), PATIENCE)
    for allowed in (0.5, 2.0):
        begin = time.monotonic()
        response = plan(client, point_request(allowed_planning_time=allowed))
        elapsed = time.monotonic() - begin
        assert response.error_code == ErrorCode.TIMED_OUT
        # Within a tenth; the rest is for a machine that has other work.
        assert allowed * 0.5 <= elapsed <= 1.1 * allowed + SOON


def test_samples_run_out(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8, gap=-0.1), PATIENCE)
    response = plan(client, point_request(max_samples=50))
    assert response.error_code == ErrorCode.PLANNING_FAILED
    assert "50 samples" in response.message


def test_start_comes_from_joint_states(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    publisher = client._node.create_publisher(JointState, "joint_states", 10)
    planner = point.nodes[-1]
    assert isinstance(planner, PlannerNode)

    def is_heard() -> bool:
        # Joints of other devices on the topic do not matter. A message on such a topic may be lost.
        publisher.publish(JointState(name=["gripper", "x", "y"], position=[0.0, 0.2, 0.4]))
        return "gripper" in planner._joints.recent()

    spin_until(client, is_heard)
    request = point_request()
    request.start = JointState()
    response = plan(client, request)
    assert_passes_gap(response, 0.8)
    assert np.allclose(waypoints(response)[0], [0.2, 0.4])
    request.start = JointState(name=["y"], position=[0.6])
    assert np.allclose(waypoints(plan(client, request))[0], [0.2, 0.6])


def test_samples_come_from_the_local_samplers(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    service = client._node.create_client(SampleConfigurations, "sample_configurations")
    spin_until(client, service.service_is_ready)
    point.settle(client)
    request = SampleConfigurations.Request(
        configurations=[0.1, 0.5, 0.5, 0.8, 0.9, 0.5], joints=2, chain_offsets=[0, 3], count=500, seed=3
    )
    future = service.call_async(request)
    spin_until(client, future.done)
    answer = future.result()
    assert (answer.error_code, answer.model) == (ErrorCode.SUCCESS, "keypoint_tube"), answer.message
    samples = np.array(answer.samples).reshape(-1, 2)
    assert len(samples) == 500
    expected = np.interp(samples[:, 0], [0.1, 0.5, 0.9], [0.5, 0.8, 0.5])
    assert np.abs(samples[:, 1] - expected).mean() < 0.06
    request.model = "oracle"
    future = service.call_async(request)
    spin_until(client, future.done)
    assert future.result().error_code == ErrorCode.INVALID_GROUP_NAME
    assert "oracle" in future.result().message


def test_plan_motion_gives_feedback_and_is_cancelled(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    action = motion_client(client)
    phases: list[str] = []
    request = point_request(scene_revision=client.revision)
    goal = start_motion(
        client, action, request, feedback_callback=lambda message: phases.append(message.feedback.phase)
    )
    assert_passes_gap(outcome_of(client, goal), 0.8)
    # Feedback is on a topic of its own, and may come after the result.
    spin_until(client, lambda: {"searching", "timing"} <= set(phases))

    client.publish_scene(gap_scene(0.8, gap=-0.1), PATIENCE)
    request = point_request(allowed_planning_time=LONG, scene_revision=client.revision)
    goal = start_motion(client, action, request)
    client.spin_until(lambda: False, 0.3)
    begin = time.monotonic()
    goal.cancel_goal_async()
    assert outcome_of(client, goal).error_code == ErrorCode.PREEMPTED
    assert time.monotonic() - begin < SOON
    action.destroy()


def test_diffs_change_the_scene(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    revision = client.publish_scene(gap_scene(0.8), PATIENCE)
    diff = _message(gap_scene(0.2))
    diff.is_diff = True
    diff.obstacles = [obstacle for obstacle in diff.obstacles if obstacle.id == "upper"]
    diff.obstacles[0].operation = b"\x01"
    response = _plan_after(point, client, diff)
    # Without the upper wall the way is free above the gap.
    assert response.error_code == ErrorCode.SUCCESS
    assert response.scene_revision == revision + 1
    unknown = _message(gap_scene(0.2))
    unknown.is_diff = True
    unknown.obstacles = unknown.obstacles[:1]
    unknown.obstacles[0].id, unknown.obstacles[0].operation = "ghost", b"\x03"
    assert "no obstacle 'ghost'" in _plan_after(point, client, unknown).message


def test_floods_of_scenes_end_with_the_newest(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    before = client.publish_scene(gap_scene(0.8), PATIENCE)
    graphs: list[int] = []
    scenes: list[int] = []
    # Latched, so that the newest comes even to a subscription that is matched after the flood.
    client._node.create_subscription(
        KeypointGraph, "keypoint_graph", lambda message: graphs.append(message.scene_revision), LATCHED_UPDATES
    )
    client._node.create_subscription(
        ObstacleScene, "scene", lambda message: scenes.append(message.revision), LATCHED_UPDATES
    )
    flood = client._node.create_publisher(ObstacleScene, "obstacle_scene", UPDATES)
    spin_until(client, lambda: flood.get_subscription_count() > 0)
    count = 80
    for index in range(count):
        message = _message(gap_scene(0.2 + 0.6 * index / (count - 1)))
        flood.publish(message)
    newest = before + count
    spin_until(client, lambda: client.revision == newest)
    spin_until(client, lambda: bool(scenes) and scenes[-1] == newest and bool(graphs) and graphs[-1] == newest)
    # In order, though not each revision: of what is latched, one that was not read in time is replaced.
    assert scenes == sorted(set(scenes))
    assert graphs == sorted(set(graphs))
    assert_passes_gap(plan(client, point_request()), 0.8)


def test_unreachable_pose_and_wrong_state_of_an_arm(ur5: Suite) -> None:
    client = ur5.client()
    client.wait_for_nodes(PATIENCE)
    from bsp_informed_planner.scene.shelf import random_shelf

    client.publish_scene(random_shelf(np.random.default_rng(1), frame="world").scene)
    request = PlanRequest(allowed_planning_time=2.0, first_solution=True, seed=1)
    request.start.position = [0.0, -1.57, 0.0, -1.57, 0.0, 0.0]
    pose = PoseStamped()
    pose.pose.position.x = 5.0
    request.goal_poses = [pose]
    response = plan(client, request)
    assert response.error_code == ErrorCode.NO_IK_SOLUTION
    assert "(5.000, 0.000, 0.000)" in response.message
    pose.header.frame_id = "camera_link"
    response = plan(client, request)
    assert response.error_code == ErrorCode.FRAME_TRANSFORM_FAILURE
    assert "camera_link" in response.message
    request.start.position = [0.0, -1.57, 0.0]
    response = plan(client, request)
    assert response.error_code == ErrorCode.START_STATE_INVALID
    request.start.position = []
    response = plan(client, request)
    assert response.error_code == ErrorCode.ROBOT_STATE_STALE
    assert "shoulder_pan_joint" in response.message


def _message(scene: object) -> ObstacleScene:
    from bsp_informed_planner.nodes.scene_conversions import scene_to_msg
    from bsp_informed_planner.scene.scene import Scene

    assert isinstance(scene, Scene)
    return scene_to_msg(scene)


def _plan_after(suite: Suite, client: SuiteClient, message: ObstacleScene) -> PlanResponse:
    """Publish a raw scene message, wait until all have heard what became of it, plan."""
    status_of(client, message)
    suite.settle(client)
    return plan(client, point_request())


def _plan_when_scene_is_there(client: SuiteClient) -> PlanResponse:
    end = time.monotonic() + PATIENCE
    while True:
        response = plan(client, point_request())
        if response.error_code != ErrorCode.COLLISION_CHECKING_UNAVAILABLE or time.monotonic() > end:
            return response
        time.sleep(0.1)


def test_latched_topics_are_latched() -> None:
    # What subscribers rely on: reliable, transient local, depth 1.
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    assert LATCHED.depth == 1
    assert LATCHED.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert LATCHED.reliability == ReliabilityPolicy.RELIABLE


def test_easy_problems_do_not_wait_for_guidance(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    response = plan(client, point_request((0.2, 0.5)))
    assert response.error_code == ErrorCode.SUCCESS, response.message
    assert (response.planner_id, response.sampler_id) == ("anytime", "uniform")
    assert response.fallback_reason == ""
    assert "before keypoints were needed" in response.message
    assert response.statistics.inference_seconds == 0.0


def test_scenes_without_stamps_do_not_hide_one_that_has(point: Suite) -> None:
    client = point.client()
    client.wait_for_nodes(PATIENCE)
    unstamped = client._node.create_publisher(ObstacleScene, "obstacle_scene", UPDATES)
    spin_until(client, lambda: unstamped.get_subscription_count() > 0)
    before, rounds = client.publish_scene(gap_scene(0.8), PATIENCE), 20
    for _ in range(rounds):
        # The stamped one, between them, may be superseded before it is decomposed; its sender is answered all the same.
        for gap_at in (0.3, 0.4, 0.5):
            unstamped.publish(scene_to_msg(gap_scene(gap_at)))
        assert client.publish_scene(gap_scene(0.8), PATIENCE) <= client.revision
        unstamped.publish(scene_to_msg(gap_scene(0.6)))
    # None may still be on its way when another test begins.
    spin_until(client, lambda: client.revision == before + 5 * rounds)
