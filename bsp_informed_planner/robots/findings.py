"""What the numbers of a check mean for the user, and what to do about it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from bsp_informed_planner.robots.arm import DEFAULT_ACCELERATION_LIMIT, DEFAULT_VELOCITY_LIMIT, ArmRobot
from bsp_informed_planner.robots.report import (
    BodyReport,
    Finding,
    InverseKinematicsReport,
    JointReport,
    Severity,
)
from bsp_informed_planner.robots.self_collision import PairKind, SelfCollisionReport
from bsp_informed_planner.robots.survey import BodySurvey, JointSurvey, Survey

# Meshes beyond it are meant to be looked at; checks with them are slow.
MANY_TRIANGLES = 5000
# Longer links are mostly given in millimetres [m].
LONG_LINK = 10.0
# Fewer solved poses than this are worth a word.
GOOD_IK_SHARE = 0.98
# Pairs that collide more often than this are worth a word.
OFTEN_SHARE = 0.2
# What joints of grippers are called.
_FINGER = re.compile("grip|finger|jaw|thumb|hand", re.IGNORECASE)


def joints_must_be_held(joints: Sequence[JointSurvey]) -> list[Finding]:
    """Of joints that cannot be planned for, and are not held; those that mimic the same one are told of together."""
    sentences = []
    followers: dict[str, list[JointSurvey]] = {}
    for joint in joints:
        if joint.mimics:
            followers.setdefault(joint.lock, []).append(joint)
        else:
            sentences.append(
                f"joint '{joint.name}' is {joint.kind}, which moves in more than one way: hold it where its parent "
                f"'{joint.parent}' is, with --lock {joint.lock}, or plan in a URDF that begins at '{joint.child}'"
            )
    for lock, group in followers.items():
        names = ", ".join(f"'{joint.name}'" for joint in group)
        one = len(group) == 1
        leader = group[0].mimics if one else lock.partition("=")[0]
        sentences.append(
            f"{f'joint {names} mimics' if one else f'{len(group)} joints ({names}) mimic'} '{leader}', and joints that "
            f"move together as one are not supported: hold that one, and {'this follows' if one else 'these follow'} "
            f"it: --lock {lock}"
        )
    return [Finding(Severity.ERROR, "joints", sentence) for sentence in sentences]


def missing_meshes(bodies: Sequence[BodySurvey]) -> list[Finding]:
    """Of collision meshes that cannot be found: the first one of each package, and how many more there are."""
    packages: dict[str, list[BodySurvey]] = {}
    for body in bodies:
        if body.problem:
            packages.setdefault(body.file.partition("://")[2].partition("/")[0] or body.file, []).append(body)
    findings = []
    for package, group in packages.items():
        more = len(group) - 1
        others = f"; so it is with {more} more of '{package}'" if more else ""
        sentence = f"{group[0].problem}{others}; name the folder that holds its package by --package-dir"
        findings.append(Finding(Severity.ERROR, "geometry", sentence))
    return findings


def tip_findings(robot: ArmRobot, survey: Survey) -> list[Finding]:
    """Of a tool frame that was chosen among several that are as good."""
    if robot.description.end_effector_link == robot.tool_frame or robot.tool_frame == "tool0":
        return []
    parents = {joint.parent for joint in survey.joints}
    depths = {
        joint.child: len(robot.joints_moving(joint.child)) for joint in survey.joints if joint.child not in parents
    }
    others = [tip for tip, depth in depths.items() if depth > 0 and tip != robot.tool_frame]
    if not others:
        return []
    listed = ", ".join(others[:8]) + (", ..." if others[8:] else "")
    text = f"'{robot.tool_frame}' was taken as the tool frame, but the robot has other tips ({listed}): choose by"
    return [Finding(Severity.NOTE, "joints", f"{text} --tool-frame, or by an <end_effector> in an SRDF")]


def joint_findings(robot: ArmRobot, joints: tuple[JointReport, ...]) -> list[Finding]:
    """Of joints that should not move, and of limits that are missing."""
    findings = []
    idle = [joint for joint in joints if not joint.moves_tool]
    if idle:
        locks = " ".join(f"--lock {joint.name}={min(max(0.0, joint.lower), joint.upper):.4g}" for joint in idle)
        findings.append(
            Finding(
                Severity.WARNING,
                "joints",
                f"{len(idle)} joint(s) do not move the tool frame '{robot.tool_frame}' and make search harder: hold "
                f"them, e.g. {locks} (patterns such as finger_*=0 are understood), or choose another --tool-frame",
            )
        )
    fingers = [joint for joint in joints if joint.moves_tool and _FINGER.search(joint.name)]
    if fingers and len(fingers) < len(joints):
        locks = " ".join(f"--lock {joint.name}={min(max(0.0, joint.lower), joint.upper):.4g}" for joint in fingers)
        findings.append(
            Finding(
                Severity.WARNING,
                "joints",
                f"the tool frame '{robot.tool_frame}' seems to lie on a finger: choose a frame of the hand by "
                f"--tool-frame, and hold the fingers, e.g. {locks}",
            )
        )
    without = [joint.name for joint in joints if "velocity" in joint.defaults]
    if without:
        findings.append(
            Finding(
                Severity.WARNING,
                "joints",
                f"no velocity limit for {', '.join(without)}: {DEFAULT_VELOCITY_LIMIT:g} rad/s or m/s is taken; add "
                'velocity="..." to their <limit>',
            )
        )
    if len(joints) - len(idle) > 10:
        findings.append(
            Finding(
                Severity.WARNING,
                "joints",
                f"{len(joints) - len(idle)} joints move the tool: sampling is made for arms of 2 to 8; hold those that "
                "are not the arm's",
            )
        )
    findings.append(
        Finding(
            Severity.NOTE,
            "joints",
            f"URDFs hold no acceleration limits: {DEFAULT_ACCELERATION_LIMIT:g} rad/s^2 or m/s^2 is taken for all; "
            "give yours to load_arm(acceleration_limits=...), or scale them in requests",
        )
    )
    return findings


def geometry_findings(robot: ArmRobot, survey: Survey, bodies: tuple[BodyReport, ...]) -> list[Finding]:
    """Of links that are not checked, or slow to check."""
    if not bodies:
        text = "no link has collision geometry, so nothing could be checked: add <collision> to the links"
        return [Finding(Severity.ERROR, "geometry", text)]
    findings = []
    if not any(body.moves for body in bodies):
        text = "no link that moves has collision geometry, so nothing could be checked: add <collision> to the links"
        findings.append(Finding(Severity.ERROR, "geometry", text))
    have = {body.link for body in bodies}
    moving = [
        frame.name
        for frame in robot.model.frames
        if frame.name in survey.visual_links and frame.name not in have and int(frame.parentJoint) > 0
    ]
    if moving:
        findings.append(
            Finding(
                Severity.WARNING,
                "geometry",
                f"{', '.join(moving)} can be seen, but has no collision geometry: nothing keeps it clear of obstacles; "
                "add <collision>",
            )
        )
    for body in bodies:
        if max(body.size) > LONG_LINK:
            text = (
                f'{max(body.size):.0f} m long: if its mesh is in millimetres, add scale="0.001 0.001 0.001" to <mesh>'
            )
            findings.append(Finding(Severity.WARNING, "geometry", f"'{body.link}' is {text}"))
    triangles: Counter[str] = Counter()
    for body in bodies:
        triangles[body.link] += body.triangles
    heavy = [f"{link} ({count})" for link, count in triangles.items() if count > MANY_TRIANGLES]
    if heavy:
        findings.append(
            Finding(
                Severity.WARNING,
                "geometry",
                f"links of more than {MANY_TRIANGLES} triangles make checks slow: {', '.join(heavy)}; simplify their "
                "meshes, or take convex hulls or boxes as <collision>",
            )
        )
    return findings


def kinematics_findings(robot: ArmRobot, report: InverseKinematicsReport) -> list[Finding]:
    """Of poses that have no solution."""
    findings = []
    topic = "inverse kinematics"
    if not report.poses or not robot.joints_moving():
        text = f"no joint moves the tool frame '{robot.tool_frame}': choose another by --tool-frame"
        return [Finding(Severity.ERROR, topic, text)]
    share = report.solved / report.poses
    if share < GOOD_IK_SHARE:
        findings.append(
            Finding(
                Severity.WARNING,
                topic,
                f"{report.method} solves {100 * share:.0f} % of the poses that the arm has: goals given as poses may "
                "be called unreachable; give such goals as joint positions",
            )
        )
    count = len(robot.joints_moving())
    if count < 6:
        findings.append(
            Finding(
                Severity.NOTE,
                topic,
                f"with {count} joints the tool reaches few poses exactly: give goals as joint positions, or take poses "
                "from forward kinematics; keypoints lifted to configurations will be few, and sampling mostly uniform",
            )
        )
    elif report.method.startswith("numerical"):
        speed = f"{1e3 * report.seconds:.1f} ms a pose"
        text = f"no closed form is known for this arm: poses are solved numerically, {speed}"
        findings.append(Finding(Severity.NOTE, topic, text))
    return findings


def self_collision_findings(report: SelfCollisionReport, proposes_srdf: bool) -> list[Finding]:
    """Of pairs of links that should be exempt, or should not; an SRDF for those that never collide may be proposed."""
    findings = []
    topic = "self-collision"

    def listed(pairs: list[tuple[str, str]]) -> str:
        return ", ".join(f"{a} and {b}" for a, b in pairs[:6]) + (f", and {len(pairs) - 6} more" if pairs[6:] else "")

    always = [pair.links for pair in report.of_kind(PairKind.ALWAYS) if not pair.exempt]
    if always:
        severity = Severity.ERROR if report.free_share == 0.0 else Severity.WARNING
        findings.append(
            Finding(
                severity,
                topic,
                f"{listed(always)} always collide: their collision geometry overlaps; exempt them with an SRDF "
                "(--write-srdf FILE writes one, --srdf FILE uses it)",
            )
        )
    if report.free_share == 0.0 and not always:
        text = "the arm collides with itself in every configuration tried: look at the pairs below"
        findings.append(Finding(Severity.ERROR, topic, text))
    elif 0.0 < report.free_share < 0.05:
        text = f"only {100 * report.free_share:.1f} % of random configurations are free of self-collision"
        findings.append(Finding(Severity.WARNING, topic, f"{text}: planning will be slow; look at the pairs below"))
    often = [pair.links for pair in report.of_kind(PairKind.SOMETIMES) if pair.share >= OFTEN_SHARE and not pair.exempt]
    if often:
        findings.append(
            Finding(
                Severity.WARNING,
                topic,
                f"{listed(often)} collide in {100 * OFTEN_SHARE:.0f} % of the configurations or more, which leaves "
                "little room: if their geometry overlaps across a small link between them, simplify it, or exempt them",
            )
        )
    at_zero = [pair.links for pair in report.of_kind(PairKind.SOMETIMES) if pair.at_zero and not pair.exempt]
    if at_zero:
        findings.append(
            Finding(
                Severity.NOTE,
                topic,
                f"{listed(at_zero)} collide with all joints at zero, but not always; they stay checked. If the real "
                "robot does not touch itself there, simplify their geometry, or exempt them by hand",
            )
        )
    hidden = [pair.links for pair in report.of_kind(PairKind.SOMETIMES) if pair.exempt]
    if hidden:
        findings.append(
            Finding(
                Severity.WARNING,
                topic,
                f"the SRDF exempts {listed(hidden)}, which do collide in some configurations: no path is checked for "
                "that; take their <disable_collisions> out unless you know why they are there",
            )
        )
    if proposes_srdf and report.of_kind(PairKind.NEVER):
        count = len(report.of_kind(PairKind.NEVER))
        findings.append(
            Finding(
                Severity.NOTE,
                topic,
                f"{count} pairs of links never collided: an SRDF that exempts them makes checks faster "
                "(--write-srdf FILE)",
            )
        )
    return findings
