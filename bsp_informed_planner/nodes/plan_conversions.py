"""Plan requests and responses between ROS messages and the library."""

from __future__ import annotations

from array import array
from collections.abc import Mapping

import numpy as np
from bsp_informed_planner_msgs.msg import PlanRequest, PlanResponse, PlanStatistics
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from bsp_informed_planner.errors import (
    InvalidOptionError,
    InvalidStateError,
    StateUnavailableError,
    UnknownFrameError,
    UnknownJointError,
)
from bsp_informed_planner.nodes.arrays import float64_field, float64_rows
from bsp_informed_planner.nodes.obstacle_conversions import point_to_msg, pose_from_msg
from bsp_informed_planner.nodes.scene_conversions import attachments_from_msg, permissions_from_msg
from bsp_informed_planner.nodes.size_limits import LARGEST, SizeLimits
from bsp_informed_planner.planning.problem import (
    Goal,
    JointGoal,
    PlanningProblem,
    PlanOptions,
    PlanResult,
    PoseGoal,
    Trajectory,
)
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.diff import SceneDiff
from bsp_informed_planner.scene.pose import FloatArray

MAX_GOALS = 100


def problem_from_msg(request: PlanRequest, robot: Robot, joint_states: Mapping[str, float]) -> PlanningProblem:
    """The problem of a request.

    Args:
        request: the request.
        robot: for which it is.
        joint_states: the latest positions known, by joint.

    Raises:
        UnknownJointError, InvalidStateError, StateUnavailableError, UnknownFrameError: naming what is wrong.
    """
    start = start_from_msg(request.start, robot, joint_states)
    count = len(request.goal_states) + len(request.goal_poses)
    if count > MAX_GOALS:
        raise InvalidOptionError("goals", count, f"at most {MAX_GOALS}")
    goals: list[Goal] = [JointGoal(_goal_state(state, robot)) for state in request.goal_states]
    goals += [_goal_pose(pose, request.goal_frame, robot, start) for pose in request.goal_poses]
    return PlanningProblem(start, goals)


def changes_from_msg(request: PlanRequest, limits: SizeLimits = LARGEST) -> SceneDiff:
    """What a request changes of the scene, for itself alone.

    Raises:
        InvalidObstacleError: naming what is wrong.
    """
    limits.check_parts([], request.attached, request.allowed_collisions)
    return SceneDiff(
        attachments=attachments_from_msg(request.attached, ""),
        permissions=permissions_from_msg(request.allowed_collisions),
    )


def start_from_msg(message: JointState, robot: Robot, joint_states: Mapping[str, float]) -> FloatArray:
    """A start state, filled up from the latest joint states.

    Raises:
        UnknownJointError, InvalidStateError, StateUnavailableError: naming what is wrong.
    """
    given = _positions(message, robot, "start")
    missing = [name for name in robot.joint_names if name not in given and name not in joint_states]
    if missing:
        raise StateUnavailableError(missing)
    return np.array([given.get(name, joint_states.get(name)) for name in robot.joint_names], dtype=np.float64)


def _goal_state(message: JointState, robot: Robot) -> FloatArray:
    given = _positions(message, robot, "goal")
    missing = [name for name in robot.joint_names if name not in given]
    if missing:
        raise InvalidStateError("goal", f"no position of joint(s) {', '.join(missing)}")
    return np.array([given[name] for name in robot.joint_names])


def _positions(message: JointState, robot: Robot, state: str) -> dict[str, float]:
    names = list(message.name)
    if not names and len(message.position):
        # Positions without names: those of all joints, in their order.
        names = list(robot.joint_names)
    if len(names) != len(message.position):
        raise InvalidStateError(state, f"{len(message.position)} positions for {len(names)} joints")
    unknown = [name for name in names if name not in robot.joint_names]
    if unknown:
        raise UnknownJointError(unknown, robot.joint_names)
    twice = [name for place, name in enumerate(names) if name in names[:place]]
    if twice:
        raise InvalidStateError(state, f"joint '{twice[0]}' is named twice")
    return dict(zip(names, message.position, strict=True))


def _goal_pose(message: PoseStamped, goal_frame: str, robot: Robot, start: FloatArray) -> PoseGoal:
    """A pose in the root frame, or in a frame of the robot where the start state puts it."""
    if goal_frame and goal_frame not in robot.frames:
        raise UnknownFrameError(goal_frame, robot.frames)
    try:
        pose = pose_from_msg(message.pose)
    except ValueError as error:
        raise InvalidStateError("goal", f"pose: {error}") from error
    frame = message.header.frame_id or robot.root_frame
    if frame != robot.root_frame:
        if not np.isfinite(start).all():
            raise InvalidStateError("start", "a position is not finite")
        pose = robot.forward_kinematics(start, frame) * pose
    return PoseGoal(pose, goal_frame or None)


def options_from_msg(request: PlanRequest, defaults: PlanOptions, max_seconds: float) -> PlanOptions:
    """The options of a request; what it leaves open comes from the defaults.

    Raises:
        InvalidOptionError: naming the option.
    """
    if request.allowed_planning_time > max_seconds:
        raise InvalidOptionError(
            "allowed_planning_time", request.allowed_planning_time, f"at most {max_seconds} s (parameter `max_seconds`)"
        )
    try:
        return _options(request, defaults)
    except InvalidOptionError as error:
        # In the words of the request.
        raise InvalidOptionError(_FIELDS.get(error.option, error.option), error.value, error.expected) from error


_FIELDS = {
    "allowed_seconds": "allowed_planning_time",
    "velocity_scaling": "max_velocity_scaling_factor",
    "acceleration_scaling": "max_acceleration_scaling_factor",
}


def _options(request: PlanRequest, defaults: PlanOptions) -> PlanOptions:
    return PlanOptions(
        planner_id=request.planner_id or defaults.planner_id,
        sampler_id=request.sampler_id or defaults.sampler_id,
        allowed_seconds=request.allowed_planning_time or defaults.allowed_seconds,
        first_solution=bool(request.first_solution),
        uniform_fraction=defaults.uniform_fraction if request.uniform_fraction < 0.0 else request.uniform_fraction,
        max_samples=int(request.max_samples) or defaults.max_samples,
        seed=int(request.seed) or None,
        verification_resolution=defaults.verification_resolution,
        padding=request.padding or defaults.padding,
        velocity_scaling=request.max_velocity_scaling_factor or defaults.velocity_scaling,
        acceleration_scaling=request.max_acceleration_scaling_factor or defaults.acceleration_scaling,
        blend_deviation=defaults.blend_deviation,
        time_step=defaults.time_step,
    )


def response_from_result(result: PlanResult, robot: Robot) -> PlanResponse:
    """The response of a plan that succeeded; its error code and message are left to the caller."""
    response = PlanResponse(
        trajectory=trajectory_to_msg(result.trajectory, robot),
        waypoints=float64_field(result.path),
        certified=result.certified,
        verification_resolution=result.verification_resolution,
        cost=result.cost,
        cost_history=float64_field(np.array(result.cost_history.costs)),
        cost_history_seconds=float64_field(np.array(result.cost_history.seconds)),
        keypoints=[point_to_msg(point) for point in result.guidance.keypoints],
        planner_id=result.planner_id,
        sampler_id=result.guidance.sampler_id,
        fallback_reason=result.guidance.fallback_reason,
        scene_revision=result.scene_revision,
    )
    statistics = result.statistics
    response.statistics = PlanStatistics(
        **{
            name: getattr(statistics, name)
            for name in PlanStatistics.get_fields_and_field_types()
            if hasattr(statistics, name)
        },
        keypoints=len(result.guidance.keypoints),
    )
    return response


def trajectory_to_msg(trajectory: Trajectory, robot: Robot) -> JointTrajectory:
    """A timed path in the root frame's header; its stamp is left zero: "start now" to controllers."""
    message = JointTrajectory(joint_names=list(robot.joint_names))
    message.header.frame_id = robot.root_frame
    message.points = [
        _point(position, velocity, acceleration, duration_to_msg(seconds))
        for seconds, position, velocity, acceleration in zip(
            trajectory.times.tolist(),
            float64_rows(trajectory.positions),
            float64_rows(trajectory.velocities),
            float64_rows(trajectory.accelerations),
            strict=True,
        )
    ]
    return message


_NO_EFFORT = array("d")


def _point(
    positions: array[float], velocities: array[float], accelerations: array[float], time_from_start: Duration
) -> JointTrajectoryPoint:
    """A point with these arrays. The message's constructor copies each twice: of an answer, half of the work."""
    point = JointTrajectoryPoint.__new__(JointTrajectoryPoint)
    point._check_fields = False
    point._positions, point._velocities, point._accelerations = positions, velocities, accelerations
    point._effort, point._time_from_start = _NO_EFFORT, time_from_start
    return point


def duration_to_msg(seconds: float) -> Duration:
    """A duration >= 0 [s]."""
    nanoseconds = round(seconds * 1e9)
    return Duration(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)
