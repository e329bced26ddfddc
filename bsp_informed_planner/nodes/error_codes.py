"""MoveIt error codes, and the one place where an exception becomes one."""

from __future__ import annotations

from enum import IntEnum

from bsp_informed_planner import errors


class ErrorCode(IntEnum):
    """Values of moveit_msgs/MoveItErrorCodes, which need not be installed."""

    SUCCESS = 1
    FAILURE = 99999
    PLANNING_FAILED = -1
    MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE = -3
    UNABLE_TO_ACQUIRE_SENSOR_DATA = -5
    TIMED_OUT = -6
    PREEMPTED = -7
    START_STATE_IN_COLLISION = -10
    START_STATE_VIOLATES_PATH_CONSTRAINTS = -11
    GOAL_IN_COLLISION = -12
    GOAL_VIOLATES_PATH_CONSTRAINTS = -13
    INVALID_GROUP_NAME = -15
    INVALID_GOAL_CONSTRAINTS = -16
    INVALID_ROBOT_STATE = -17
    INVALID_OBJECT_NAME = -19
    FRAME_TRANSFORM_FAILURE = -21
    COLLISION_CHECKING_UNAVAILABLE = -22
    ROBOT_STATE_STALE = -23
    SENSOR_INFO_STALE = -24
    COMMUNICATION_FAILURE = -25
    START_STATE_INVALID = -26
    GOAL_STATE_INVALID = -27
    CRASH = -29
    ABORT = -30
    NO_IK_SOLUTION = -31


#: What a node answers that has not heard of a scene revision yet.
BEHIND = (ErrorCode.MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE, ErrorCode.COLLISION_CHECKING_UNAVAILABLE)

#: Codes of errors about one end of a problem: as the start, as a goal.
BY_STATE: dict[type[errors.ProblemError], tuple[ErrorCode, ErrorCode]] = {
    errors.InvalidStateError: (ErrorCode.START_STATE_INVALID, ErrorCode.GOAL_STATE_INVALID),
    errors.StateOutsideLimitsError: (
        ErrorCode.START_STATE_VIOLATES_PATH_CONSTRAINTS,
        ErrorCode.GOAL_VIOLATES_PATH_CONSTRAINTS,
    ),
    errors.StateInCollisionError: (ErrorCode.START_STATE_IN_COLLISION, ErrorCode.GOAL_IN_COLLISION),
}

#: Codes of all others. Subclasses before their bases: the first that matches counts.
BY_CLASS: tuple[tuple[type[errors.BspPlannerError], ErrorCode], ...] = (
    (errors.UnreachablePoseError, ErrorCode.NO_IK_SOLUTION),
    (errors.NoGoalError, ErrorCode.INVALID_GOAL_CONSTRAINTS),
    (errors.StateUnavailableError, ErrorCode.ROBOT_STATE_STALE),
    (errors.UnknownJointError, ErrorCode.INVALID_ROBOT_STATE),
    (errors.UnknownFrameError, ErrorCode.FRAME_TRANSFORM_FAILURE),
    (errors.UnknownPlannerError, ErrorCode.INVALID_GROUP_NAME),
    (errors.UnknownSamplerError, ErrorCode.INVALID_GROUP_NAME),
    (errors.ModelUnavailableError, ErrorCode.INVALID_GROUP_NAME),
    (errors.UnsupportedRequestError, ErrorCode.INVALID_GOAL_CONSTRAINTS),
    (errors.MissingPackageError, ErrorCode.INVALID_GROUP_NAME),
    (errors.InvalidOptionError, ErrorCode.PLANNING_FAILED),
    (errors.SceneUnavailableError, ErrorCode.COLLISION_CHECKING_UNAVAILABLE),
    (errors.RobotNotReadyError, ErrorCode.COLLISION_CHECKING_UNAVAILABLE),
    (errors.EmptySceneError, ErrorCode.UNABLE_TO_ACQUIRE_SENSOR_DATA),
    (errors.SceneEpochError, ErrorCode.MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE),
    (errors.SceneRevisionError, ErrorCode.MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE),
    (errors.SceneRefusedError, ErrorCode.SENSOR_INFO_STALE),
    (errors.SceneError, ErrorCode.INVALID_OBJECT_NAME),
    (errors.PlanningCancelledError, ErrorCode.PREEMPTED),
    (errors.PlanningTimeoutError, ErrorCode.TIMED_OUT),
    (errors.PlannerProcessError, ErrorCode.CRASH),
    (errors.PlanningFailedError, ErrorCode.PLANNING_FAILED),
    (errors.TrajectoryTimingError, ErrorCode.PLANNING_FAILED),
    (errors.QueueFullError, ErrorCode.ABORT),
    (errors.KeypointsUnavailableError, ErrorCode.PLANNING_FAILED),
)


def error_code(error: BaseException) -> ErrorCode:
    """The code of an exception; CRASH for one that this package does not raise on purpose."""
    if isinstance(error, errors.ProblemError):
        for problem, (start, goal) in BY_STATE.items():
            if isinstance(error, problem):
                return start if error.state == "start" else goal
    for kind, code in BY_CLASS:
        if isinstance(error, kind):
            return code
    return ErrorCode.FAILURE if isinstance(error, errors.BspPlannerError) else ErrorCode.CRASH
