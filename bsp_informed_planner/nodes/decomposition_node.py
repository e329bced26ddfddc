"""The decomposition node: owns the scene, and turns each revision of it into BSP keypoints."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable

import numpy as np
from bsp_informed_planner_msgs.msg import KeypointGraph, ObstacleScene, SceneStatus
from builtin_interfaces.msg import Time
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.decomposition.incremental import IncrementalDecomposer
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import BspPlannerError
from bsp_informed_planner.nodes.decomposition_parameters import DecompositionParameters
from bsp_informed_planner.nodes.error_codes import ErrorCode, error_code
from bsp_informed_planner.nodes.graph_conversions import graph_to_msg
from bsp_informed_planner.nodes.lifecycle import PlannerSuiteNode, run
from bsp_informed_planner.nodes.meter import Meter
from bsp_informed_planner.nodes.newest_first import NewestFirstWorker
from bsp_informed_planner.nodes.qos import LATCHED, LATCHED_UPDATES, NEWEST_POINTS, UPDATES
from bsp_informed_planner.nodes.scene_conversions import scene_to_msg
from bsp_informed_planner.nodes.scene_keeper import SceneKeeper
from bsp_informed_planner.scene.outside import outside_warning
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds
from bsp_informed_planner.visualization.markers import decomposition_markers

logger = logging.getLogger(__name__)

#: Head start of a scene before its graph [s]: plans need the one at once, and the other if at all.
SCENE_FIRST = 0.005
#: Between two lines of the log about scenes that are in force, and between two sets of markers [s].
LOG_PERIOD = 1.0
MARKER_PERIOD = 0.1
#: Attached bodies that `scene_status` names.
MOST_NAMED = 5


def contents_of(scene: Scene) -> str:
    """What is in a scene, e.g. "1 obstacle; attached: 'cup' to 'tool0'": who attaches sees what has arrived."""
    count = len(scene.obstacles)
    held = [f"'{body.id}' to '{body.link}'" for body in scene.attached.values()]
    more = f" and {len(held) - MOST_NAMED} more" if held[MOST_NAMED:] else ""
    attached = f"; {len(held)} attached: {', '.join(held[:MOST_NAMED])}{more}" if held else ""
    return f"{count} obstacle{'' if count == 1 else 's'}{attached}"


def _superseding(dropped: tuple[Scene, Time], newer: tuple[Scene, Time]) -> tuple[Scene, Time]:
    """The newer scene with the later stamp of the two, so that who sent the dropped one learns that it has been taken.

    Messages of different publishers come in any order.
    """
    stamp = max(dropped[1], newer[1], key=lambda stamp: (stamp.sec, stamp.nanosec))
    return newer[0], stamp


class DecompositionNode(PlannerSuiteNode):
    """Makes `scene` and `keypoint_graph` of `obstacle_scene` and `obstacle_points`.

    It publishes `scene_status` and `decomposition_markers` too; they are latched. The `keypoint_graph` of a
    revision follows its `scene`; a message that is refused changes neither, and `scene_status` says why. What it says
    the other nodes are told first, as `scene_verdict`: who reads a status may count on it that they know. Every
    message counts, in order, but when scenes come faster than they are decomposed, only the newest is: revisions are
    skipped, never half published.

    A cloud on `obstacle_points` replaces the one before, and stays when a whole scene arrives. While the last message
    of one of the two sources is refused, so is the scene, whatever the other source says.
    """

    def __init__(self, **options: object) -> None:
        super().__init__("decomposition_node", **options)

    def setup(self) -> None:
        self._parameter_set = self.follow_parameters(DecompositionParameters)
        bounds = WorkspaceBounds(np.array(self._settings.workspace_min), np.array(self._settings.workspace_max))
        self._keeper = SceneKeeper(self._settings.frame_id, bounds, self._settings.points_id)
        self._decomposer = IncrementalDecomposer(
            DecompositionOptions(dimension=self._settings.dimension, grid=self._settings.grid)
        )
        self._epoch = time.time_ns()
        # The scene in force, whose graph is published; the worker may still be at the one that the keeper has.
        self._scene: Scene | None = None
        # Of each source whose last message was refused, the code and the reason.
        self._refusals: dict[str, tuple[ErrorCode, str]] = {}
        self._refused = 0
        # So that no verdict is published after a newer one.
        self._telling = threading.Lock()
        # Of the last message that had one: those without do not make a sender's stamp unheard of.
        self._stamp = Time()
        self._received = Meter()
        self._decomposed = Meter()
        # Messages that both subscriptions below deliver, since their publisher is latched.
        self._seen: deque[tuple[int, int]] = deque(maxlen=128)
        self._scene_publisher = self._latched(ObstacleScene, "scene")
        self._graph_publisher = self._latched(KeypointGraph, "keypoint_graph")
        self._verdict_publisher = self._latched(SceneStatus, "scene_verdict")
        self._status_publisher = self._latched(SceneStatus, "scene_status")
        self._marker_publisher = self._latched(MarkerArray, "decomposition_markers")
        # Whoever knows a scene of an earlier epoch is told that it is no longer in force.
        self._publish_status(
            ErrorCode.COLLISION_CHECKING_UNAVAILABLE, "no scene yet: publish one on obstacle_scene", Time()
        )
        self._markers = NewestFirstWorker(self._publish_markers, "markers", pause=MARKER_PERIOD)
        self.release_with(self._markers.stop)
        self._worker = NewestFirstWorker(self._decompose, "decompose", merge=_superseding)
        self.release_with(self._worker.stop)
        # A volatile subscription hears every publisher, but of a latched one not what it said before; the other does.
        sources = self.own_thread("scenes")
        for profile in (UPDATES, LATCHED_UPDATES):
            sources.subscribe(ObstacleScene, "obstacle_scene", self._on_scene, profile, raw=True)
        sources.subscribe(PointCloud2, "obstacle_points", self._on_points, NEWEST_POINTS)

    @property
    def _settings(self) -> DecompositionParameters:
        return self._parameter_set.values

    def _latched(self, kind: type, topic: str) -> Publisher:
        publisher = self.create_publisher(kind, topic, LATCHED)
        self.release_with(self.destroy_publisher, publisher)
        return publisher

    def diagnostic_values(self) -> dict[str, object]:
        scene = self._scene
        return {
            "scene_epoch": self._epoch,
            "scene_revision": 0 if scene is None else scene.revision,
            "obstacles": 0 if scene is None else len(scene.obstacles),
            "refused_messages": self._refused,
            "superseded_scenes": self._worker.dropped,
            **self._received.values("messages"),
            **self._decomposed.values("decompositions"),
        }

    def _on_scene(self, data: bytes, info: dict[str, int]) -> None:
        key = (info["source_timestamp"], info["publication_sequence_number"])
        if key in self._seen:
            return
        self._seen.append(key)
        message = deserialize_message(data, ObstacleScene)
        self._take(
            "obstacle_scene", lambda: self._keeper.take_scene(message, self._settings.limits), message.header.stamp
        )

    def _on_points(self, message: PointCloud2, _: object) -> None:
        resolution = self._settings.points_resolution
        self._take(
            "obstacle_points",
            lambda: self._keeper.take_points(message, resolution, self._settings.limits),
            message.header.stamp,
        )

    def _take(self, source: str, change: Callable[[], Scene], stamp: Time) -> None:
        """Make the next scene of a message, and hand it to the worker; or refuse it."""
        begin = time.monotonic()
        self._stamp = stamp = stamp if stamp != Time() else self._stamp
        try:
            self.require_active()
            scene = change()
        except Exception as error:  # noqa: BLE001 -- whatever a message holds, the node that owns the scene goes on
            self._refuse(source, error, stamp)
            return
        self._refusals.pop(source, None)
        self._received.count(time.monotonic() - begin)
        self._worker.submit((scene, stamp))

    def _decompose(self, item: tuple[Scene, Time]) -> None:
        """In the worker's thread: decompose a scene and put it in force."""
        scene, stamp = item
        begin = time.monotonic()
        try:
            decomposition = self._decomposer.decompose(scene)
            whole = scene_to_msg(scene)
        except Exception as error:  # noqa: BLE001 -- the worker must go on
            self._refuse("decomposition", error, stamp)
            return
        whole.header.stamp = stamp
        whole.epoch = self._epoch
        # Before its status: who has read that may count on it that the others have the scene.
        self._scene_publisher.publish(whole)
        warning = outside_warning(scene)
        if warning:
            self.get_logger().warning(warning)
        said = contents_of(scene) + (f"; warning: {warning}" if warning else "")
        with self._telling:
            self._refusals.pop("decomposition", None)
            self._scene = scene
            self._publish_status(*self._verdict(said), stamp)
        time.sleep(SCENE_FIRST)
        try:
            graph = graph_to_msg(decomposition, self._settings.publish_edges)
            graph.header.stamp, graph.scene_epoch = stamp, self._epoch
            self._graph_publisher.publish(graph)
        except Exception as error:  # noqa: BLE001 -- the worker must go on; the other nodes decompose the scene themselves
            self.note_error(f"keypoint_graph {scene.revision}: {error}")
        self._decomposed.count(time.monotonic() - begin)
        self.get_logger().info(
            f"scene {scene.revision}: {len(scene.obstacles)} obstacles, {decomposition.cell_count} free cells, "
            f"{decomposition.portal_count} portals, {decomposition.candidate_count} keypoint candidates in "
            f"{1e3 * decomposition.timings.total_seconds:.1f} ms",
            throttle_duration_sec=LOG_PERIOD,
        )
        if self._settings.publish_markers:
            self._markers.submit((scene, decomposition, stamp))

    def _publish_markers(self, item: tuple[Scene, Decomposition, Time]) -> None:
        """In a thread of their own, and not for every scene of a fast source: markers are for people."""
        try:
            self._marker_publisher.publish(decomposition_markers(*item))
        except Exception as error:  # noqa: BLE001 -- the worker must go on
            self.note_error(f"decomposition_markers: {error}")

    def _verdict(self, good: str) -> tuple[ErrorCode, str]:
        """Success with a text, or why a source is refused."""
        return next(iter(list(self._refusals.values())), (ErrorCode.SUCCESS, good))

    def _refuse(self, source: str, error: Exception, stamp: Time) -> None:
        self._refused += 1
        self.note_error(f"{source} refused: {error}")
        if not isinstance(error, BspPlannerError):
            logger.error("while reading a scene", exc_info=error)
        with self._telling:
            self._refusals[source] = (error_code(error), str(error))
            self._publish_status(error_code(error), str(error), stamp)

    def _publish_status(self, code: ErrorCode, text: str, stamp: Time) -> None:
        revision = 0 if self._scene is None else self._scene.revision
        status = SceneStatus(epoch=self._epoch, revision=revision, error_code=int(code), message=text)
        status.header.stamp = stamp
        status.header.frame_id = self._settings.frame_id
        # One after the other: within one message to many, a client may be served, and ask, before a node is.
        self._verdict_publisher.publish(status)
        self._status_publisher.publish(status)


def main(args: list[str] | None = None) -> None:
    """Entry point of `decomposition_node`."""
    run(DecompositionNode, args)


if __name__ == "__main__":
    main()
