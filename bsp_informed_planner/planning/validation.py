"""Is a problem well-posed? Each way in which it is not has its own exception."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.errors import (
    InvalidStateError,
    NoGoalError,
    ProblemError,
    StateInCollisionError,
    StateOutsideLimitsError,
    UnreachablePoseError,
)
from bsp_informed_planner.planning.problem import JointGoal, PlanningProblem, PoseGoal
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.robots.windings import closest_windings
from bsp_informed_planner.scene.pose import FloatArray

#: How far beyond a limit a joint may be without being refused [rad or m]: encoders and rounding.
LIMIT_TOLERANCE = 1e-4


def validated_state(robot: Robot, name: str, configuration: FloatArray) -> FloatArray:
    """A state (n,) that is finite and within the limits; rounding beyond them is cut off.

    Raises:
        InvalidStateError: wrong size, or a value that is not finite.
        StateOutsideLimitsError: naming the joint.
    """
    state = np.array(configuration, dtype=np.float64)
    if state.shape != (robot.dof,):
        raise InvalidStateError(name, f"{state.size} values for the {robot.dof} joints {', '.join(robot.joint_names)}")
    if not np.isfinite(state).all():
        joint = robot.joint_names[int(np.argmin(np.isfinite(state)))]
        raise InvalidStateError(name, f"the position of joint '{joint}' is not finite")
    # A continuous joint has no limits but those of one turn either way, which any position has a winding in.
    beyond = robot.continuous & ((state < robot.lower) | (state > robot.upper))
    state = np.where(beyond, np.remainder(state + np.pi, 2.0 * np.pi) - np.pi, state)
    outside = (state < robot.lower - LIMIT_TOLERANCE) | (state > robot.upper + LIMIT_TOLERANCE)
    if outside.any():
        index = int(np.argmax(outside))
        raise StateOutsideLimitsError(
            name,
            robot.joint_names[index],
            float(state[index]),
            float(robot.lower[index]),
            float(robot.upper[index]),
        )
    return np.clip(state, robot.lower, robot.upper)


def free_state(robot: Robot, checker: CollisionChecker, name: str, configuration: FloatArray) -> FloatArray:
    """A validated state that is free of collision.

    Raises:
        InvalidStateError, StateOutsideLimitsError: see `validated_state`.
        StateInCollisionError: naming the two bodies, and the padding, if they do not touch.
    """
    state = validated_state(robot, name, configuration)
    bodies = checker.colliding_bodies(state)
    if bodies is not None:
        raise _collision(checker, name, state, bodies)
    return state


def _collision(
    checker: CollisionChecker, name: str, state: FloatArray, bodies: tuple[str, str]
) -> StateInCollisionError:
    """What is said of a state that is not free because of two bodies: that some touch, or that these come too close."""
    touching = bodies if checker.padding == 0.0 else checker.touching_bodies(state)
    if touching is not None:
        return StateInCollisionError(name, touching)
    return StateInCollisionError(name, bodies, checker.padding)


def goal_configurations(
    robot: Robot,
    checker: CollisionChecker,
    problem: PlanningProblem,
    start: FloatArray,
    max_goals: int,
    check_cancelled: Callable[[], None],
) -> FloatArray:
    """All goal configurations that may end a path, the nearest to the start first.

    Goals are alternatives: one that cannot be used is passed over as long as another can.

    Args:
        robot, checker: as usual.
        problem: its goals.
        start: validated (n,).
        max_goals: most configurations to make from each pose.
        check_cancelled: called before each goal, and each exact check; may raise.

    Returns:
        (k, n), k >= 1, all free.

    Raises:
        NoGoalError: if there are none.
        ProblemError: of the first goal, if none can be used.
    """
    if not problem.goals:
        raise NoGoalError
    usable: list[FloatArray] = []
    from_poses: list[FloatArray] = []
    first_error: ProblemError | None = None
    for goal in problem.goals:
        check_cancelled()
        try:
            if isinstance(goal, JointGoal):
                usable.extend(_continuous_windings(robot, free_state(robot, checker, "goal", goal.configuration)))
            else:
                from_poses.extend(_pose_configurations(robot, checker, goal, start, max_goals, check_cancelled))
        except ProblemError as error:
            first_error = first_error or error
    configurations = usable + from_poses
    if not configurations:
        assert first_error is not None
        raise first_error
    found = np.array(configurations)
    return np.asarray(found[np.argsort(np.linalg.norm(found - start, axis=1), kind="stable")])


def _continuous_windings(robot: Robot, goal: FloatArray) -> list[FloatArray]:
    """A goal state, and what differs from it by whole turns of continuous joints, for which a turn means nothing."""
    if not robot.continuous.any():
        return [goal]
    same = [
        wound for wound in robot.windings(goal) if np.array_equal(wound[~robot.continuous], goal[~robot.continuous])
    ]
    return same or [goal]


def _pose_configurations(
    robot: Robot,
    checker: CollisionChecker,
    goal: PoseGoal,
    start: FloatArray,
    max_goals: int,
    check_cancelled: Callable[[], None],
) -> list[FloatArray]:
    """Free configurations of a pose, at most `max_goals`."""
    branches = robot.inverse_kinematics(goal.pose, goal.frame)
    if not len(branches):
        raise UnreachablePoseError(goal.pose.position.tolist(), goal.frame or robot.tool_frame)
    is_free = checker.surely_free(branches)
    for index in np.flatnonzero(~is_free):
        check_cancelled()
        is_free[index] = checker.is_free(branches[index])
    free = branches[is_free]
    if not len(free):
        bodies = checker.colliding_bodies(branches[0])
        assert bodies is not None
        raise _collision(checker, "goal", branches[0], bodies)
    # A whole turn leaves the robot where it was, so windings need no check of their own. The nearest winding of every
    # branch comes before the second of any: branches differ in how they can be reached, windings seldom do.
    ranked: list[tuple[int, float, FloatArray]] = []
    for branch in free:
        wound, distances = closest_windings(branch, robot.lower, robot.upper, robot.revolute, start, max_goals)
        ranked += zip(range(len(wound)), distances.tolist(), wound, strict=True)
    ranked.sort(key=lambda entry: entry[:2])
    return [configuration for _, _, configuration in ranked[:max_goals]]
