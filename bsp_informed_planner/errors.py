"""Everything that can go wrong, one class a failure, each with the data that a caller needs to act.

The library raises these and knows nothing of error codes; `bsp_informed_planner.nodes.error_codes` maps each class to a
MoveIt error code, once. The text of an exception is a sentence that names the culprit.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence


def _like(name: str, known: Sequence[str]) -> str:
    """ " (did you mean ...?)" with the known names that are most like a name; empty if none is."""
    close = difflib.get_close_matches(name, known, n=2)
    return f" (did you mean {' or '.join(repr(other) for other in close)}?)" if close else ""


class BspPlannerError(Exception):
    """Base of all errors of this package."""


# --- scene ---------------------------------------------------------------------------------------------------------


class SceneError(BspPlannerError):
    """A scene, or a change of it, is not usable."""


class InvalidObstacleError(SceneError):
    """An obstacle's data make no solid body: NaN, a size of zero, a mesh without volume, a wrong index.

    Attributes:
        obstacle_id: which obstacle.
        reason: what is wrong with it.
    """

    def __init__(self, obstacle_id: str, reason: str) -> None:
        self.obstacle_id = obstacle_id
        self.reason = reason
        super().__init__(f"obstacle '{obstacle_id}': {reason}")


class UnknownObstacleError(SceneError):
    """An operation names an obstacle that is not in the scene.

    Attributes:
        obstacle_id: the id that was named.
        operation: what was to be done with it, e.g. "MOVE".
        known: ids of the scene.
    """

    def __init__(self, obstacle_id: str, operation: str, known: Sequence[str]) -> None:
        self.obstacle_id = obstacle_id
        self.operation = operation
        self.known = tuple(known)
        listed = ", ".join(self.known[:10]) + (", ..." if len(self.known) > 10 else "")
        super().__init__(f"{operation}: no obstacle '{obstacle_id}' in the scene (it has: {listed or 'none'})")


class InvalidWorkspaceError(SceneError):
    """Workspace bounds are not finite, or the lower is not below the upper."""


class SceneFormatError(SceneError):
    """A scene file cannot be read.

    Attributes:
        path: the file.
        reason: what is wrong, with the place in the file.
    """

    def __init__(self, path: str, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"{path}: {reason}")


class SceneUnavailableError(SceneError):
    """No scene has been received yet."""


class SceneRefusedError(SceneError):
    """The newest scene message was refused, so the scene in force is not what its sender believes.

    Attributes:
        reason: the sentence of the refusal.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(f"the newest scene message was refused ({reason}); send a correct one before planning")


class EmptySceneError(SceneError):
    """The scene holds no obstacle, which on a robot mostly means that whoever publishes it is broken."""


class SceneRevisionError(SceneError):
    """A plan was asked for on a revision that is not the one in force.

    Attributes:
        asked: the revision of the request.
        available: the revision in force.
    """

    def __init__(self, asked: int, available: int) -> None:
        self.asked = asked
        self.available = available
        super().__init__(f"scene revision {asked} was asked for, revision {available} is in force")


class SceneEpochError(SceneError):
    """A plan was asked for on a scene of another epoch: the decomposition node has been restarted in between.

    Attributes:
        asked: the epoch of the request.
        available: the epoch in force; 0: none is known yet.
    """

    def __init__(self, asked: int, available: int) -> None:
        self.asked = asked
        self.available = available
        super().__init__(
            f"a scene of epoch {asked} was asked for, epoch {available} is in force: the decomposition node has been "
            "restarted; publish the scene again"
            if available > asked
            else f"a scene of epoch {asked} was asked for, which has not been heard of (known: {available})"
        )


class UnknownFrameError(BspPlannerError):
    """A frame is neither the planning frame nor a frame of the robot.

    Attributes:
        frame: the name that was given.
        known: names that would have been understood.

    The argument `of` says whose frame it is.
    """

    def __init__(self, frame: str, known: Sequence[str], of: str = "") -> None:
        self.frame = frame
        self.known = tuple(known)
        listed = ", ".join(self.known[:12]) + (", ..." if len(self.known) > 12 else "")
        super().__init__(f"{of + ': ' if of else ''}unknown frame '{frame}'{_like(frame, known)} (known: {listed})")


# --- robot ---------------------------------------------------------------------------------------------------------


class RobotError(BspPlannerError):
    """A robot description is not usable."""


class RobotDescriptionError(RobotError):
    """A URDF or SRDF cannot be read, or a mesh of it is missing."""


class RobotNotReadyError(RobotError):
    """The collision bounds of a robot are still being built, once for each description, and for what it holds.

    Attributes:
        robot: its name, and what it holds.
        share: of the work that is done, in [0, 1]; None: it is not known.
    """

    def __init__(self, robot: str, share: float | None = None) -> None:
        self.robot = robot
        self.share = share
        done = "" if share is None else f", {100.0 * share:.0f} % are done"
        super().__init__(f"the collision bounds of robot '{robot}' are being built{done}; ask again soon")


class UnsupportedJointError(RobotError):
    """A joint of a kind that cannot be planned for.

    Attributes:
        joint: its name.
        kind: e.g. "a mimic of 'finger'", "floating".
        lock: what would hold it still, as "NAME=VALUE"; empty if nothing would.
    """

    def __init__(self, joint: str, kind: str, lock: str = "") -> None:
        self.joint = joint
        self.kind = kind
        self.lock = lock
        held = f"hold this one still (--lock {lock}, parameter locked_joints)" if lock else "make this one fixed"
        super().__init__(
            f"joint '{joint}' is {kind}: only revolute, continuous, prismatic and fixed joints can move; {held}"
        )


class UnknownJointError(RobotError):
    """A state names joints that the robot does not have.

    Attributes:
        joints: the unknown names.
        known: the names of the robot's joints.
    """

    def __init__(self, joints: Sequence[str], known: Sequence[str]) -> None:
        self.joints = tuple(joints)
        self.known = tuple(known)
        named = ", ".join(f"{joint}{_like(joint, known)}" for joint in self.joints)
        super().__init__(f"unknown joint(s) {named}; the robot has {', '.join(self.known)}")


# --- problem -------------------------------------------------------------------------------------------------------


class ProblemError(BspPlannerError):
    """A planning problem is ill-posed. `state` says which end: "start" or "goal"."""

    state: str


class InvalidStateError(ProblemError):
    """A state has the wrong number of joints, or a value that is not finite.

    Attributes:
        state: "start" or "goal".
        reason: what is wrong.
    """

    def __init__(self, state: str, reason: str) -> None:
        self.state = state
        self.reason = reason
        super().__init__(f"{state}: {reason}")


class StateOutsideLimitsError(ProblemError):
    """A joint is outside its limits.

    Attributes:
        state: "start" or "goal".
        joint: name of the first joint that is.
        value, lower, upper: its value and limits [rad or m].
    """

    def __init__(self, state: str, joint: str, value: float, lower: float, upper: float) -> None:
        self.state = state
        self.joint = joint
        self.value = value
        self.lower = lower
        self.upper = upper
        super().__init__(f"{state}: joint '{joint}' at {value:.4f} is outside its limits [{lower:.4f}, {upper:.4f}]")


class StateInCollisionError(ProblemError):
    """A state is in collision, or closer to an obstacle than the padding.

    Attributes:
        state: "start" or "goal".
        bodies: the names of two bodies that touch, or are too close: links of the robot, or obstacles.
        padding: that they do not keep, though they do not touch [m]; 0: they touch.
    """

    def __init__(self, state: str, bodies: tuple[str, str], padding: float = 0.0) -> None:
        self.state = state
        self.bodies = bodies
        self.padding = padding
        first, second = bodies
        super().__init__(
            f"{state}: '{first}' comes closer to '{second}' than the padding of {padding:g} m"
            if padding
            else f"{state}: '{first}' collides with '{second}'"
        )


class UnreachablePoseError(ProblemError):
    """Inverse kinematics found no configuration for a goal pose.

    Attributes:
        position: the position asked for [m].
        frame: the frame of the robot that was to be brought there.
    """

    def __init__(self, position: Sequence[float], frame: str, state: str = "goal") -> None:
        self.state = state
        self.position = tuple(float(v) for v in position)
        self.frame = frame
        at = ", ".join(f"{v:.3f}" for v in self.position)
        super().__init__(f"{state}: no configuration brings frame '{frame}' to the pose at ({at}) m")


class NoGoalError(ProblemError):
    """A request without any goal."""

    def __init__(self) -> None:
        self.state = "goal"
        super().__init__("no goal was given: neither joint states nor poses")


class StateUnavailableError(BspPlannerError):
    """A request leaves joints to `joint_states`, and no message there has named them yet.

    Attributes:
        joints: the joints whose positions are not known.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self.joints = tuple(joints)
        super().__init__(
            f"start: no position of joint(s) {', '.join(self.joints)} in the request, nor a recent one on joint_states"
        )


class InvalidOptionError(BspPlannerError):
    """An option of a request or parameter is outside its range.

    Attributes:
        option: its name.
        value: what was given.
        expected: the range in words.
    """

    def __init__(self, option: str, value: object, expected: str) -> None:
        self.option = option
        self.value = value
        self.expected = expected
        super().__init__(f"{option} = {value!r}: expected {expected}")


class UnsupportedRequestError(BspPlannerError):
    """A message asks for something that this planner does not do, and that cannot be left out without harm.

    Attributes:
        field: of the message.
        reason: what is not supported about it.
    """

    def __init__(self, field: str, reason: str) -> None:
        self.field = field
        self.reason = reason
        super().__init__(f"{field}: {reason}")


class UnknownParameterError(BspPlannerError):
    """A node was given a parameter that it does not have.

    Attributes:
        name: of the parameter.
        node: its name.
        similar: parameters that it has and that may have been meant.
    """

    def __init__(self, name: str, node: str, similar: Sequence[str]) -> None:
        self.name = name
        self.node = node
        self.similar = tuple(similar)
        hint = f"; did you mean {' or '.join(self.similar)}?" if self.similar else ""
        super().__init__(f"{node} has no parameter '{name}'{hint}")


class UnknownNodeError(BspPlannerError):
    """A section of a ROS parameter file is for none of the nodes.

    Attributes:
        path: of the file.
        section: name of a node, perhaps with wildcards.
        known: names of the nodes, with their namespace.
    """

    def __init__(self, path: str, section: str, known: Sequence[str]) -> None:
        self.path = path
        self.section = section
        self.known = tuple(known)
        names = {name.rsplit("/", 1)[1]: name for name in self.known}
        close = difflib.get_close_matches(section.rsplit("/", 1)[1], names, n=1)
        meant = section.rsplit("/", 1)[0] + "/" + close[0] if close else ""
        if close and meant == section:
            # The name is right, and the namespace is not.
            meant = names[close[0]]
        hint = f" (did you mean '{meant}'?)" if meant else ""
        super().__init__(f"{path}: section '{section}' is for none of the nodes {', '.join(self.known)}{hint}")


class UnknownPlannerError(BspPlannerError):
    """An unknown planner id.

    Attributes:
        planner_id: what was asked for.
        known: the ids that exist.
    """

    def __init__(self, planner_id: str, known: Sequence[str]) -> None:
        self.planner_id = planner_id
        self.known = tuple(known)
        super().__init__(f"unknown planner_id '{planner_id}' (known: {', '.join(self.known)})")


class MissingPackageError(BspPlannerError):
    """What was asked for needs a Python package that is not installed.

    Attributes:
        purpose: what it is needed for, e.g. "planner_id 'ompl_rrt_connect'".
        package: its name.
        extra: the extra of this package that brings it.
    """

    def __init__(self, purpose: str, package: str, extra: str) -> None:
        self.purpose = purpose
        self.package = package
        self.extra = extra
        super().__init__(
            f"{purpose} needs the package '{package}', which is not installed: "
            f"pip install 'bsp_informed_planner[{extra}]'"
        )


class UnknownSamplerError(BspPlannerError):
    """An unknown sampler id, or model of the inference node.

    Attributes:
        sampler_id: what was asked for.
        known: the ids that exist.
    """

    def __init__(self, sampler_id: str, known: Sequence[str]) -> None:
        self.sampler_id = sampler_id
        self.known = tuple(known)
        super().__init__(f"unknown sampler_id '{sampler_id}' (known: {', '.join(self.known)})")


# --- search --------------------------------------------------------------------------------------------------------


class PlanningFailedError(BspPlannerError):
    """The search ended without a verified path."""


class PlanningTimeoutError(PlanningFailedError):
    """The time was over before a verified path was found.

    Attributes:
        allowed_seconds: the time that was allowed [s].
        samples: how many samples had been drawn.
    """

    def __init__(self, allowed_seconds: float, samples: int) -> None:
        self.allowed_seconds = allowed_seconds
        self.samples = samples
        super().__init__(f"no path found within {allowed_seconds:.2f} s ({samples} samples)")


class SamplesExhaustedError(PlanningFailedError):
    """All samples allowed were drawn without finding a path.

    Attributes:
        samples: how many.
    """

    def __init__(self, samples: int) -> None:
        self.samples = samples
        super().__init__(f"no path found with {samples} samples")


class PlanningCancelledError(PlanningFailedError):
    """The search was cancelled by its caller."""

    def __init__(self) -> None:
        super().__init__("planning was cancelled")


class PlannerProcessError(PlanningFailedError):
    """The process in which a planner ran failed.

    Attributes:
        planner_id: what ran there.
        reason: how it failed.
    """

    def __init__(self, planner_id: str, reason: str) -> None:
        self.planner_id = planner_id
        self.reason = reason
        super().__init__(f"the worker process of '{planner_id}' {reason}")


class QueueFullError(BspPlannerError):
    """More plans are asked for at once than may wait.

    Attributes:
        queue_size: how many may.
    """

    def __init__(self, queue_size: int) -> None:
        self.queue_size = queue_size
        super().__init__(f"the planner is busy and {queue_size} more plans wait already; ask again later")


class NodeInactiveError(BspPlannerError):
    """A lifecycle node is asked to work while it is not active.

    Attributes:
        node: its name.
    """

    def __init__(self, node: str) -> None:
        self.node = node
        super().__init__(f"{node} is not active")


class TrajectoryTimingError(BspPlannerError):
    """No timing within the velocity and acceleration limits was found for a path."""


class KeypointsUnavailableError(BspPlannerError):
    """No keypoint chain connects start and goal; `reason` says why."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


class InvalidDecompositionError(BspPlannerError):
    """The arrays of a decomposition, e.g. of a received one, do not fit together."""


# --- experience ----------------------------------------------------------------------------------------------------


class DatasetError(BspPlannerError):
    """A dataset of experience cannot be read or written.

    Attributes:
        path: its folder, or the file in it.
        reason: what is wrong.
    """

    def __init__(self, path: str, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"{path}: {reason}")


class DatasetMismatchError(DatasetError):
    """A dataset is of another robot, dimension or collection than is needed.

    Attributes:
        what: in which they differ, e.g. "joints of the robot".
        found: in the dataset.
        expected: what is needed.
    """

    def __init__(self, path: str, what: str, found: object, expected: object) -> None:
        self.what = what
        self.found = found
        self.expected = expected
        super().__init__(path, f"{what}: the dataset has {found}, expected {expected}")


# --- networks ------------------------------------------------------------------------------------------------------


class ModelError(BspPlannerError):
    """A model cannot be read or written.

    Attributes:
        path: its file.
        reason: what is wrong.
    """

    def __init__(self, path: str, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"{path}: {reason}")


class ModelMismatchError(BspPlannerError):
    """A model is of another robot, dimension or kind than is needed.

    Attributes:
        model: its name.
        what: in which they differ, e.g. "joints of the robot".
        found: in the model's card.
        expected: what is needed.
    """

    def __init__(self, model: str, what: str, found: object, expected: object) -> None:
        self.model = model
        self.what = what
        self.found = found
        self.expected = expected
        super().__init__(f"model '{model}': {what}: its card has {found}, expected {expected}")


#: What the text of the next one begins with, by which it is known where only texts arrive.
NO_MODEL = "no model of kind"


class ModelUnavailableError(BspPlannerError):
    """There is no model for a robot.

    Attributes:
        kinds: of models that would have done.
        folder: where they were looked for.
        robot: its name.
    """

    def __init__(self, kinds: Sequence[str], folder: str, robot: str) -> None:
        self.kinds = tuple(kinds)
        self.folder = folder
        self.robot = robot
        super().__init__(f"{NO_MODEL} {' or '.join(self.kinds)} for robot '{robot}' in {folder}")


class TrainingError(BspPlannerError):
    """A training cannot begin, go on, or be used; the text says why."""
