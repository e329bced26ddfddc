"""The scene as its owner keeps it: built up from messages of two sources."""

from __future__ import annotations

from dataclasses import replace

from bsp_informed_planner_msgs.msg import ObstacleScene
from sensor_msgs.msg import PointCloud2

from bsp_informed_planner.errors import InvalidObstacleError, SceneUnavailableError, UnknownFrameError
from bsp_informed_planner.nodes.cloud_conversions import measured_cloud
from bsp_informed_planner.nodes.scene_conversions import diff_from_msg, require_distinct
from bsp_informed_planner.nodes.size_limits import SizeLimits
from bsp_informed_planner.scene.diff import ObstacleOperation, SceneDiff, apply
from bsp_informed_planner.scene.polytopes import polytopes_of_obstacle
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds


class SceneKeeper:
    """Applies messages to the scene, one after the other. A message that raises has changed nothing.

    Args:
        frame: the planning frame.
        bounds: of scenes that give none.
        points_id: id of the obstacle that measured points become.
    """

    def __init__(self, frame: str, bounds: WorkspaceBounds, points_id: str) -> None:
        self._frame = frame
        self._bounds = bounds
        self._points_id = points_id
        self._measured: Obstacle | None = None
        self.scene: Scene | None = None

    def take_scene(self, message: ObstacleScene, limits: SizeLimits) -> Scene:
        """The scene after a whole one or a change of it. What was measured stays when a whole scene comes.

        Raises:
            UnknownFrameError: if it is not in the planning frame.
            SceneUnavailableError: for a change before any whole scene.
            SceneError: naming the obstacle and what is wrong with it.
        """
        frame = message.header.frame_id or self._frame
        if frame != self._frame:
            raise UnknownFrameError(frame, [self._frame])
        diff = diff_from_msg(message, frame, limits)
        if self.scene is None and message.is_diff:
            raise SceneUnavailableError(
                "a change arrived before any whole scene; publish one with is_diff = false first"
            )
        if not message.is_diff:
            ids = [obstacle.id for obstacle in message.obstacles]
            require_distinct(ids)
            if self._measured is not None and self._points_id not in ids:
                diff = replace(diff, operations=(*diff.operations, ObstacleOperation.add(self._measured)))
        scene = apply(self.scene or Scene.of([], diff.bounds or self._bounds, frame), diff)
        limits.check_scene(scene)
        # What has no volume must be refused here, before later changes build on it.
        for operation in diff.operations:
            if operation.id in scene.obstacles:
                polytopes_of_obstacle(scene.obstacles[operation.id], scene.bounds)
        for attachment in diff.attachments:
            if attachment.id in scene.attached:
                polytopes_of_obstacle(scene.attached[attachment.id].obstacle, scene.bounds)
        self.scene = scene
        return scene

    def take_points(self, message: PointCloud2, resolution: float, limits: SizeLimits) -> Scene:
        """The scene with the points that were measured last, in place of those before.

        Args:
            message: points outside of the bounds are left out.
            resolution: edge of the voxels [m].
            limits: of the scene.

        Raises:
            UnknownFrameError: if the cloud is not in the planning frame.
            InvalidObstacleError: if it is no point cloud, or too large.
        """
        if message.header.frame_id != self._frame:
            raise UnknownFrameError(
                message.header.frame_id, [self._frame], "obstacle_points, which are not transformed"
            )
        limits.check_points(message)
        before = self.scene or Scene.of([], self._bounds, self._frame)
        try:
            cloud = measured_cloud(message, resolution, before.bounds)
        except ValueError as error:
            raise InvalidObstacleError(self._points_id, str(error)) from error
        measured = None if cloud is None else Obstacle.of(self._points_id, cloud)
        operations: tuple[ObstacleOperation, ...] = ()
        if measured is not None:
            operations = (ObstacleOperation.add(measured),)
        elif self._points_id in before.obstacles:
            operations = (ObstacleOperation.remove(self._points_id),)
        scene = apply(before, SceneDiff(operations))
        limits.check_scene(scene)
        self._measured = measured
        self.scene = scene
        return scene
