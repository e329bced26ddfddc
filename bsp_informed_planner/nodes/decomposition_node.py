"""The decomposition node: owns the scene, and turns each revision of it into BSP keypoints."""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from bsp_informed_planner_msgs.msg import KeypointGraph, ObstacleScene, SceneStatus
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from visualization_msgs.msg import MarkerArray

from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import BspPlannerError, SceneUnavailableError, UnknownFrameError
from bsp_informed_planner.nodes.error_codes import ErrorCode, error_code
from bsp_informed_planner.nodes.graph_conversions import graph_to_msg
from bsp_informed_planner.nodes.lifecycle import PlannerSuiteNode, run
from bsp_informed_planner.nodes.parameters import declare, parameter
from bsp_informed_planner.nodes.qos import LATCHED, LATCHED_UPDATES, UPDATES
from bsp_informed_planner.nodes.scene_conversions import bounds_from_msg, diff_from_msg, scene_to_msg
from bsp_informed_planner.scene.diff import ObstacleOperation, SceneDiff, apply
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
    publish_edges: bool = parameter(False, "List the edges in keypoint_graph, though the portals imply them.")
    publish_markers: bool = parameter(True, "Publish decomposition_markers for RViz and Foxglove.")


class DecompositionNode(PlannerSuiteNode):
    """Subscribes `obstacle_scene`; publishes `scene`, `keypoint_graph`, `scene_status` and `decomposition_markers`.

    The four are latched. `scene` and `keypoint_graph` of a revision are published together; a message that is refused
    changes neither, and `scene_status` says why.
    """

    def __init__(self, **options: object) -> None:
        super().__init__("decomposition_node", **options)

    def setup(self) -> None:
        self._parameters = declare(self, DecompositionParameters)
        self._bounds = WorkspaceBounds(
            np.array(self._parameters.workspace_min), np.array(self._parameters.workspace_max)
        )
        self._options = DecompositionOptions(dimension=self._parameters.dimension, grid=self._parameters.grid)
        self._scene: Scene | None = None
        self._refused = 0
        self._seconds = 0.0
        # Messages that both subscriptions below deliver, since their publisher is latched.
        self._seen: deque[tuple[int, int]] = deque(maxlen=128)
        self._scene_publisher = self.create_publisher(ObstacleScene, "scene", LATCHED)
        self._graph_publisher = self.create_publisher(KeypointGraph, "keypoint_graph", LATCHED)
        self._status_publisher = self.create_publisher(SceneStatus, "scene_status", LATCHED)
        self._marker_publisher = self.create_publisher(MarkerArray, "decomposition_markers", LATCHED)
        # A volatile subscription hears every publisher, but of a latched one not what it said before; the other does.
        group = MutuallyExclusiveCallbackGroup()
        self._scene_subscriptions = [
            self.create_subscription(ObstacleScene, "obstacle_scene", self._on_scene, profile, callback_group=group)
            for profile in (UPDATES, LATCHED_UPDATES)
        ]

    def teardown(self) -> None:
        for subscription in self._scene_subscriptions:
            self.destroy_subscription(subscription)
        for publisher in (
            self._scene_publisher,
            self._graph_publisher,
            self._status_publisher,
            self._marker_publisher,
        ):
            self.destroy_publisher(publisher)

    def diagnostic_values(self) -> dict[str, object]:
        scene = self._scene
        return {
            "scene_revision": 0 if scene is None else scene.revision,
            "obstacles": 0 if scene is None else len(scene.obstacles),
            "refused_messages": self._refused,
            "decomposition_seconds": round(self._seconds, 6),
        }

    def _on_scene(self, message: ObstacleScene, info: dict[str, int]) -> None:
        key = (info["source_timestamp"], info["publication_sequence_number"])
        if key in self._seen:
            return
        self._seen.append(key)
        try:
            scene = self._next_scene(message)
            decomposition = decompose(scene, self._options)
        except Exception as error:
            # Whatever a message holds, the node that owns the scene goes on, and says so.
            self._refused += 1
            self.note_error(f"scene refused: {error}")
            if not isinstance(error, BspPlannerError):
                logger.exception("while reading a scene")
            self._publish_status(error_code(error), str(error))
            return
        self._scene = scene
        self._seconds = decomposition.timings.total_seconds
        stamp = message.header.stamp
        whole = scene_to_msg(scene)
        whole.header.stamp = stamp
        graph = graph_to_msg(decomposition, self._parameters.publish_edges)
        graph.header.stamp = stamp
        # The graph first: whoever waits for the scene of a revision finds its graph there already.
        self._graph_publisher.publish(graph)
        self._scene_publisher.publish(whole)
        self._publish_status(ErrorCode.SUCCESS, f"{len(scene.obstacles)} obstacles")
        self.get_logger().info(
            f"scene {scene.revision}: {len(scene.obstacles)} obstacles, {decomposition.cell_count} free cells, "
            f"{decomposition.portal_count} portals, {len(decomposition.candidates)} keypoint candidates in "
            f"{1e3 * self._seconds:.1f} ms"
        )
        if self._parameters.publish_markers:
            self._marker_publisher.publish(decomposition_markers(scene, decomposition, stamp))

    def _next_scene(self, message: ObstacleScene) -> Scene:
        frame = message.header.frame_id or self._parameters.frame_id
        if frame != self._parameters.frame_id:
            raise UnknownFrameError(frame, [self._parameters.frame_id])
        bounds = bounds_from_msg(message)
        diff = replace(diff_from_msg(message, frame), bounds=bounds)
        if self._scene is None and message.is_diff:
            raise SceneUnavailableError(
                "a change arrived before any whole scene; publish one with is_diff = false first"
            )
        before = self._scene or Scene.of([], bounds or self._bounds, frame)
        if not message.is_diff:
            diff = SceneDiff((ObstacleOperation.remove(), *diff.operations), bounds)
        return apply(before, diff)

    def _publish_status(self, code: ErrorCode, text: str) -> None:
        revision = 0 if self._scene is None else self._scene.revision
        status = SceneStatus(revision=revision, error_code=int(code), message=text)
        status.header.stamp = self.get_clock().now().to_msg()
        status.header.frame_id = self._parameters.frame_id
        self._status_publisher.publish(status)


def main(args: list[str] | None = None) -> None:
    """Entry point of `decomposition_node`."""
    run(DecompositionNode, args)


if __name__ == "__main__":
    main()
