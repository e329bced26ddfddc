"""Scenes between ROS messages and the library."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from bsp_informed_planner_msgs.msg import Obstacle as ObstacleMsg
from bsp_informed_planner_msgs.msg import ObstacleScene
from geometry_msgs.msg import Point as PointMsg
from geometry_msgs.msg import Pose as PoseMsg
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh as MeshMsg
from shape_msgs.msg import MeshTriangle, SolidPrimitive
from shape_msgs.msg import Plane as PlaneMsg

from bsp_informed_planner.errors import InvalidObstacleError, UnknownFrameError
from bsp_informed_planner.nodes.cloud_conversions import cloud_points, cloud_to_msg
from bsp_informed_planner.scene.diff import ObstacleOperation, OperationKind, SceneDiff
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
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

#: Largest message that is read: beyond it, a mistake is likelier than an intent.
MAX_OBSTACLES = 10_000
MAX_MESH_TRIANGLES = 200_000

_OPERATIONS = {
    ObstacleMsg.ADD: OperationKind.ADD,
    ObstacleMsg.REMOVE: OperationKind.REMOVE,
    ObstacleMsg.APPEND: OperationKind.APPEND,
    ObstacleMsg.MOVE: OperationKind.MOVE,
}


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


def bounds_from_msg(message: ObstacleScene) -> WorkspaceBounds | None:
    """Workspace bounds; None if the message leaves them open.

    Raises:
        InvalidWorkspaceError: if they are not bounds.
    """
    lower, upper = message.workspace_min, message.workspace_max
    values = (lower.x, lower.y, lower.z), (upper.x, upper.y, upper.z)
    if not any(values[0]) and not any(values[1]):
        return None
    return WorkspaceBounds(np.array(values[0]), np.array(values[1]))


def diff_from_msg(message: ObstacleScene, frame: str = "") -> SceneDiff:
    """The operations of a scene message.

    Args:
        message: whole or a change.
        frame: the scene's, where the message names none; known to the reader.

    Raises:
        InvalidObstacleError: naming the obstacle and what is wrong with it.
        UnknownFrameError: if a point cloud is in another frame than the scene.
    """
    if len(message.obstacles) > MAX_OBSTACLES:
        raise InvalidObstacleError("*", f"{len(message.obstacles)} obstacles: at most {MAX_OBSTACLES} are read")
    return SceneDiff(
        tuple(_operation_from_msg(obstacle, message.header.frame_id or frame) for obstacle in message.obstacles)
    )


def _operation_from_msg(message: ObstacleMsg, frame: str) -> ObstacleOperation:
    # `byte` fields arrive as bytes of length one.
    code = message.operation if isinstance(message.operation, bytes) else bytes([message.operation])
    operation = _OPERATIONS.get(code)
    if operation is None:
        raise InvalidObstacleError(message.id, f"unknown operation {code!r}")
    try:
        pose = pose_from_msg(message.pose)
        if operation is OperationKind.REMOVE:
            return ObstacleOperation.remove(message.id)
        if operation is OperationKind.MOVE:
            return ObstacleOperation.move(message.id, pose)
        shapes = _shapes_from_msg(message, frame)
    except ValueError as error:
        raise InvalidObstacleError(message.id, str(error)) from error
    obstacle = Obstacle(message.id, shapes, pose)
    return ObstacleOperation.add(obstacle) if operation is OperationKind.ADD else ObstacleOperation.append(obstacle)


def _shapes_from_msg(message: ObstacleMsg, frame: str) -> tuple[tuple[Shape, Pose], ...]:
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
    if len(message.triangles) > MAX_MESH_TRIANGLES:
        raise ValueError(f"{len(message.triangles)} triangles: at most {MAX_MESH_TRIANGLES} are read")
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


def scene_to_msg(scene: Scene) -> ObstacleScene:
    """A whole scene as a message; its stamp is left to the caller."""
    message = ObstacleScene()
    message.header.frame_id = scene.frame
    message.workspace_min = point_to_msg(scene.bounds.lower)
    message.workspace_max = point_to_msg(scene.bounds.upper)
    message.revision = scene.revision
    message.obstacles = [obstacle_to_msg(obstacle) for obstacle in scene.obstacles.values()]
    return message


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


def scene_from_msg(message: ObstacleScene) -> Scene:
    """A whole scene, as the decomposition node publishes it on `scene`.

    Raises:
        SceneError: if the message is a diff, or an obstacle of it is not usable.
    """
    bounds = bounds_from_msg(message)
    if message.is_diff or bounds is None:
        raise InvalidObstacleError("*", "a whole scene with its bounds was expected")
    obstacles = []
    for operation in diff_from_msg(message).operations:
        if operation.obstacle is None:
            raise InvalidObstacleError(operation.id, "a whole scene only adds obstacles")
        obstacles.append(operation.obstacle)
    return Scene.of(obstacles, bounds, message.header.frame_id, message.revision)
