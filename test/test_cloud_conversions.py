"""Point clouds between ROS messages and the library."""

from __future__ import annotations

from array import array

import numpy as np
import pytest

pytest.importorskip("bsp_informed_planner_msgs")

from bsp_informed_planner_msgs.msg import Obstacle as ObstacleMsg
from bsp_informed_planner_msgs.msg import ObstacleScene
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose as PoseMsg
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from sensor_msgs.msg import PointCloud2, PointField
from visualization_msgs.msg import Marker

from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.errors import InvalidObstacleError, UnknownFrameError
from bsp_informed_planner.nodes.cloud_conversions import cloud_points, cloud_to_msg
from bsp_informed_planner.nodes.obstacle_conversions import point_cloud_from_msg, pose_to_msg
from bsp_informed_planner.nodes.scene_conversions import diff_from_msg, scene_from_msg, scene_to_msg
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, PointCloud
from bsp_informed_planner.visualization.markers import decomposition_markers

BOUNDS = WorkspaceBounds(np.full(3, -1.0), np.full(3, 1.0))
POINTS = np.random.default_rng(0).uniform(-1.0, 1.0, (60, 3)).astype(np.float32).astype(np.float64)


def camera_message(
    points: FloatArray,
    height: int = 1,
    kinds: tuple[str, str, str] = ("f4", "f4", "f4"),
    offsets: tuple[int, int, int] = (4, 16, 8),
    step: int = 32,
    padding: int = 0,
    big: bool = False,
) -> PointCloud2:
    """As a driver might send it: other fields around and between, rows that are padded."""
    order = ">" if big else "<"
    record = np.dtype(
        {"names": list("xyz"), "formats": [order + kind for kind in kinds], "offsets": offsets, "itemsize": step}
    )
    width = len(points) // height
    rows = np.frombuffer(np.random.default_rng(1).bytes(len(points) * step), np.uint8).copy().view(record)
    for axis, name in enumerate("xyz"):
        rows[name] = points[:, axis]
    data = np.zeros((height, width * step + padding), np.uint8)
    data[:, : width * step] = rows.view(np.uint8).reshape(height, -1)
    datatypes = {"f4": PointField.FLOAT32, "f8": PointField.FLOAT64}
    fields = [PointField(name="rgb", offset=0, datatype=PointField.UINT32, count=1)]
    fields += [
        PointField(name=name, offset=offset, datatype=datatypes[kind], count=1)
        for name, offset, kind in zip("xyz", offsets, kinds, strict=True)
    ]
    return PointCloud2(
        height=height,
        width=width,
        fields=fields,
        is_bigendian=big,
        point_step=step,
        row_step=data.shape[1],
        data=array("B", data.tobytes()),
    )


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize(("height", "padding"), [(1, 0), (6, 0), (6, 13)])
@pytest.mark.parametrize(
    ("kinds", "offsets", "step"),
    [
        (("f4", "f4", "f4"), (0, 4, 8), 12),
        (("f4", "f4", "f4"), (4, 16, 8), 32),
        (("f8", "f8", "f8"), (3, 11, 21), 29),
        (("f8", "f4", "f8"), (0, 8, 12), 20),
    ],
)
def test_any_layout_is_read(
    kinds: tuple[str, str, str], offsets: tuple[int, int, int], step: int, height: int, padding: int, big: bool
) -> None:
    message = camera_message(POINTS, height, kinds, offsets, step, padding, big)
    np.testing.assert_array_equal(cloud_points(message), POINTS)


@given(
    hnp.arrays(
        np.float64,
        st.tuples(st.integers(1, 20), st.just(3)),
        elements=st.floats(-1e6, 1e6) | st.floats(-1, 1, width=32),
    )
)
def test_points_go_there_and_back_exactly(points: FloatArray) -> None:
    message = cloud_to_msg(points, "base_link")
    assert message.header.frame_id == "base_link"
    np.testing.assert_array_equal(cloud_points(message), points)


def test_single_precision_where_it_is_enough() -> None:
    assert cloud_to_msg(POINTS).point_step == 12
    assert cloud_to_msg(POINTS + 1e-12).point_step == 24


def test_lost_returns_are_left_out() -> None:
    points = POINTS.copy()
    points[::3, 1] = np.nan
    points[1, 2] = np.inf
    message = camera_message(points, height=6)
    np.testing.assert_array_equal(cloud_points(message), points[np.isfinite(points).all(axis=1)])
    message.is_dense = True
    with pytest.raises(ValueError, match="21 points are not finite"):
        cloud_points(message)
    with pytest.raises(ValueError, match="none of its points"):
        cloud_points(camera_message(np.full((5, 3), np.nan)))


def test_a_single_row_needs_no_row_step() -> None:
    message = camera_message(POINTS)
    message.row_step = 0
    np.testing.assert_array_equal(cloud_points(message), POINTS)


def broken(**changes: object) -> PointCloud2:
    message = camera_message(POINTS, height=6)
    for name, value in changes.items():
        setattr(message, name, value)
    return message


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (PointCloud2(), "0 points"),
        (broken(width=2**31), "expected 1 to"),
        (broken(height=7), "its data have"),
        (broken(data=array("B")), "its data have"),
        (broken(row_step=5), "row_step"),
        (broken(point_step=10), "beyond the 10 bytes"),
        (broken(point_step=0), "beyond the 0 bytes"),
        (broken(fields=[]), "expected one field 'x'"),
        (broken(fields=3 * [PointField(name="x", datatype=PointField.FLOAT32, count=1)]), "expected one field 'x'"),
        (broken(fields=[PointField(name="x", datatype=PointField.INT32, count=1)]), "datatype 5"),
        (broken(fields=[PointField(name="x", datatype=PointField.FLOAT32, count=3)]), "count 3"),
        (
            broken(fields=[PointField(name=n, offset=2**32 - 1, datatype=PointField.FLOAT32) for n in "xyz"]),
            "beyond the 32 bytes",
        ),
    ],
)
def test_broken_messages(message: PointCloud2, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        cloud_points(message)


def test_frames() -> None:
    message = camera_message(POINTS)
    for given_frame, scene_frame in (("", ""), ("", "base_link"), ("base_link", "base_link")):
        message.header.frame_id = given_frame
        assert isinstance(point_cloud_from_msg(message, frame=scene_frame), PointCloud)
    message.header.frame_id = "camera_optical_frame"
    with pytest.raises(UnknownFrameError, match=r"camera_optical_frame.*base_link"):
        point_cloud_from_msg(message, frame="base_link")


def test_a_voxel_keeps_one_point() -> None:
    points = np.repeat(POINTS, 5, axis=0)
    cloud = point_cloud_from_msg(camera_message(points), 0.05)
    assert len(cloud.points) == len(cloud.voxels)
    np.testing.assert_array_equal(cloud.voxels, PointCloud(points, 0.05).voxels)


# --- obstacles ----------------------------------------------------------------------------------------------------


def cloud_scene() -> Scene:
    clouds = (
        (PointCloud(POINTS, 0.03).thinned(), Pose.from_xyz_rpy([0.1, 0.2, 0.3], [0.3, 0.2, 0.1])),
        (PointCloud(POINTS[:5] + 1e-9, 0.01), Pose.identity()),
        (Box(np.full(3, 0.1)), Pose.identity()),
    )
    return Scene.of([Obstacle("seen", clouds, Pose.from_xyz_rpy([0.1, 0, 0], [0, 0, 1.0]))], BOUNDS, "base_link", 3)


def test_scenes_go_there_and_back() -> None:
    scene = cloud_scene()
    message = scene_to_msg(scene)
    assert [len(clouds) for clouds in (message.obstacles[0].point_clouds, message.obstacles[0].primitives)] == [2, 1]
    again = scene_from_msg(message)
    shapes = {id(shape): (shape, pose) for shape, pose in again.obstacles["seen"].shapes}.values()
    clouds = [(shape, pose) for shape, pose in shapes if isinstance(shape, PointCloud)]
    assert len(clouds) == 2
    for (shape, pose), (expected, place) in zip(clouds, scene.obstacles["seen"].shapes, strict=False):
        assert isinstance(expected, PointCloud)
        np.testing.assert_array_equal(shape.points, expected.points)
        assert shape.resolution == expected.resolution
        assert pose == place
    np.testing.assert_array_equal(decompose(again).is_free(POINTS), decompose(scene).is_free(POINTS))


def cloud_obstacle(**fields: object) -> ObstacleMsg:
    message = ObstacleMsg(id="seen", point_clouds=[camera_message(POINTS)])
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def read(*obstacles: ObstacleMsg, frame: str = "base_link") -> list[PointCloud]:
    scene = ObstacleScene(obstacles=list(obstacles))
    read_back = [operation.obstacle for operation in diff_from_msg(scene, frame).operations]
    return [shape for obstacle in read_back if obstacle is not None for shape, _ in obstacle.shapes]  # type: ignore[misc]


def test_resolutions() -> None:
    one, two = [camera_message(POINTS)], 2 * [camera_message(POINTS)]
    poses = 2 * [pose_to_msg(Pose.from_xyz_rpy([0.1, 0, 0]))]
    assert [cloud.resolution for cloud in read(cloud_obstacle(point_clouds=one))] == [0.02]
    for given_values, expected in (
        ([], [0.02, 0.02]),
        ([0.0], [0.02, 0.02]),
        ([0.1], [0.1, 0.1]),
        ([0, 1.0], [0.02, 1]),
    ):
        message = cloud_obstacle(
            point_clouds=two, point_cloud_poses=poses, point_cloud_resolutions=[float(v) for v in given_values]
        )
        assert [cloud.resolution for cloud in read(message)] == expected


def test_obstacles_that_are_refused() -> None:
    two = 2 * [camera_message(POINTS)]
    for fields, text in (
        ({"point_clouds": two}, "2 point clouds but 0 poses"),
        ({"point_clouds": two, "point_cloud_poses": 2 * [PoseMsg()], "point_cloud_resolutions": [0.1] * 3}, "resol"),
        ({"point_cloud_resolutions": [-0.1]}, "resolution"),
        ({"point_cloud_resolutions": [float("nan")]}, "resolution"),
        ({"point_clouds": [PointCloud2()]}, "0 points"),
    ):
        with pytest.raises(InvalidObstacleError, match=text) as error:
            read(cloud_obstacle(**fields))
        assert error.value.obstacle_id == "seen"
    cloud = camera_message(POINTS)
    cloud.header.frame_id = "base_link"
    assert read(cloud_obstacle(point_clouds=[cloud]))
    with pytest.raises(UnknownFrameError, match="base_link"):
        read(cloud_obstacle(point_clouds=[cloud]), frame="world")


def test_markers_of_a_cloud() -> None:
    scene = cloud_scene()
    markers = decomposition_markers(scene, decompose(scene), Time()).markers
    cubes = [marker for marker in markers if marker.type == Marker.CUBE_LIST]
    cloud, pose = scene.obstacles["seen"].placed_shapes()[0]
    assert isinstance(cloud, PointCloud)
    assert len(cubes) == 2
    assert cubes[0].scale.x == cubes[0].scale.y == cubes[0].scale.z == 0.03
    centres = np.array([(point.x, point.y, point.z) for point in cubes[0].points])
    np.testing.assert_allclose(centres, (cloud.voxels + 0.5) * 0.03)
    np.testing.assert_allclose(
        [cubes[0].pose.position.x, cubes[0].pose.position.y, cubes[0].pose.position.z], pose.position
    )
