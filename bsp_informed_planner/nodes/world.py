"""What a node knows of the world: the robot, the scene in force, and its decomposition, all of one revision."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from bsp_informed_planner_msgs.msg import KeypointGraph, ObstacleScene, SceneStatus
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle import LifecycleNode

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.errors import (
    EmptySceneError,
    PlanningCancelledError,
    RobotDescriptionError,
    SceneRefusedError,
    SceneRevisionError,
    SceneUnavailableError,
    UnknownFrameError,
)
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.graph_conversions import decomposition_from_msg
from bsp_informed_planner.nodes.plan_jobs import CANCEL_PERIOD
from bsp_informed_planner.nodes.qos import LATCHED
from bsp_informed_planner.nodes.scene_conversions import scene_from_msg
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class World:
    """A consistent snapshot, safe to use from any thread.

    Attributes:
        robot: the robot.
        planner: for this robot and scene; holds the decomposition.
    """

    robot: Robot
    planner: Planner

    @property
    def scene(self) -> Scene:
        return self.planner.scene

    @property
    def revision(self) -> int:
        return self.planner.scene.revision


class WorldTracker:
    """Follows `scene`, `keypoint_graph` and `scene_status`.

    Args:
        node: subscribes.
        allow_empty_scene: whether `current` accepts a scene without obstacles; may be changed.
    """

    def __init__(self, node: LifecycleNode, allow_empty_scene: bool = False) -> None:
        self._node = node
        self.allow_empty_scene = allow_empty_scene
        self._lock = threading.Condition()
        self._robot: Robot | None = None
        self._scene: Scene | None = None
        self._decomposition: tuple[int, Decomposition] | None = None
        # Two reasons not to trust the scene at hand: its owner refused a newer one, or this node could not read it.
        self._refusal = ""
        self._unreadable = ""
        self._world: World | None = None
        group = MutuallyExclusiveCallbackGroup()
        self._subscriptions = [
            node.create_subscription(kind, topic, callback, LATCHED, callback_group=group)
            for kind, topic, callback in (
                (ObstacleScene, "scene", self._on_scene),
                (KeypointGraph, "keypoint_graph", self._on_graph),
                (SceneStatus, "scene_status", self._on_status),
            )
        ]

    def close(self) -> None:
        """Stop following."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def set_robot(self, robot: Robot) -> None:
        """Plan for this robot from now on."""
        with self._lock:
            self._robot = robot
            self._world = None

    @property
    def robot(self) -> Robot:
        """The robot.

        Raises:
            RobotDescriptionError: if none is known yet.
        """
        if self._robot is None:
            raise RobotDescriptionError("no robot yet: set parameter `robot_description` or publish robot_description")
        return self._robot

    @property
    def revision(self) -> int:
        """Of the scene in force; 0 without one."""
        return 0 if self._scene is None else self._scene.revision

    def current(
        self, revision: int = 0, wait_seconds: float = 0.0, cancelled: Callable[[], bool] | None = None
    ) -> World:
        """The world now.

        Args:
            revision: the scene revision that it must have; 0: any.
            wait_seconds: how long to wait for a revision that is to come [s]; not for callbacks of the executor.
            cancelled: asked while waiting.

        Raises:
            RobotDescriptionError: no robot is known yet.
            SceneUnavailableError: no scene has arrived yet.
            SceneRefusedError: the newest scene message was refused.
            SceneRevisionError: another revision is in force.
            EmptySceneError: the scene has no obstacles.
            UnknownFrameError: the scene is not given in the root frame of the robot.
            PlanningCancelledError: cancelled while waiting.
        """
        if revision > 0:
            self._wait_for(revision, wait_seconds, cancelled)
        with self._lock:
            robot = self.robot
            if self._refusal or self._unreadable:
                raise SceneRefusedError(self._refusal or self._unreadable)
            scene = self._scene
            if scene is None:
                raise SceneUnavailableError("no scene yet: publish one on obstacle_scene")
            if revision not in (0, scene.revision):
                raise SceneRevisionError(revision, scene.revision)
            if scene.is_empty and not self.allow_empty_scene:
                raise EmptySceneError(
                    f"scene {scene.revision} holds no obstacle; set parameter `allow_empty_scene` to plan in it"
                )
            if scene.frame != robot.root_frame:
                raise UnknownFrameError(scene.frame, [robot.root_frame], "the scene, for this robot")
            if self._world is not None:
                return self._world
            decomposition: Decomposition | None = None
            if self._decomposition is not None and self._decomposition[0] == scene.revision:
                decomposition = self._decomposition[1]
        # Outside of the lock: a large scene takes a while, in which the subscriptions must go on.
        world = World(robot, Planner(robot, scene, decomposition=decomposition))
        with self._lock:
            if self._scene is scene and self._robot is robot:
                self._world = world
        return world

    def _wait_for(self, revision: int, seconds: float, cancelled: Callable[[], bool] | None) -> None:
        end = time.monotonic() + seconds
        with self._lock:
            while self.revision < revision and not (self._refusal or self._unreadable):
                remaining = end - time.monotonic()
                if remaining <= 0.0:
                    return
                self._lock.wait(min(remaining, CANCEL_PERIOD))
                if cancelled is not None and cancelled():
                    raise PlanningCancelledError

    def _on_scene(self, message: ObstacleScene) -> None:
        try:
            scene = scene_from_msg(message)
        except Exception as error:  # noqa: BLE001 -- a message must not end the node
            self._distrust(f"scene {message.revision}: {error}")
            return
        with self._lock:
            # A decomposition node that was restarted counts from one again: what it says last is in force.
            self._scene = scene
            self._unreadable = ""
            self._world = None
            self._lock.notify_all()

    def _distrust(self, reason: str) -> None:
        self._node.get_logger().error(reason)
        with self._lock:
            self._unreadable = reason
            self._lock.notify_all()

    def _on_graph(self, message: KeypointGraph) -> None:
        try:
            decomposition = decomposition_from_msg(message)
        except Exception as error:  # noqa: BLE001 -- a message must not end the node
            # The scene can still be decomposed here.
            self._node.get_logger().error(f"keypoint_graph {message.scene_revision}: {error}")
            return
        with self._lock:
            self._decomposition = (message.scene_revision, decomposition)
            if self._world is not None and self._world.revision == message.scene_revision:
                self._world = None

    def _on_status(self, message: SceneStatus) -> None:
        with self._lock:
            self._lock.notify_all()
            self._refusal = "" if message.error_code == ErrorCode.SUCCESS else message.message
