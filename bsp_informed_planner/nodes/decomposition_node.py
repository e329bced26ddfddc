"""The decomposition node: owns the scene, and turns each revision of it into BSP keypoints."""

from __future__ import annotations

import logging
from collections import Counter, deque
from dataclasses import dataclass, replace

import numpy as np
from bsp_informed_planner_msgs.msg import KeypointGraph, ObstacleScene, SceneStatus
from builtin_interfaces.msg import Time
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.publisher import Publisher
from visualization_msgs.msg import MarkerArray

from bsp_informed_planner.decomposition.incremental import IncrementalDecomposer
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import (
    BspPlannerError,
    InvalidObstacleError,
    SceneUnavailableError,
    UnknownFrameError,
)
from bsp_informed_planner.nodes.error_codes import ErrorCode, error_code
from bsp_informed_planner.nodes.graph_conversions import graph_to_msg
from bsp_informed_planner.nodes.lifecycle import PlannerSuiteNode, run
from bsp_informed_planner.nodes.newest_first import NewestFirstWorker
from bsp_informed_planner.nodes.parameters import declare, parameter
from bsp_informed_planner.nodes.qos import LATCHED, LATCHED_UPDATES, UPDATES
from bsp_informed_planner.nodes.scene_conversions import bounds_from_msg, diff_from_msg, scene_to_msg
from bsp_informed_planner.scene.diff import ObstacleOperation, SceneDiff, apply
from bsp_informed_planner.scene.outside import outside_warning
from bsp_informed_planner.scene.polytopes import polytopes_of_obstacle
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds
from bsp_informed_planner.visualization.markers import decomposition_markers

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class DecompositionParameters:
    """Parameters of the decomposition node."""

    frame_id: str = parameter("world", "Planning frame: scenes must be given in it. The root link of the robot.")
    dimension: int = parameter(3, "Dimension of the workspace: 3, or 2 for a robot in the plane.", minimum=2, maximum=3)
    workspace_min: tuple[float, ...] = parameter(
        (-1.0, -1.0, -0.5), "Lower bounds of the space decomposed, where a scene gives none [m]."
    )
    workspace_max: tuple[float, ...] = parameter(
        (1.0, 1.0, 1.5), "Upper bounds of the space decomposed, where a scene gives none [m]."
    )
    grid: int = parameter(3, "Keypoint candidates along each side of a portal; odd.", minimum=1, maximum=15)
    max_bodies: int = parameter(1000, "Most shapes of a scene, all obstacles together.", minimum=1, maximum=100000)
    publish_edges: bool = parameter(False, "List the edges in keypoint_graph, though the portals imply them.")
    publish_markers: bool = parameter(True, "Publish decomposition_markers for RViz and Foxglove.")


class DecompositionNode(PlannerSuiteNode):
    """Subscribes `obstacle_scene`; publishes `scene`, `keypoint_graph`, `scene_status` and `decomposition_markers`.

    The four are latched. `scene` and `keypoint_graph` of a revision are published together; a message that is refused
    changes neither, and `scene_status` says why. Every message counts, in order, but when scenes come faster than they
    are decomposed, only the newest is: revisions are skipped, never half published.
    """

    def __init__(self, **options: object) -> None:
        super().__init__("decomposition_node", **options)

    def setup(self) -> None:
        self._settings = declare(self, DecompositionParameters)
        self._bounds = WorkspaceBounds(np.array(self._settings.workspace_min), np.array(self._settings.workspace_max))
        self._decomposer = IncrementalDecomposer(
            DecompositionOptions(dimension=self._settings.dimension, grid=self._settings.grid)
        )
        # The scene in force, whose graph is published, and the newest one, which the worker may still be at.
        self._scene: Scene | None = None
        self._newest: Scene | None = None
        self._refused = 0
        self._seconds = 0.0
        # Messages that both subscriptions below deliver, since their publisher is latched.
        self._seen: deque[tuple[int, int]] = deque(maxlen=128)
        self._scene_publisher = self._latched(ObstacleScene, "scene")
        self._graph_publisher = self._latched(KeypointGraph, "keypoint_graph")
        self._status_publisher = self._latched(SceneStatus, "scene_status")
        self._marker_publisher = self._latched(MarkerArray, "decomposition_markers")
        self._worker = NewestFirstWorker(self._decompose, "decompose")
        self.release_with(self._worker.stop)
        # A volatile subscription hears every publisher, but of a latched one not what it said before; the other does.
        group = MutuallyExclusiveCallbackGroup()
        for profile in (UPDATES, LATCHED_UPDATES):
            subscription = self.create_subscription(
                ObstacleScene, "obstacle_scene", self._on_scene, profile, callback_group=group
            )
            self.release_with(self.destroy_subscription, subscription)

    def _latched(self, kind: type, topic: str) -> Publisher:
        publisher = self.create_publisher(kind, topic, LATCHED)
        self.release_with(self.destroy_publisher, publisher)
        return publisher

    def diagnostic_values(self) -> dict[str, object]:
        scene = self._scene
        return {
            "scene_revision": 0 if scene is None else scene.revision,
            "obstacles": 0 if scene is None else len(scene.obstacles),
            "refused_messages": self._refused,
            "superseded_scenes": self._worker.dropped,
            "decomposition_seconds": round(self._seconds, 6),
        }

    def _on_scene(self, message: ObstacleScene, info: dict[str, int]) -> None:
        key = (info["source_timestamp"], info["publication_sequence_number"])
        if key in self._seen:
            return
        self._seen.append(key)
        try:
            self.require_active()
            self._newest = self._next_scene(message)
        except Exception as error:  # noqa: BLE001 -- whatever a message holds, the node that owns the scene goes on
            self._refuse(error, message.header.stamp)
            return
        self._worker.submit((self._newest, message.header.stamp))

    def _next_scene(self, message: ObstacleScene) -> Scene:
        """The scene after a message; all of its obstacles are solid bodies."""
        frame = message.header.frame_id or self._settings.frame_id
        if frame != self._settings.frame_id:
            raise UnknownFrameError(frame, [self._settings.frame_id])
        bounds = bounds_from_msg(message)
        diff = replace(diff_from_msg(message, frame), bounds=bounds)
        if self._newest is None and message.is_diff:
            raise SceneUnavailableError(
                "a change arrived before any whole scene; publish one with is_diff = false first"
            )
        before = self._newest or Scene.of([], bounds or self._bounds, frame)
        if not message.is_diff:
            _require_distinct([operation.id for operation in diff.operations])
            diff = SceneDiff((ObstacleOperation.remove(), *diff.operations), bounds)
        scene = apply(before, diff)
        bodies = sum(len(obstacle.shapes) for obstacle in scene.obstacles.values())
        if bodies > self._settings.max_bodies:
            raise InvalidObstacleError(
                "*",
                f"the scene would hold {bodies} bodies: at most {self._settings.max_bodies} (parameter `max_bodies`)",
            )
        # What has no volume must be refused here, before later changes build on it.
        for obstacle_id in {operation.id for operation in diff.operations} & set(scene.obstacles):
            polytopes_of_obstacle(scene.obstacles[obstacle_id], scene.bounds)
        return scene

    def _decompose(self, item: tuple[Scene, Time]) -> None:
        """In the worker's thread: decompose a scene and put it in force."""
        scene, stamp = item
        try:
            decomposition = self._decomposer.decompose(scene)
            whole = scene_to_msg(scene)
            graph = graph_to_msg(decomposition, self._settings.publish_edges)
        except Exception as error:  # noqa: BLE001 -- the worker must go on
            self._refuse(error, stamp)
            return
        whole.header.stamp = graph.header.stamp = stamp
        self._scene = scene
        self._seconds = decomposition.timings.total_seconds
        # The graph first: whoever waits for the scene of a revision finds its graph there already.
        self._graph_publisher.publish(graph)
        self._scene_publisher.publish(whole)
        warning = outside_warning(scene)
        if warning:
            self.get_logger().warning(warning)
        said = f"{len(scene.obstacles)} obstacles" + (f"; warning: {warning}" if warning else "")
        self._publish_status(ErrorCode.SUCCESS, said, stamp)
        self.get_logger().info(
            f"scene {scene.revision}: {len(scene.obstacles)} obstacles, {decomposition.cell_count} free cells, "
            f"{decomposition.portal_count} portals, {decomposition.candidate_count} keypoint candidates in "
            f"{1e3 * self._seconds:.1f} ms"
        )
        if self._settings.publish_markers:
            self._marker_publisher.publish(decomposition_markers(scene, decomposition, stamp))

    def _refuse(self, error: Exception, stamp: Time) -> None:
        self._refused += 1
        self.note_error(f"scene refused: {error}")
        if not isinstance(error, BspPlannerError):
            logger.error("while reading a scene", exc_info=error)
        self._publish_status(error_code(error), str(error), stamp)

    def _publish_status(self, code: ErrorCode, text: str, stamp: Time) -> None:
        revision = 0 if self._scene is None else self._scene.revision
        status = SceneStatus(revision=revision, error_code=int(code), message=text)
        status.header.stamp = stamp
        status.header.frame_id = self._settings.frame_id
        self._status_publisher.publish(status)


def _require_distinct(ids: list[str]) -> None:
    for obstacle_id, count in Counter(ids).items():
        if count > 1:
            raise InvalidObstacleError(obstacle_id, f"{count} obstacles of a whole scene have this id")


def main(args: list[str] | None = None) -> None:
    """Entry point of `decomposition_node`."""
    run(DecompositionNode, args)


if __name__ == "__main__":
    main()
