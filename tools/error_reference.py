"""Writes docs/reference/errors.md: the codes of bsp_informed_planner/nodes/error_codes.py, and what to do about each.

python tools/error_reference.py
"""

from __future__ import annotations

import argparse
import inspect
from pathlib import Path

from bsp_informed_planner import errors
from bsp_informed_planner.nodes.error_codes import BY_CLASS, BY_STATE, ErrorCode

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "reference" / "errors.md"

HEAD = """# Error codes

Made by `python tools/error_reference.py` from the one place where an exception becomes a code.

Every answer has an `error_code` and a `message`. The codes are those of `moveit_msgs/MoveItErrorCodes`; 1 is success.
The message is a sentence that names the culprit: a joint, a link, an obstacle, a file. The library raises the
exceptions of `bsp_informed_planner.errors`, which have the same facts as attributes.
[Reading the errors](../tutorials/errors.md) shows some.
"""

#: What to do about each error that has a code.
ADVICE: dict[type[errors.BspPlannerError], str] = {
    errors.InvalidStateError: "Give one finite position for each joint, or name the joints that you give.",
    errors.StateOutsideLimitsError: "Compare with the limits of the URDF; `bsp-planner robot check` lists them.",
    errors.StateInCollisionError: (
        "Look at the two bodies that are named. Two links: the SRDF lacks the pair (`bsp-planner robot check`). An "
        "obstacle that is to be touched or held: `allowed_collisions` or `attached`. Too close for the padding, though "
        "nothing touches: ask for less `padding`."
    ),
    errors.UnreachablePoseError: (
        "Is the pose given for the right frame (`goal_frame`), and in the root frame? Is it within reach, with that "
        "orientation? An arm with fewer than six joints reaches few poses exactly: give joint positions."
    ),
    errors.NoGoalError: "Fill in `goal_states` or `goal_poses`.",
    errors.StateUnavailableError: (
        "Publish `joint_states`, or give the whole start. Messages older than the parameter `joint_state_max_age` do "
        "not count."
    ),
    errors.UnknownJointError: "Use the names that the message lists.",
    errors.UnknownFrameError: (
        "Scenes are given in the root frame of the robot, goals there or in any of its frames. A body is attached to a "
        "link of the robot, which is the planner's to know: `scene_status` only repeats the name."
    ),
    errors.UnknownPlannerError: "Take one of the ids that the message lists; empty is the default.",
    errors.UnknownSamplerError: "Take one of the ids that the message lists; empty is the default.",
    errors.UnsupportedRequestError: "Leave the named field empty: it asks for what this planner does not do.",
    errors.ModelUnavailableError: "Train one (`bsp-planner train`), or name a sampler that needs no model.",
    errors.MissingPackageError: "Install the extra that the message names.",
    errors.InvalidOptionError: "The message has the range.",
    errors.RobotNotReadyError: (
        "Wait: bounds are built once for a description, in up to a minute, and kept in the user's cache. `bsp-planner "
        "robot check` builds them ahead."
    ),
    errors.SceneUnavailableError: "Publish a scene on `obstacle_scene`, and wait for `scene_status`.",
    errors.EmptySceneError: (
        "Is what publishes obstacles alive? If there really are none, set the parameter `allow_empty_scene`."
    ),
    errors.SceneEpochError: "The decomposition node was restarted: publish the whole scene again, then plan.",
    errors.SceneRevisionError: "Ask for the revision in `scene_status`, or for 0, any. Then plan again.",
    errors.SceneRefusedError: "Correct the scene that was refused; the reason is in the message and in `scene_status`.",
    errors.SceneError: "The message names the obstacle and what is wrong with it; the scene before stays in force.",
    errors.PlanningCancelledError: "Nothing: it was asked for.",
    errors.PlanningTimeoutError: (
        "Allow more time, or look whether there is a way at all: `bsp-planner view`. A padding may have closed it."
    ),
    errors.PlannerProcessError: "Ask again: the process starts anew. The log of the node has the reason.",
    errors.PlanningFailedError: (
        "Allow more samples or time. The parameter `save_problem_on_failure` saves the problem, `bsp-planner plan` "
        "repeats it."
    ),
    errors.TrajectoryTimingError: "Are the velocity limits of the URDF greater than zero for every joint?",
    errors.QueueFullError: "Ask later, or raise the parameters `workers` and `queue_size`.",
    errors.KeypointsUnavailableError: (
        "The planner itself then searches without keypoints; only the services of the inference node say this."
    ),
}

#: Codes that no single exception has.
OTHERS = {
    ErrorCode.SUCCESS: ("A verified path, or a scene in force.", ""),
    ErrorCode.FAILURE: (
        "An error without a code of its own, e.g. a node that is not active.",
        "Read the message.",
    ),
    ErrorCode.CRASH: (
        "A defect of this package, or of what it uses.",
        "The log of the node has the traceback; please report it with the saved problem.",
    ),
    ErrorCode.COMMUNICATION_FAILURE: (
        "The MoveIt bridge does not reach the planner node.",
        "Are the nodes running, in the same namespace and domain?",
    ),
}


def _row(codes: tuple[ErrorCode, ...], kind: str, meaning: str, advice: str) -> str:
    numbers = "<br>".join(f"{int(code)} `{code.name}`" for code in codes)
    return f"| {numbers} | {kind} | {meaning} | {advice} |"


def _meaning(kind: type[errors.BspPlannerError]) -> str:
    return inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0].replace("\n", " ")


def page() -> str:
    """The page, as Markdown."""
    rows = [_row((code,), "", *text) for code, text in OTHERS.items()]
    rows += [_row(codes, f"`{kind.__name__}`", _meaning(kind), ADVICE[kind]) for kind, codes in BY_STATE.items()]
    rows += [_row((code,), f"`{kind.__name__}`", _meaning(kind), ADVICE[kind]) for kind, code in BY_CLASS]
    two = "Where a row has two codes, the first is about the start, the second about a goal.\n"
    return "\n".join([HEAD, two, "| code | exception | meaning | what to do |", "|---|---|---|---|", *rows]) + "\n"


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None).parse_args()
    PAGE.parent.mkdir(parents=True, exist_ok=True)
    PAGE.write_text(page(), encoding="utf-8")
    print(f"written: {PAGE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
