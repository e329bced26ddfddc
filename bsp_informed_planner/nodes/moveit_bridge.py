"""The MoveIt bridge: MoveIt's planning scene becomes ours, and its motion plan requests are planned here.

Only where moveit_msgs is installed; the other nodes neither need it nor know of it.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from bsp_informed_planner_msgs.msg import ObstacleScene, PlanResponse
from bsp_informed_planner_msgs.srv import Plan
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from bsp_informed_planner.errors import BspPlannerError, RobotDescriptionError, StateUnavailableError
from bsp_informed_planner.nodes.error_codes import ErrorCode, error_code
from bsp_informed_planner.nodes.joint_state_cache import JointStateCache
from bsp_informed_planner.nodes.lifecycle import PlannerSuiteNode, run
from bsp_informed_planner.nodes.moveit_conversions import MoveItScene, request_from_moveit, response_to_moveit
from bsp_informed_planner.nodes.parameters import parameter
from bsp_informed_planner.nodes.patient_call import call
from bsp_informed_planner.nodes.qos import LATCHED, SERVICES, UPDATES
from bsp_informed_planner.nodes.robot_source import RobotParameters, RobotSource
from bsp_informed_planner.nodes.scene_conversions import scene_to_msg
from bsp_informed_planner.nodes.scene_keeper import SceneKeeper
from bsp_informed_planner.nodes.size_limits import LARGEST
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import WorkspaceBounds

#: How long an answer of the planner node may take beyond the time that planning itself may take [s].
PATIENCE = 10.0
#: The time that planning may take if the request gives none: the planner node has a default of its own [s].
LONGEST_PLAN = 60.0


class MoveItUnavailableError(BspPlannerError):
    """moveit_msgs is not installed."""


@dataclass(frozen=True)
class BridgeParameters(RobotParameters):
    """Parameters of the MoveIt bridge."""

    workspace_min: tuple[float, ...] = parameter((-1.0, -1.0, -0.5), "Lower bounds of the space decomposed [m].")
    workspace_max: tuple[float, ...] = parameter((1.0, 1.0, 1.5), "Upper bounds of the space decomposed [m].")
    joint_state_max_age: float = parameter(
        1.0, "Oldest joint_states that place a frame of the robot [s]; 0: any.", minimum=0.0, maximum=3600.0
    )


class MoveItWorld:
    """The scene as MoveIt tells it: applies its messages, and gives the whole scene after each.

    Args:
        robot: gives the planning frame.
        bounds: of the space decomposed.
        positions: of the joints as they are known now, by name.
    """

    def __init__(self, robot: Robot, bounds: WorkspaceBounds, positions: Callable[[], dict[str, float]]) -> None:
        self._robot = robot
        self._positions = positions
        self._moveit = MoveItScene()
        self._keeper = SceneKeeper(robot.root_frame, bounds, "points")
        self._keeper.take_scene(ObstacleScene(), LARGEST)

    def take_scene(self, message: Any) -> ObstacleScene:
        """After a moveit_msgs/PlanningScene."""
        return self._whole(
            self._moveit.take_scene(message, self._robot.root_frame, self.frame_pose, self._robot.frames)
        )

    def take_object(self, message: Any) -> ObstacleScene:
        """After a moveit_msgs/CollisionObject."""
        return self._whole(self._moveit.take_object(message, self._robot.root_frame, self.frame_pose))

    def take_attached(self, message: Any) -> ObstacleScene:
        """After a moveit_msgs/AttachedCollisionObject."""
        return self._whole(self._moveit.take_attached(message, self._robot.root_frame, self.frame_pose))

    def request(self, message: Any) -> Plan.Request:
        """A moveit_msgs/MotionPlanRequest as ours."""
        request = request_from_moveit(message)
        request.attached = self._moveit.attached_of(message.start_state.attached_collision_objects, self.frame_pose)
        return Plan.Request(request=request)

    def frame_pose(self, name: str) -> Pose:
        """Pose of a frame of the robot as it stands now, in the planning frame.

        Raises:
            StateUnavailableError: if a joint's position is not known.
            UnknownFrameError: if the robot has no such frame.
        """
        if name in ("", self._robot.root_frame):
            return Pose.identity()
        known = self._positions()
        missing = [joint for joint in self._robot.joint_names if joint not in known]
        if missing:
            raise StateUnavailableError(missing)
        return self._robot.forward_kinematics(np.array([known[joint] for joint in self._robot.joint_names]), name)

    def _whole(self, change: ObstacleScene) -> ObstacleScene:
        return scene_to_msg(self._keeper.take_scene(change, LARGEST))


class MoveItBridgeNode(PlannerSuiteNode):
    """Subscribes MoveIt's scene topics, publishes `obstacle_scene`, and serves `plan_kinematic_path`.

    The scene is published whole and latched after each change, so a decomposition node that is started again hears it.
    """

    def __init__(self, **options: object) -> None:
        super().__init__("moveit_bridge", **options)

    def setup(self) -> None:
        self._parameter_set = self.follow_parameters(BridgeParameters)
        settings = self._parameter_set.values
        try:
            messages, services = importlib.import_module("moveit_msgs.msg"), importlib.import_module("moveit_msgs.srv")
        except ImportError as error:
            raise MoveItUnavailableError(f"moveit_msgs is not installed, and the bridge needs it ({error})") from error
        self._bounds = WorkspaceBounds(np.array(settings.workspace_min), np.array(settings.workspace_max))
        self._joints = JointStateCache(settings.joint_state_max_age)
        self._world: MoveItWorld | None = None
        self._publisher = self.create_publisher(ObstacleScene, "obstacle_scene", LATCHED)
        self.release_with(self.destroy_publisher, self._publisher)
        source = RobotSource(self, settings, self._set_robot, self.note_error)
        self.release_with(source.close)
        # In the order in which they come: one after the other.
        group = MutuallyExclusiveCallbackGroup()
        for kind, topic, callback in (
            (messages.PlanningScene, "planning_scene", lambda m: self._take(MoveItWorld.take_scene, m)),
            (messages.CollisionObject, "collision_object", lambda m: self._take(MoveItWorld.take_object, m)),
            (
                messages.AttachedCollisionObject,
                "attached_collision_object",
                lambda m: self._take(MoveItWorld.take_attached, m),
            ),
        ):
            subscription = self.create_subscription(kind, topic, callback, UPDATES, callback_group=group)
            self.release_with(self.destroy_subscription, subscription)
        joint_states = self.create_subscription(
            JointState, "joint_states", self._joints.take, qos_profile_sensor_data, callback_group=group
        )
        self.release_with(self.destroy_subscription, joint_states)
        reentrant = ReentrantCallbackGroup()
        self._plan = self.create_client(Plan, "plan", qos_profile=SERVICES, callback_group=reentrant)
        self.release_with(self.destroy_client, self._plan)
        service = self.create_service(
            services.GetMotionPlan, "plan_kinematic_path", self._on_plan, qos_profile=SERVICES, callback_group=reentrant
        )
        self.release_with(self.destroy_service, service)

    def _set_robot(self, robot: Robot) -> None:
        self._world = MoveItWorld(robot, self._bounds, self._joints.recent)

    def _require_world(self) -> MoveItWorld:
        if self._world is None:
            raise RobotDescriptionError("no robot yet: set parameter `robot_description` or publish robot_description")
        return self._world

    def _take(self, take: Callable[[MoveItWorld, Any], ObstacleScene], message: Any) -> None:
        try:
            self.require_active()
            scene = take(self._require_world(), message)
        except Exception as error:  # noqa: BLE001 -- a message must not end the node
            self.note_error(f"{type(message).__name__}: {error}")
            return
        scene.header.stamp = self.get_clock().now().to_msg()
        self._publisher.publish(scene)

    async def _plan_in_time(self, request: Plan.Request) -> PlanResponse:
        """The answer of the planner node, or that there is none."""
        reason = "`plan` is not served"
        if self._plan.service_is_ready():
            planning = float(request.request.allowed_planning_time)
            seconds = PATIENCE + (planning if 0.0 < planning < math.inf else LONGEST_PLAN)
            answer = await call(self, self._plan, request, seconds)
            if answer is not None:
                return answer.response
            reason = f"`plan` has not answered within {seconds:.0f} s"
        return PlanResponse(error_code=int(ErrorCode.COMMUNICATION_FAILURE), message=reason)

    async def _on_plan(self, request: Any, response: Any) -> Any:
        asked, begin = request.motion_plan_request, time.monotonic()
        try:
            self.require_active()
            answer = await self._plan_in_time(self._require_world().request(asked))
        except Exception as error:  # noqa: BLE001 -- every request gets an answer
            self.note_error(str(error))
            answer = PlanResponse(error_code=int(error_code(error)), message=str(error))
        response_to_moveit(answer, asked.group_name, time.monotonic() - begin, response.motion_plan_response)
        return response


def main(args: list[str] | None = None) -> None:
    """Entry point of `moveit_bridge`."""
    run(MoveItBridgeNode, args)


if __name__ == "__main__":
    main()
