"""What a node knows of the world: the robot, the scene in force, and its decomposition, all of one revision."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from bsp_informed_planner_msgs.msg import KeypointGraph, ObstacleScene, SceneStatus
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle import LifecycleNode

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.errors import (
    BspPlannerError,
    EmptySceneError,
    RobotDescriptionError,
    SceneRefusedError,
    SceneRevisionError,
    SceneUnavailableError,
    UnknownFrameError,
)
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.graph_conversions import decomposition_from_msg
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
        allow_empty_scene: whether `current` accepts a scene without obstacles.
    """

    def __init__(self, node: LifecycleNode, allow_empty_scene: bool = False) -> None:
        self._node = node
        self._allow_empty_scene = allow_empty_scene
        self._lock = threading.Condition()
        self._robot: Robot | None = None
        self._scene: Scene | None = None
        self._decomposition: tuple[int, Decomposition] | None = None
        self._refusal = ""
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

    def current(self, revision: int = 0, wait_seconds: float = 0.0) -> World:
        """The world now.

        Args:
            revision: the scene revision that it must have; 0: any.
            wait_seconds: how long to wait for a revision that is to come [s]; not for callbacks of the executor.

        Raises:
            RobotDescriptionError: no robot is known yet.
            SceneUnavailableError: no scene has arrived yet.
            SceneRefusedError: the newest scene message was refused.
            SceneRevisionError: another revision is in force.
            EmptySceneError: the scene has no obstacles.
            UnknownFrameError: the scene is not given in the root frame of the robot.
        """
        robot = self.robot
        with self._lock:
            if revision > 0:
                self._lock.wait_for(lambda: self.revision >= revision or bool(self._refusal), wait_seconds)
            if self._refusal:
                raise SceneRefusedError(self._refusal)
            scene = self._scene
            if scene is None:
                raise SceneUnavailableError("no scene yet: publish one on obstacle_scene")
            if revision not in (0, scene.revision):
                raise SceneRevisionError(revision, scene.revision)
            if scene.is_empty and not self._allow_empty_scene:
                raise EmptySceneError(
                    f"scene {scene.revision} holds no obstacle; set parameter `allow_empty_scene` to plan in it"
                )
            if scene.frame != robot.root_frame:
                raise UnknownFrameError(scene.frame, [robot.root_frame])
            if self._world is None:
                of_revision = self._decomposition is not None and self._decomposition[0] == scene.revision
                decomposition = self._decomposition[1] if self._decomposition is not None and of_revision else None
                self._world = World(robot, Planner(robot, scene, decomposition=decomposition))
            return self._world

    def _on_scene(self, message: ObstacleScene) -> None:
        try:
            scene = scene_from_msg(message)
        except BspPlannerError as error:
            self._node.get_logger().error(f"scene {message.revision}: {error}")
            with self._lock:
                self._refusal = str(error)
            return
        with self._lock:
            # A decomposition node that was restarted counts from one again: what it says last is in force.
            self._scene = scene
            self._world = None
            self._lock.notify_all()

    def _on_graph(self, message: KeypointGraph) -> None:
        decomposition = decomposition_from_msg(message)
        with self._lock:
            self._decomposition = (message.scene_revision, decomposition)
            if self._world is not None and self._world.revision == message.scene_revision:
                self._world = None

    def _on_status(self, message: SceneStatus) -> None:
        with self._lock:
            self._lock.notify_all()
            self._refusal = "" if message.error_code == ErrorCode.SUCCESS else message.message
