"""Plans of the planner node, as the viewer asks for them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from bsp_informed_planner_msgs.msg import PlanRequest
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState

from bsp_informed_planner.errors import PlanningCancelledError, PlanningFailedError
from bsp_informed_planner.nodes.client import SuiteClient
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.obstacle_conversions import pose_to_msg
from bsp_informed_planner.planning.problem import JointGoal
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.visualization.viewer.plan_answer import PlanAnswer, PlanFunction, PlanQuestion

#: How long an answer may take beyond the time that planning itself may take [s].
PATIENCE = 10.0


def plan_through(client: SuiteClient, robot: Robot, revision: int) -> PlanFunction:
    """Plans by calling `plan_motion`. For one thread at a time.

    Args:
        client: talks to the nodes.
        robot: of the nodes.
        revision: of the scene that is shown; plans on another one are refused.
    """

    def plan(question: PlanQuestion, cancelled: Callable[[], bool]) -> PlanAnswer:
        response = client.plan_motion(plan_request(question, robot, revision), PATIENCE, cancelled)
        if response.error_code == ErrorCode.PREEMPTED:
            raise PlanningCancelledError
        if response.error_code != ErrorCode.SUCCESS:
            raise PlanningFailedError(response.message)
        points = response.trajectory.points
        stamps = [point.time_from_start for point in points]
        return PlanAnswer(
            path=np.array(response.waypoints).reshape(-1, robot.dof),
            times=np.array([stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps]),
            positions=np.array([point.positions for point in points]).reshape(-1, robot.dof),
            cost=response.cost,
            certified=response.certified,
            keypoints=np.array([[point.x, point.y, point.z] for point in response.keypoints]).reshape(-1, 3),
            cost_seconds=np.array(response.cost_history_seconds),
            costs=np.array(response.cost_history),
            samples=np.empty((0, robot.dof)),
            remark=response.fallback_reason,
        )

    return plan


def plan_request(question: PlanQuestion, robot: Robot, revision: int) -> PlanRequest:
    """A question as the request of the service.

    Args:
        question: goal poses are of the frames that they name, or of the tool frame; all of one.
        robot: of the nodes.
        revision: of the scene to plan on.
    """
    options = question.options
    request = PlanRequest(
        planner_id=options.planner_id,
        sampler_id=options.sampler_id,
        allowed_planning_time=options.allowed_seconds,
        first_solution=options.first_solution,
        uniform_fraction=options.uniform_fraction,
        max_samples=options.max_samples or 0,
        seed=options.seed or 0,
        max_velocity_scaling_factor=options.velocity_scaling,
        max_acceleration_scaling_factor=options.acceleration_scaling,
        padding=options.padding,
        scene_revision=revision,
    )
    names = list(robot.joint_names)
    request.start = JointState(name=names, position=question.start.tolist())
    for goal in question.goals:
        if isinstance(goal, JointGoal):
            request.goal_states.append(JointState(name=names, position=goal.configuration.tolist()))
            continue
        stamped = PoseStamped(pose=pose_to_msg(goal.pose))
        stamped.header.frame_id = robot.root_frame
        request.goal_poses.append(stamped)
        request.goal_frame = goal.frame or ""
    return request
