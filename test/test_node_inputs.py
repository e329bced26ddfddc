"""What the nodes are told: bodies held, pairs that may touch, measured points, robot descriptions."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
from bsp_informed_planner_msgs.msg import AllowedCollision, AttachedObstacle, Obstacle, ObstacleScene
from rclpy.publisher import Publisher
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import String
from suite import PATIENCE, Suite, gap_scene, point_request, running_suite, spin_until, status_of, waypoints

from bsp_informed_planner.nodes.client import SuiteClient
from bsp_informed_planner.nodes.cloud_conversions import cloud_to_msg
from bsp_informed_planner.nodes.decomposition_node import DecompositionNode
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.planner_node import PlannerNode
from bsp_informed_planner.nodes.qos import LATCHED
from bsp_informed_planner.nodes.scene_conversions import diff_from_msg, scene_from_msg, scene_to_msg
from bsp_informed_planner.nodes.size_limits import SizeLimits
from bsp_informed_planner.scene.diff import apply
from bsp_informed_planner.scene.scene import Scene


@pytest.fixture(scope="module")
def suite() -> Iterator[Suite]:
    with running_suite("point") as suite:
        yield suite.add_all()


@pytest.fixture
def client(suite: Suite) -> SuiteClient:
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    return client


def disc(radius: float, operation: bytes = AttachedObstacle.ATTACH) -> AttachedObstacle:
    """A disc around the point robot."""
    body = Obstacle(id="disc", primitives=[SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[radius])])
    return AttachedObstacle(operation=operation, obstacle=body, link_name="point")


def change(client: SuiteClient, **fields: object) -> None:
    """Publish a diff and wait until it is in force, or refused."""
    status_of(client, ObstacleScene(is_diff=True, **fields))


def crossing(client: SuiteClient, **fields: object) -> tuple[int, str]:
    """Code and message of a plan on the scene in force."""
    request = point_request()
    for name, value in {"scene_epoch": client.epoch, "scene_revision": client.revision, **fields}.items():
        setattr(request, name, value)
    response = client.plan(request, PATIENCE)
    return int(response.error_code), str(response.message)


def test_an_attached_body_of_the_scene(client: SuiteClient) -> None:
    assert crossing(client)[0] == ErrorCode.SUCCESS
    change(client, attached=[disc(0.04)])
    assert crossing(client)[0] == ErrorCode.SUCCESS
    change(client, attached=[disc(0.06)])
    # It is wider than the gap.
    assert crossing(client, max_samples=500)[0] == ErrorCode.PLANNING_FAILED
    pairs = [AllowedCollision(first="disc", second="upper")]
    assert crossing(client, max_samples=500, allowed_collisions=pairs)[0] == ErrorCode.SUCCESS
    change(client, allowed_collisions=pairs)
    assert crossing(client, max_samples=500)[0] == ErrorCode.SUCCESS
    # Where it is put down it is an obstacle.
    down = disc(0.06, AttachedObstacle.DETACH)
    down.obstacle.pose.position.x, down.obstacle.pose.position.y = 0.9, 0.5
    change(client, attached=[down])
    code, message = crossing(client)
    assert (code, "'disc'" in message) == (ErrorCode.GOAL_IN_COLLISION, True)
    change(client, attached=[AttachedObstacle(obstacle=Obstacle(id="disc"), link_name="point")])
    # It is at the robot again, and the pair still allowed.
    assert crossing(client, max_samples=500)[0] == ErrorCode.SUCCESS
    change(client, allowed_collisions=[AllowedCollision(allowed=False)])
    assert crossing(client, max_samples=500)[0] == ErrorCode.PLANNING_FAILED
    client.publish_scene(gap_scene(0.8), PATIENCE)
    assert crossing(client)[0] == ErrorCode.SUCCESS


def test_the_status_names_what_is_attached(client: SuiteClient) -> None:
    change(client, attached=[disc(0.01)], obstacles=[Obstacle(id="lower", operation=Obstacle.REMOVE)])
    assert client._status is not None
    assert client._status.message == "1 obstacle; 1 attached: 'disc' to 'point'"
    wrong = disc(0.01)
    wrong.obstacle.id, wrong.link_name = "ring", "pointt"
    change(client, attached=[wrong])
    assert client._status.message == "1 obstacle; 2 attached: 'disc' to 'point', 'ring' to 'pointt'"
    # The decomposition node knows no robot: it is the planner that says what link there is not.
    code, message = crossing(client)
    assert code == ErrorCode.FRAME_TRANSFORM_FAILURE
    assert "did you mean 'point'" in message


def test_an_attached_body_of_a_request(client: SuiteClient) -> None:
    assert crossing(client, max_samples=500, attached=[disc(0.06)])[0] == ErrorCode.PLANNING_FAILED
    # It was that request's alone.
    assert crossing(client)[0] == ErrorCode.SUCCESS
    nowhere = disc(0.01)
    nowhere.link_name = "hand"
    code, message = crossing(client, attached=[nowhere])
    assert code == ErrorCode.FRAME_TRANSFORM_FAILURE
    assert "'hand'" in message
    code, message = crossing(client, attached=[disc(-1.0)])
    assert code == ErrorCode.INVALID_OBJECT_NAME
    assert "'disc'" in message


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"attached": [AttachedObstacle(obstacle=Obstacle(id="ghost"), link_name="point")]}, "no obstacle 'ghost'"),
        ({"attached": [AttachedObstacle(obstacle=Obstacle(id="lower"))]}, "needs a link"),
        ({"attached": [AttachedObstacle(operation=b"\x09", obstacle=Obstacle(id="x"))]}, "unknown operation"),
        ({"allowed_collisions": [AllowedCollision(first="a")]}, "two different names"),
    ],
)
def test_changes_that_do_not_fit_are_refused(client: SuiteClient, fields: dict[str, object], said: str) -> None:
    before = client.revision
    change(client, **fields)
    assert client._status is not None
    assert (client._status.error_code, client.revision) == (ErrorCode.INVALID_OBJECT_NAME, before)
    assert said in client._status.message


def test_held_bodies_travel_with_the_scene() -> None:
    message = scene_to_msg(gap_scene(0.8))
    message.attached = [disc(0.04)]
    message.attached[0].touch_links = ["b", "a"]
    message.allowed_collisions = [AllowedCollision(first="disc", second="upper")]
    scene = scene_from_msg(message)
    assert scene.attached["disc"].touch_links == {"a", "b"}
    again = scene_to_msg(scene)
    assert (again.attached[0].link_name, list(again.attached[0].touch_links)) == ("point", ["a", "b"])
    assert again.allowed_collisions == message.allowed_collisions
    taken_back = ObstacleScene(is_diff=True, allowed_collisions=[AllowedCollision(allowed=False)])
    assert not apply(scene, diff_from_msg(taken_back)).allowed_collisions


def wall_cloud(gap_at: float, frame: str = "world") -> PointCloud2:
    rng = np.random.default_rng(0)
    points = rng.uniform([0.48, 0.0, -0.05], [0.52, 1.0, 0.05], (20_000, 3))
    return cloud_to_msg(points[np.abs(points[:, 1] - gap_at) > 0.06], frame)


def publish_points(suite: Suite, client: SuiteClient, publisher: Publisher, cloud: PointCloud2) -> None:
    """Publish a cloud, again if it is lost, as it may be on such a topic, until all have heard what became of it."""
    cloud.header.stamp = client._node.get_clock().now().to_msg()

    def is_answered() -> bool:
        return client._status is not None and client._status.header.stamp == cloud.header.stamp

    end = time.monotonic() + PATIENCE
    while not is_answered():
        assert time.monotonic() < end
        publisher.publish(cloud)
        client.spin_until(is_answered, 2.0)
    suite.settle(client)


def test_points_are_a_source_of_their_own() -> None:
    with running_suite("point") as suite:
        suite.add(DecompositionNode, workspace_min=[0.0, 0.0, -0.05], workspace_max=[1.0, 1.0, 0.05])
        suite.add(PlannerNode, use_inference=False)
        client = suite.client()
        points = client._node.create_publisher(PointCloud2, "obstacle_points", 1)
        spin_until(client, lambda: points.get_subscription_count() > 0)
        publish_points(suite, client, points, wall_cloud(0.3))
        assert crossing(client)[0] == ErrorCode.SUCCESS
        # A whole scene does not know of them, and they stay: now both walls have to be passed.
        empty = Scene.of([], gap_scene(0.8).bounds)
        client.publish_scene(empty, PATIENCE)
        response = client.plan(point_request(scene_revision=client.revision), PATIENCE)
        assert response.error_code == ErrorCode.SUCCESS, response.message
        path = waypoints(response)
        index = int(np.argmax(path[:, 0] > 0.5))
        assert min(abs(path[index - 1 : index + 1, 1] - 0.3)) < 0.3
        # What is in another frame is refused, and that is not mended by a good scene.
        publish_points(suite, client, points, wall_cloud(0.3, "camera_optical_frame"))
        assert client._status is not None
        assert client._status.error_code == ErrorCode.FRAME_TRANSFORM_FAILURE
        assert "'camera_optical_frame'" in client._status.message
        with pytest.raises(Exception, match="camera_optical_frame"):
            client.publish_scene(gap_scene(0.8), PATIENCE)
        suite.settle(client)
        assert "camera_optical_frame" in client.plan(point_request(), PATIENCE).message
        # Nothing was measured any more.
        publish_points(suite, client, points, PointCloud2(header=wall_cloud(0.3).header))
        assert client._status.error_code == ErrorCode.SUCCESS
        assert crossing(client)[0] == ErrorCode.SUCCESS


def test_sizes_are_bounded(suite: Suite, client: SuiteClient) -> None:
    limits = SizeLimits(bodies=3, vertices=100, points=50, pairs=2, name_length=8)
    scene = scene_to_msg(gap_scene(0.8))
    limits.check_message(scene)
    for spoil, said in (
        (lambda m: setattr(m.obstacles[0], "id", "x" * 9), "max_name_length"),
        (lambda m: m.obstacles[0].primitives.extend(m.obstacles[0].primitives * 3), "max_bodies"),
        (lambda m: setattr(m, "allowed_collisions", [AllowedCollision(first="a", second="b")] * 3), "max_pairs"),
        (lambda m: m.obstacles[0].point_clouds.append(wall_cloud(0.5)), "max_points"),
        (lambda m: setattr(m, "attached", [disc(0.1)] * 4), "max_bodies"),
    ):
        message = scene_to_msg(gap_scene(0.8))
        spoil(message)
        with pytest.raises(Exception, match=said):
            limits.check_message(message)
    # Diffs add up.
    node = suite.nodes[0]
    from rclpy.parameter import Parameter

    assert node.set_parameters_atomically([Parameter("max_bodies", value=4)]).successful
    for index in range(3):
        box = Obstacle(id=f"box{index}", primitives=[SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.01] * 3)])
        box.pose.position.x = 0.2
        change(client, obstacles=[box])
    assert client._status is not None
    assert "5 bodies: at most 4" in client._status.message
    assert node.set_parameters_atomically([Parameter("max_bodies", value=1000)]).successful


URDF = """<robot name="slider"><link name="world"/><link name="beam"/><link name="tip"/>
<joint name="x" type="prismatic"><parent link="world"/><child link="beam"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1" velocity="1" effort="1"/></joint>
<joint name="y" type="prismatic"><parent link="beam"/><child link="tip"/><axis xyz="0 1 0"/>
<limit lower="0" upper="1" velocity="1" effort="1"/></joint>
<link name="ball"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
<joint name="fixed" type="fixed"><parent link="tip"/><child link="ball"/></joint></robot>"""
# The end effector chooses the tool frame, by which a loaded SRDF is told here.
SRDF = '<robot name="slider"><end_effector name="e" parent_link="ball" group="g"/></robot>'


def test_descriptions_come_from_topics_in_any_order() -> None:
    for order in ((0, 1), (1, 0)):
        with running_suite("point") as suite:
            node = suite.add(PlannerNode, robot="", use_inference=False)
            client = suite.client()
            publishers = [
                client._node.create_publisher(String, topic, LATCHED)
                for topic in ("robot_description", "robot_description_semantic")
            ]
            for index in order:
                publishers[index].publish(String(data=(URDF, SRDF)[index]))
            tracker = node._world
            spin_until(client, lambda: tracker.robot_name == "slider")  # noqa: B023
            spin_until(client, lambda: tracker.robot.tool_frame == "ball")  # noqa: B023
            # What cannot be used, or is no description at all, changes nothing, and is said.
            for text in ("<robot", "/etc/passwd", "<robot name='x'/>"):
                node._last_error = ""
                publishers[0].publish(String(data=text))
                spin_until(client, lambda: "robot_description" in node._last_error)  # noqa: B023
                assert tracker.robot_name == "slider"


def test_entities_do_not_explode(tmp_path: object) -> None:
    from bsp_informed_planner.errors import RobotDescriptionError
    from bsp_informed_planner.robots.arm import load_arm

    levels = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
    bomb = f'<!DOCTYPE robot [<!ENTITY l0 "ha">{levels}]><robot name="&l11;"><link name="a"/></robot>'
    begin = time.monotonic()
    with pytest.raises(RobotDescriptionError):
        load_arm("<?xml version='1.0'?>" + bomb)
    assert time.monotonic() - begin < PATIENCE
