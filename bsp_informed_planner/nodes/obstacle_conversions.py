"""Poses and obstacles between ROS messages and the library."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from bsp_informed_planner_msgs.msg import Obstacle as ObstacleMsg
from geometry_msgs.msg import Point as PointMsg
from geometry_msgs.msg import Pose as PoseMsg
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh as MeshMsg
from shape_msgs.msg import MeshTriangle, SolidPrimitive
from shape_msgs.msg import Plane as PlaneMsg

from bsp_informed_planner.errors import UnknownFrameError
from bsp_informed_planner.nodes.cloud_conversions import cloud_points, cloud_to_msg
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle
from bsp_informed_planner.scene.shapes import (
    CLOUD_RESOLUTION,
    Box,
    Cone,
    ConvexMesh,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)


def pose_from_msg(message: PoseMsg) -> Pose:
    """A pose; a quaternion of four zeros, the default of messages, is no rotation.

    Raises:
        ValueError: for values that are not finite, or a quaternion that is far from unit length.
    """
    position, rotation = message.position, message.orientation
    quaternion = (rotation.x, rotation.y, rotation.z, rotation.w)
    if not any(quaternion):
        quaternion = (0.0, 0.0, 0.0, 1.0)
    return Pose(np.array([position.x, position.y, position.z]), np.array(quaternion))


def pose_to_msg(pose: Pose) -> PoseMsg:
    """A pose as a message."""
    message = PoseMsg()
    message.position = point_to_msg(pose.position)
    rotation = message.orientation
    rotation.x, rotation.y, rotation.z, rotation.w = (float(value) for value in pose.quaternion)
    return message


def point_to_msg(point: FloatArray) -> PointMsg:
    """A point (3,) [m] as a message."""
    return PointMsg(x=float(point[0]), y=float(point[1]), z=float(point[2]))


def shapes_from_msg(message: ObstacleMsg, frame: str) -> tuple[tuple[Shape, Pose], ...]:
    """The shapes of an obstacle with their poses in it.

    Args:
        message: its operation is not looked at.
        frame: of the scene, in which point clouds must be that name a frame.

    Raises:
        ValueError: saying what is wrong.
        UnknownFrameError: if a point cloud is in another frame.
    """
    shapes: list[tuple[Shape, Pose]] = []

    def extend(kind: str, items: Sequence[object], poses: Sequence[PoseMsg], convert: Callable[..., Shape]) -> None:
        # One shape without a pose sits at the obstacle's own.
        if not poses and len(items) == 1:
            poses = [PoseMsg()]
        if len(items) != len(poses):
            raise ValueError(f"{len(items)} {kind} but {len(poses)} poses for them")
        for item, pose in zip(items, poses, strict=True):
            shapes.append((convert(item), pose_from_msg(pose)))

    extend("primitives", message.primitives, message.primitive_poses, _primitive_from_msg)
    extend("meshes", message.meshes, message.mesh_poses, _mesh_from_msg)
    extend("planes", message.planes, message.plane_poses, _plane_from_msg)
    resolutions = _resolutions(message)
    clouds = [
        point_cloud_from_msg(cloud, resolution, frame)
        for cloud, resolution in zip(message.point_clouds, resolutions, strict=True)
    ]
    extend("point clouds", clouds, message.point_cloud_poses, lambda cloud: cloud)
    return tuple(shapes)


_DIMENSIONS = {SolidPrimitive.BOX: 3, SolidPrimitive.SPHERE: 1, SolidPrimitive.CYLINDER: 2, SolidPrimitive.CONE: 2}


def _primitive_from_msg(message: SolidPrimitive) -> Shape:
    if message.type not in _DIMENSIONS:
        raise ValueError(f"unknown type of primitive {message.type}")
    if len(message.dimensions) != _DIMENSIONS[message.type]:
        raise ValueError(
            f"a primitive of type {message.type} has {_DIMENSIONS[message.type]} dimensions, not "
            f"{len(message.dimensions)}"
        )
    size = list(message.dimensions)
    if message.type == SolidPrimitive.BOX:
        return Box(np.array(size))
    if message.type == SolidPrimitive.SPHERE:
        return Sphere(size[SolidPrimitive.SPHERE_RADIUS])
    if message.type == SolidPrimitive.CYLINDER:
        return Cylinder(size[SolidPrimitive.CYLINDER_RADIUS], size[SolidPrimitive.CYLINDER_HEIGHT])
    return Cone(size[SolidPrimitive.CONE_RADIUS], size[SolidPrimitive.CONE_HEIGHT])


def _mesh_from_msg(message: MeshMsg) -> Mesh:
    vertices = np.array([(point.x, point.y, point.z) for point in message.vertices]).reshape(-1, 3)
    triangles = np.array([triangle.vertex_indices for triangle in message.triangles], dtype=np.int64).reshape(-1, 3)
    return Mesh(vertices, triangles)


def _plane_from_msg(message: PlaneMsg) -> HalfSpace:
    return HalfSpace(np.array(message.coef[:3]), float(message.coef[3]))


def _resolutions(message: ObstacleMsg) -> list[float]:
    """The edge of the voxels of each point cloud [m]."""
    given, count = list(message.point_cloud_resolutions), len(message.point_clouds)
    if len(given) <= 1:
        given = count * (given or [0.0])
    if len(given) != count:
        raise ValueError(f"{count} point clouds but {len(given)} resolutions for them")
    return [value or CLOUD_RESOLUTION for value in given]


def point_cloud_from_msg(message: PointCloud2, resolution: float = CLOUD_RESOLUTION, frame: str = "") -> PointCloud:
    """A point cloud; of the points in a voxel only the first, which changes nothing of the body.

    Args:
        message: see `cloud_points`.
        resolution: edge of the voxels [m].
        frame: of the scene, in which the cloud must be if it names a frame.

    Raises:
        UnknownFrameError: if it names another frame.
        ValueError: if it is no point cloud, or too large.
    """
    if message.header.frame_id not in ("", frame):
        raise UnknownFrameError(message.header.frame_id, [frame] if frame else [])
    return PointCloud(cloud_points(message), resolution).thinned()


def obstacle_to_msg(obstacle: Obstacle) -> ObstacleMsg:
    """An obstacle as a message with operation ADD."""
    message = ObstacleMsg(id=obstacle.id, operation=ObstacleMsg.ADD, pose=pose_to_msg(obstacle.pose))
    for shape, pose in obstacle.shapes:
        if isinstance(shape, (Mesh, ConvexMesh)):
            message.meshes.append(_mesh_to_msg(shape))
            message.mesh_poses.append(pose_to_msg(pose))
        elif isinstance(shape, HalfSpace):
            message.planes.append(PlaneMsg(coef=[*shape.normal.tolist(), shape.offset]))
            message.plane_poses.append(pose_to_msg(pose))
        elif isinstance(shape, PointCloud):
            message.point_clouds.append(cloud_to_msg(shape.points))
            message.point_cloud_poses.append(pose_to_msg(pose))
            message.point_cloud_resolutions.append(shape.resolution)
        else:
            message.primitives.append(_primitive_to_msg(shape))
            message.primitive_poses.append(pose_to_msg(pose))
    return message


def _primitive_to_msg(shape: Shape) -> SolidPrimitive:
    if isinstance(shape, Box):
        return SolidPrimitive(type=SolidPrimitive.BOX, dimensions=shape.size.tolist())
    if isinstance(shape, Sphere):
        return SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[shape.radius])
    assert isinstance(shape, (Cylinder, Cone))
    kind = SolidPrimitive.CYLINDER if isinstance(shape, Cylinder) else SolidPrimitive.CONE
    return SolidPrimitive(type=kind, dimensions=[shape.height, shape.radius])


def _mesh_to_msg(shape: Mesh | ConvexMesh) -> MeshMsg:
    if isinstance(shape, Mesh):
        triangles = shape.triangles
    else:
        from scipy.spatial import ConvexHull  # a hull's triangles are needed for this message only

        triangles = ConvexHull(shape.vertices).simplices
    return MeshMsg(
        vertices=[point_to_msg(vertex) for vertex in shape.vertices],
        triangles=[MeshTriangle(vertex_indices=np.asarray(row, dtype=np.uint32)) for row in triangles],
    )
