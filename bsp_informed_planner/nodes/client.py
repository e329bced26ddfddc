"""A client of the suite, for scripts, tests and the demo: publishes scenes and calls `plan`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from bsp_informed_planner_msgs.action import PlanMotion
from bsp_informed_planner_msgs.msg import KeypointGraph, ObstacleScene, PlanRequest, PlanResponse, SceneStatus
from bsp_informed_planner_msgs.srv import Plan
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from sensor_msgs.msg import JointState

from bsp_informed_planner.errors import BspPlannerError, SceneRefusedError, SceneUnavailableError
from bsp_informed_planner.nodes.error_codes import BEHIND, ErrorCode
from bsp_informed_planner.nodes.obstacle_conversions import pose_to_msg
from bsp_informed_planner.nodes.own_thread import Intake
from bsp_informed_planner.nodes.qos import LATCHED, SERVICES
from bsp_informed_planner.nodes.scene_conversions import scene_from_msg, scene_to_msg
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.scene import Scene

#: Longest wait for a message before a caller is asked whether it still waits [s].
LOOK_PERIOD = 0.05
#: Longest wait for the status of a scene that an answer tells of [s].
HEARING_SECONDS = 0.1
#: Messages that are still read when the time to wait for one is over.
LAST_MESSAGES = 20


def _nanoseconds(stamp: Time) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _planning_seconds(request: PlanRequest) -> float:
    """How long a plan may take [s]. A time that is nonsense is refused at once."""
    seconds = float(request.allowed_planning_time)
    return seconds if 0.0 < seconds < math.inf else 0.0


def _wait_until(
    condition: Callable[[], bool],
    seconds: float,
    alive: Callable[[], None] | None,
    take: Callable[[float], None],
) -> bool:
    """Have messages taken until something holds. `take`: waits so long at most for one [s]."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() <= end:
        if alive is not None:
            alive()
        take(LOOK_PERIOD)
    # Where this process itself was held up, what has come in time is still to be read.
    for _ in range(LAST_MESSAGES):
        if condition():
            return True
        take(0.0)
    return condition()


def _cancel(accepted: Future) -> None:
    """Cancel a goal that has been sent, without waiting for what becomes of it."""
    goal = accepted.result()
    if goal is not None and goal.accepted:
        goal.cancel_goal_async()


class SuiteUnavailableError(BspPlannerError):
    """The nodes are not there, or do not answer; the text says what was waited for."""


class SuiteClient:
    """Talks to the three nodes in the namespace of a node of the caller's.

    Its methods wait. They spin an executor of their own, so they must not be called from a callback.

    Args:
        node: made by the caller, not added to any executor.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._publisher = node.create_publisher(ObstacleScene, "obstacle_scene", LATCHED)
        # Apart, since there is nothing else to wait for while a plan is made.
        self._answers = Intake(node)
        self._plan = self._answers.client(Plan, "plan", SERVICES)
        self._plan_motion = ActionClient(
            node, PlanMotion, "plan_motion", goal_service_qos_profile=SERVICES, result_service_qos_profile=SERVICES,
            cancel_service_qos_profile=SERVICES,
        )  # fmt: skip
        self._status: SceneStatus | None = None
        self._statuses = 0
        self.keypoint_graph: KeypointGraph | None = None
        self._scene: bytes | None = None
        self._subscriptions = (
            node.create_subscription(SceneStatus, "scene_status", self._on_status, LATCHED),
            node.create_subscription(KeypointGraph, "keypoint_graph", self._on_graph, LATCHED),
            # To be read when it is asked for.
            node.create_subscription(ObstacleScene, "scene", self._on_scene, LATCHED, raw=True),
        )

    def close(self) -> None:
        """Leave the node to its owner, as it was. A scene that was published is no longer there for who comes late."""
        self._plan_motion.destroy()
        self._answers.close()
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._node.destroy_publisher(self._publisher)
        self._executor.remove_node(self._node)
        self._executor.shutdown()

    @property
    def node(self) -> Node:
        """The caller's, for other clients and subscriptions, which the methods here spin, too."""
        return self._node

    def spin_until(
        self, condition: Callable[[], bool], seconds: float, alive: Callable[[], None] | None = None
    ) -> bool:
        """Let messages come until something holds.

        Args:
            condition: asked after each message.
            seconds: longest wait [s].
            alive: called now and then; may raise.

        Returns:
            whether it holds.
        """
        return _wait_until(condition, seconds, alive, self._executor.spin_once)

    def spin_for(self, seconds: float) -> None:
        """Let messages come for a time [s]."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    @property
    def revision(self) -> int:
        """Revision of the scene in force, as far as this client has heard; 0: none."""
        return 0 if self._status is None else int(self._status.revision)

    @property
    def epoch(self) -> int:
        """Epoch of the scene in force, as far as this client has heard; 0: none."""
        return 0 if self._status is None else int(self._status.epoch)

    def wait_for_nodes(self, seconds: float, alive: Callable[[], None] | None = None) -> None:
        """Wait until the decomposition node listens and `plan` is served, by a planner node that has guidance.

        Args:
            seconds: longest wait [s].
            alive: called now and then; may raise, e.g. because a process has ended.

        Raises:
            SuiteUnavailableError: naming what is missing.
        """

        def missing() -> list[str]:
            lacking = [] if self._publisher.get_subscription_count() else ["a subscriber of obstacle_scene"]
            # By their servers: names are known of services, too, that have clients only, as the planner node is one.
            services = ("plan", "estimate_keypoints", "sample_configurations")
            return lacking + [f"service {name}" for name in services if not self._node.count_services(name)]

        if not self.spin_until(lambda: not missing(), seconds, alive):
            raise SuiteUnavailableError(f"after {seconds:.0f} s there is still no {', no '.join(missing())}")
        if not self.spin_until(self._plan.service_is_ready, seconds, alive):
            raise SuiteUnavailableError(f"service {self._plan.srv_name} is not ready after {seconds:.0f} s")

    def publish_scene(self, scene: Scene, seconds: float = 10.0) -> int:
        """Publish a whole scene and wait until it is in force.

        Args:
            scene: the obstacles.
            seconds: longest wait [s].

        Returns:
            its revision, in the epoch that `epoch` says.

        Raises:
            SceneRefusedError: if the decomposition node refused it.
            SuiteUnavailableError: if it said nothing.
        """
        message = scene_to_msg(scene)
        message.header.stamp = self._node.get_clock().now().to_msg()
        stamp, before = _nanoseconds(message.header.stamp), self._statuses

        def is_answered() -> bool:
            # A newer scene may have superseded this one, of another client's or its own.
            status = self._status
            return status is not None and self._statuses > before and _nanoseconds(status.header.stamp) >= stamp

        def graph_is_there() -> bool:
            graph = self.keypoint_graph
            return graph is not None and graph.scene_epoch == self.epoch and graph.scene_revision >= revision

        self.publish_message(message)
        if not self.spin_until(is_answered, seconds):
            raise SuiteUnavailableError(f"the decomposition node did not answer a scene within {seconds:.0f} s")
        assert self._status is not None
        if self._status.error_code != ErrorCode.SUCCESS:
            raise SceneRefusedError(self._status.message)
        revision = int(self._status.revision)
        if not self.spin_until(graph_is_there, seconds):
            raise SuiteUnavailableError(f"no keypoint_graph of scene {revision} within {seconds:.0f} s")
        return revision

    def publish_message(self, message: ObstacleScene) -> None:
        """Publish a scene, or a change of it, and do not wait for what becomes of it."""
        self._publisher.publish(message)

    def wait_for_scene(self, seconds: float) -> Scene:
        """The scene in force, as soon as there is one.

        Args:
            seconds: longest wait [s].

        Raises:
            SceneUnavailableError: if there is none.
            SceneError: if it cannot be read.
        """
        if not self.spin_until(lambda: self._scene is not None, seconds):
            raise SceneUnavailableError(f"no scene within {seconds:.0f} s: the decomposition node has been sent none")
        assert self._scene is not None
        return scene_from_msg(deserialize_message(self._scene, ObstacleScene))

    def plan(self, request: PlanRequest, seconds: float, alive: Callable[[], None] | None = None) -> PlanResponse:
        """Call `plan`.

        A planner node that has just started may hear of a scene seconds after this client did. If the request names a
        revision that the planner has not heard of, it is asked again within `seconds`.

        Args:
            request: what to plan.
            seconds: longest wait for the answer, beyond the time that planning itself may take [s].
            alive: called now and then; may raise, e.g. because nobody waits any more. The node plans on until its time
                is over.

        Raises:
            SuiteUnavailableError: if no answer came.
        """
        end = time.monotonic() + seconds
        while True:
            response = self._plan_once(request, max(end - time.monotonic(), 0.0), alive)
            known = response.scene_epoch if request.scene_epoch else 0, response.scene_revision
            behind = response.error_code in BEHIND and known < (request.scene_epoch, request.scene_revision)
            if not behind or time.monotonic() >= end:
                self._hear_of(response)
                return response

    def _hear_of(self, response: PlanResponse) -> None:
        """Read what has come meanwhile, if an answer tells of a newer scene than this client has heard of."""
        newest = int(response.scene_epoch), int(response.scene_revision)
        self.spin_until(lambda: (self.epoch, self.revision) >= newest, HEARING_SECONDS)

    def plan_motion(self, request: PlanRequest, seconds: float, cancelled: Callable[[], bool]) -> PlanResponse:
        """Call the action `plan_motion`, which can be cancelled: the answer is then `ErrorCode.PREEMPTED`.

        A goal whose answer is given up is cancelled, too.

        Args:
            request: what to plan.
            seconds: longest wait for the answer, beyond the time that planning itself may take [s].
            cancelled: called now and then; True cancels.

        Raises:
            SuiteUnavailableError: if no answer came.
        """
        end = time.monotonic() + seconds + _planning_seconds(request)

        def wait(condition: Callable[[], bool]) -> None:
            if not self.spin_until(condition, end - time.monotonic()):
                raise SuiteUnavailableError("action plan_motion did not answer")

        wait(self._plan_motion.server_is_ready)
        accepted = self._plan_motion.send_goal_async(PlanMotion.Goal(request=request))
        try:
            wait(accepted.done)
            goal = accepted.result()
            if not goal.accepted:
                raise SuiteUnavailableError("action plan_motion took no goal: the planner node is not active")
            outcome = goal.get_result_async()
            wait(lambda: outcome.done() or cancelled())
            if not outcome.done():
                goal.cancel_goal_async()
                wait(outcome.done)
        except BaseException:
            if accepted.done():
                _cancel(accepted)
            else:
                # As soon as it is known, whenever this client listens again.
                accepted.add_done_callback(_cancel)
            raise
        response: PlanResponse = outcome.result().result.response
        return response

    def _plan_once(self, request: PlanRequest, seconds: float, alive: Callable[[], None] | None) -> PlanResponse:
        future = self._plan.call_async(Plan.Request(request=request))
        if not _wait_until(future.done, seconds + _planning_seconds(request), alive, self._answers.take):
            self._plan.remove_pending_request(future)
            raise SuiteUnavailableError(f"service {self._plan.srv_name} did not answer")
        return future.result().response

    def _on_status(self, message: SceneStatus) -> None:
        self._status = message
        self._statuses += 1

    def _on_scene(self, data: bytes) -> None:
        self._scene = data

    def _on_graph(self, message: KeypointGraph) -> None:
        self.keypoint_graph = message


def request_for(
    problem: ScenarioProblem, robot: Robot, allowed_seconds: float, seed: int = 0, epoch: int = 0, revision: int = 0
) -> PlanRequest:
    """The request that states a problem.

    Args:
        problem: start and goals.
        robot: names the joints.
        allowed_seconds: planning time [s].
        seed: of the planner; 0: it draws one.
        epoch, revision: of the scene to plan on, see `SuiteClient.publish_scene`; 0: the latest that the planner node
            has heard of.
    """
    names = list(robot.joint_names)
    request = PlanRequest(allowed_planning_time=allowed_seconds, seed=seed, scene_epoch=epoch, scene_revision=revision)
    request.start = JointState(name=names, position=problem.start.tolist())
    request.goal_states = [JointState(name=names, position=goal.tolist()) for goal in problem.goals]
    for pose in problem.goal_poses:
        stamped = PoseStamped(pose=pose_to_msg(pose))
        stamped.header.frame_id = problem.scene.frame
        request.goal_poses.append(stamped)
    return request
