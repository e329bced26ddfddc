"""What a node knows of the world: the robot, the scene in force, and its decomposition, all of one revision."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from bsp_informed_planner_msgs.msg import KeypointGraph, ObstacleScene, SceneStatus
from rclpy.lifecycle import LifecycleNode
from rclpy.serialization import deserialize_message

from bsp_informed_planner.collision.bounds import CollisionBounds
from bsp_informed_planner.collision.holding import HoldingRobot, robot_in_scene
from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.errors import (
    BspPlannerError,
    EmptySceneError,
    PlanningCancelledError,
    RobotDescriptionError,
    RobotNotReadyError,
    SceneEpochError,
    SceneRefusedError,
    SceneRevisionError,
    SceneUnavailableError,
    UnknownFrameError,
)
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.graph_conversions import decomposition_from_msg
from bsp_informed_planner.nodes.held_bounds import HeldBounds
from bsp_informed_planner.nodes.newest_first import NewestFirstWorker
from bsp_informed_planner.nodes.own_thread import OwnThread
from bsp_informed_planner.nodes.plan_jobs import CANCEL_PERIOD
from bsp_informed_planner.nodes.qos import LATCHED
from bsp_informed_planner.nodes.scene_conversions import scene_from_msg
from bsp_informed_planner.ompl_workers.process import OmplWorkers
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.diff import SceneDiff, apply
from bsp_informed_planner.scene.scene import Scene

#: Least time between the preparations of two scenes [s]: fast sources must not keep the interpreter from plans.
PREPARATION_PERIOD = 0.05
#: Time between a scene and its preparation [s]: requests that come at once with it make what they need, and no more.
PREPARATION_DELAY = 0.03


@dataclass(frozen=True, eq=False)
class World:
    """A consistent snapshot, safe to use from any thread.

    Attributes:
        planner: for a robot and a scene; holds the decomposition.
        epoch: in which the decomposition node gave the scene its revision.
        is_changed: whether this is the scene of that revision with changes that one request has made.
    """

    planner: Planner
    epoch: int
    is_changed: bool = False

    @property
    def robot(self) -> Robot:
        """With what it holds in the scene."""
        return self.planner.robot

    @property
    def bare_robot(self) -> Robot:
        """Without what it holds."""
        robot = self.planner.robot
        return robot.bare if isinstance(robot, HoldingRobot) else robot

    @property
    def scene(self) -> Scene:
        return self.planner.scene

    @property
    def revision(self) -> int:
        return self.planner.scene.revision

    def changed(self, diff: SceneDiff, get_ready: Callable[[Robot], object] = lambda _: None) -> World:
        """This world with changes that are nobody else's; its decomposition stays that of the scene as published.

        Args:
            diff: the changes.
            get_ready: called with the robot and what it holds then, e.g. `WorldTracker.bounds_of`; may raise.

        Raises:
            SceneError, UnknownFrameError: if the changes do not fit the scene or the robot.
        """
        if not (diff.operations or diff.attachments or diff.permissions):
            return self
        scene = replace(apply(self.scene, diff), revision=self.revision)
        robot = robot_in_scene(self.bare_robot, scene)
        # Held until the planner has them.
        _bounds = get_ready(robot)
        planner = Planner(
            robot,
            scene,
            decomposition=self.planner.decomposition,
            ompl_workers=self.planner.ompl_workers,
        )
        return World(planner, self.epoch, True)


@dataclass(frozen=True, eq=False)
class Situation:
    """What is known at one moment, of which a world can be made.

    Attributes:
        robot: without what it holds in the scene.
        scene, epoch: in force.
        decomposition: of the scene, if it has come.
        workers: of the robot.
    """

    robot: Robot
    scene: Scene
    epoch: int
    decomposition: Decomposition | None
    workers: OmplWorkers | None


class WorldTracker:
    """Follows `scene`, `keypoint_graph` and `scene_verdict`, which is `scene_status` before clients hear it.

    The status says which epoch is in force. A scene of another one is not trusted: its owner has been restarted since,
    and does not know it. Nor is one that is older than the status says: whoever has read that status believes in the
    newer scene. So all that has come is read before a world is handed out, and a scene that the status tells of is
    waited for. What plans need of a scene is made when it comes, in a thread, so that the first request finds it there;
    of scenes that come faster than that, the newest.

    Args:
        node: subscribes.
        allow_empty_scene: whether `current` accepts a scene without obstacles; may be changed.
        head_start: of others who read a new scene [s], who share few cores, or one interpreter, with this node.
    """

    def __init__(self, node: LifecycleNode, allow_empty_scene: bool = False, head_start: float = 0.0) -> None:
        self._node = node
        self.allow_empty_scene = allow_empty_scene
        self._lock = threading.Condition()
        self._robot: Robot | None = None
        # Name of a robot that is being prepared, and how much of that is done.
        self._expected: tuple[str, float] | None = None
        self._ompl_workers: OmplWorkers | None = None
        self._status: SceneStatus | None = None
        # With their epochs, in whatever order the topics deliver them.
        self._scene: tuple[int, Scene] | None = None
        self._decomposition: tuple[int, Decomposition] | None = None
        # Epoch of a newest scene that could not be read here, and why.
        self._unreadable = (0, "")
        self._world: World | None = None
        self._making = threading.Lock()
        self._held_bounds = HeldBounds()
        self._prepared: World | None = None
        self._head_start = head_start
        self._worker = NewestFirstWorker(self._prepare, "world", pause=PREPARATION_PERIOD, delay=PREPARATION_DELAY)
        self._messages = OwnThread(node, "scene")
        # The status first: of a scene that it tells of, the message has come before.
        self._statuses = self._messages.subscribe(SceneStatus, "scene_verdict", self._on_status, LATCHED)
        self._scenes = self._messages.subscribe(ObstacleScene, "scene", self._on_scene, LATCHED, raw=True)
        self._messages.subscribe(KeypointGraph, "keypoint_graph", self._on_graph, LATCHED)

    def close(self) -> None:
        """Stop following."""
        self._messages.close()
        self._worker.stop()

    def expect_robot(self, name: str, share: float) -> None:
        """Say, instead of planning, that a robot is being prepared, and how much of that is done."""
        self._expected = name, share

    def expect_no_robot(self) -> None:
        """Go on with the robot before, if there is one."""
        self._expected = None

    def set_robot(self, robot: Robot) -> None:
        """Plan for this robot from now on."""
        with self._lock:
            self._robot = robot
            self._expected = None
            self._ompl_workers = OmplWorkers(robot)
            self._world = None
        self._worker.submit(None)

    @property
    def robot(self) -> Robot:
        """The robot.

        Raises:
            RobotDescriptionError: if none is known yet.
            RobotNotReadyError: if one is being prepared.
        """
        if self._expected is not None:
            raise RobotNotReadyError(*self._expected)
        if self._robot is None:
            raise RobotDescriptionError("no robot yet: set parameter `robot_description` or publish robot_description")
        return self._robot

    @property
    def robot_name(self) -> str:
        """Empty if none is known yet."""
        return "" if self._robot is None else self._robot.name

    @property
    def preparation(self) -> str:
        """What is said of a robot that is being prepared; empty if none is."""
        return "" if self._expected is None else "bounds of {}: {:.0%}".format(*self._expected)

    @property
    def epoch(self) -> int:
        """In force; 0: none is known."""
        return 0 if self._status is None else int(self._status.epoch)

    @property
    def revision(self) -> int:
        """Of the scene in force; 0 without one. It is known when both the scene and its status have come."""
        if self._scene is None or self._status is None or self._scene[0] != self.epoch:
            return 0
        return min(self._scene[1].revision, int(self._status.revision))

    def current(self, epoch: int = 0, revision: int = 0) -> World:
        """The world now. See `situation` and `make`."""
        return self.make(self.situation(epoch, revision))

    def situation(
        self,
        epoch: int = 0,
        revision: int = 0,
        wait_seconds: float = 0.0,
        cancelled: Callable[[], bool] | None = None,
    ) -> Situation:
        """What is in force, as of all messages that have come.

        Args:
            epoch, revision: that the scene must have; 0: any that is as new as the status says.
            wait_seconds: how long to wait for a scene that is to come [s]; not for callbacks of the executor.
            cancelled: asked while waiting.

        Raises:
            RobotDescriptionError, RobotNotReadyError: no robot is known yet, or it is being prepared.
            SceneUnavailableError: no scene has arrived yet, or not the newest, or the node that owns it is gone.
            SceneRefusedError: the newest scene message was refused.
            SceneEpochError, SceneRevisionError: another scene is in force.
            EmptySceneError: the scene has no obstacles.
            UnknownFrameError: the scene is not given in the root frame of the robot.
            PlanningCancelledError: cancelled while waiting.
        """
        _ = self.robot
        self._messages.catch_up(self._statuses, self._scenes)
        with self._lock:
            self._wait_for(epoch, revision, wait_seconds, cancelled)
            robot = self.robot
            is_behind = epoch in (0, self.epoch) and self.revision < revision and not self._is_unreadable
            if is_behind and (self.revision or self._refusal):
                # What is known of an older scene, that it was refused for example, does not matter.
                raise SceneRevisionError(revision, self.revision)
            scene = self._trusted_scene(epoch)
            if not revision and self._is_announced:
                raise SceneUnavailableError(f"scene {self._announced} is in force, but has not come to this node yet")
            if revision not in (0, scene.revision):
                raise SceneRevisionError(revision, scene.revision)
            if scene.is_empty and not self.allow_empty_scene:
                raise EmptySceneError(
                    f"scene {scene.revision} holds no obstacle; set parameter `allow_empty_scene` to plan in it"
                )
            if scene.frame != robot.root_frame:
                raise UnknownFrameError(scene.frame, [robot.root_frame], "the scene, for this robot")
            return Situation(robot, scene, self.epoch, self._decomposition_of(self.epoch, scene), self._ompl_workers)

    def make(
        self,
        situation: Situation,
        wait_seconds: float = math.inf,
        cancelled: Callable[[], bool] | None = None,
    ) -> World:
        """The world in a situation: made now, or before.

        Args:
            situation: from `situation`.
            wait_seconds: how long to wait for the bounds of what the robot holds [s].
            cancelled: asked while waiting.

        Raises:
            RobotNotReadyError: the bounds of what the robot holds are being built.
            SceneError, UnknownFrameError: the scene does not fit the robot.
            PlanningCancelledError: cancelled while waiting.
        """
        made = self._made(situation)
        if made is not None:
            return made
        # Outside of the locks: what is large takes a while, in which the subscriptions, and other plans, must go on.
        robot, scene = robot_in_scene(situation.robot, situation.scene), situation.scene
        _bounds = self.bounds_of(robot, wait_seconds, cancelled)
        with self._making:
            made = self._made(situation)
            if made is not None:
                return made
            planner = Planner(robot, scene, decomposition=situation.decomposition, ompl_workers=situation.workers)
            world = World(planner, situation.epoch)
            with self._lock:
                is_known = self._scene is not None and self._scene[1] is scene and self.epoch == situation.epoch
                if is_known and self._robot is situation.robot:
                    self._world = world
        return world

    def bounds_of(
        self, robot: Robot, wait_seconds: float = math.inf, cancelled: Callable[[], bool] | None = None
    ) -> CollisionBounds | None:
        """The bounds of a robot that holds something, see `HeldBounds.of`; None for another, which has them already."""
        return self._held_bounds.of(robot, wait_seconds, cancelled) if isinstance(robot, HoldingRobot) else None

    def _made(self, situation: Situation) -> World | None:
        """The world of a situation, if it has been made."""
        with self._lock:
            made, decomposition = self._world, situation.decomposition
            if made is None or made.scene is not situation.scene or made.epoch != situation.epoch:
                return None
            is_fit = made.bare_robot is situation.robot
            return made if is_fit and (decomposition is None or made.planner.adopt(decomposition)) else None

    def _decomposition_of(self, epoch: int, scene: Scene) -> Decomposition | None:
        """That of `keypoint_graph`, if it has come."""
        if self._decomposition is None or self._decomposition[0] != epoch:
            return None
        decomposition = self._decomposition[1]
        return decomposition if decomposition.scene_revision == scene.revision else None

    def _prepare(self, _: None) -> None:
        """In the worker's thread: what the first plan on the scene in force needs."""
        try:
            world = self.current()
            if world is not self._prepared:
                self._prepared = world
                world.planner.get_ready(decompose=False)
        except BspPlannerError:
            # Whoever asks for a plan is told why there is none.
            return
        except Exception as error:  # noqa: BLE001 -- the worker must go on
            self._node.get_logger().error(f"scene {self.revision}: {error}")

    def _trusted_scene(self, epoch: int) -> Scene:
        status = self._status
        if epoch not in (0, self.epoch):
            raise SceneEpochError(epoch, self.epoch)
        if status is None:
            raise SceneUnavailableError("no scene yet: publish one on obstacle_scene")
        refusal = self._refusal
        if refusal:
            raise SceneRefusedError(refusal)
        if self._scene is None or self._scene[0] != status.epoch:
            raise SceneUnavailableError("no scene yet: publish one on obstacle_scene")
        if not self._scenes.get_publisher_count():
            raise SceneUnavailableError(
                f"nobody publishes `scene` any more, so changes of scene {self._scene[1].revision} would not be heard "
                "of: is the decomposition node running?"
            )
        return self._scene[1]

    def _wait_for(self, epoch: int, revision: int, seconds: float, cancelled: Callable[[], bool] | None) -> None:
        """With the lock held: wait for a scene that is asked for, or that the status tells of."""
        end = time.monotonic() + seconds
        # A greater epoch is newer: one that is over does not come back.
        while not self._is_unreadable and (
            self.epoch < epoch
            or (epoch in (0, self.epoch) and (self.revision < revision if revision else self._is_announced))
        ):
            remaining = end - time.monotonic()
            if remaining <= 0.0:
                return
            self._lock.wait(min(remaining, CANCEL_PERIOD))
            if cancelled is not None and cancelled():
                raise PlanningCancelledError

    @property
    def _refusal(self) -> str:
        """Why the scene at hand is not to be trusted: its owner refused a newer one, or this node could not read it."""
        status = self._status
        if status is None or status.error_code == ErrorCode.COLLISION_CHECKING_UNAVAILABLE:
            return ""
        if status.error_code != ErrorCode.SUCCESS:
            return str(status.message)
        return self._unreadable[1] if self._is_unreadable else ""

    @property
    def _announced(self) -> int:
        """Revision that the status tells of; 0: of none."""
        return 0 if self._status is None else int(self._status.revision)

    @property
    def _is_announced(self) -> bool:
        """Whether the status tells of a newer scene than has come, and of nothing that is to be said instead."""
        known = self._scene[1].revision if self._scene is not None and self._scene[0] == self.epoch else 0
        return known < self._announced and not self._refusal

    @property
    def _is_unreadable(self) -> bool:
        """Whether this node could not read the newest scene."""
        return self._status is not None and self._unreadable[0] == self._status.epoch

    def _on_scene(self, data: bytes, _: object) -> None:
        time.sleep(self._head_start)
        message = deserialize_message(data, ObstacleScene)
        try:
            scene = scene_from_msg(message)
        except Exception as error:  # noqa: BLE001 -- a message must not end the node
            self._distrust(int(message.epoch), f"scene {message.revision}: {error}")
            return
        with self._lock:
            self._scene = (int(message.epoch), scene)
            self._unreadable = (0, "")
            self._world = None
            self._lock.notify_all()
        self._worker.submit(None)

    def _distrust(self, epoch: int, reason: str) -> None:
        self._node.get_logger().error(reason)
        with self._lock:
            self._unreadable = (epoch, reason)
            self._lock.notify_all()

    def _on_graph(self, message: KeypointGraph, _: object) -> None:
        try:
            decomposition = decomposition_from_msg(message)
        except Exception as error:  # noqa: BLE001 -- a message must not end the node
            # The scene can still be decomposed here.
            self._node.get_logger().error(f"keypoint_graph {message.scene_revision}: {error}")
            return
        with self._lock:
            self._decomposition = (int(message.scene_epoch), decomposition)
        self._worker.submit(None)

    def _on_status(self, message: SceneStatus, _: object) -> None:
        with self._lock:
            if message.epoch != self.epoch:
                self._world = None
            self._status = message
            self._lock.notify_all()
        self._worker.submit(None)
