"""What a check of a robot description finds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum

from bsp_informed_planner.robots.self_collision import SelfCollisionReport
from bsp_informed_planner.robots.survey import JointSurvey


class Severity(str, Enum):
    """How bad a finding is."""

    ERROR = "error"  # nothing can be planned
    WARNING = "warning"  # something works less well than it could
    NOTE = "note"  # worth knowing


@dataclass(frozen=True)
class Finding:
    """Something that the user should know.

    Attributes:
        severity: how bad it is.
        topic: "description", "joints", "geometry", "inverse kinematics", "self-collision" or "planning".
        sentence: what it is, and the next step.
    """

    severity: Severity
    topic: str
    sentence: str


@dataclass(frozen=True)
class JointReport:
    """A joint that moves, as the planner takes it.

    Attributes:
        name: of the joint.
        kind: "revolute", "continuous" or "prismatic".
        lower, upper: limits [rad or m].
        velocity, acceleration: limits [per s, per s^2].
        defaults: which of "velocity" and "acceleration" are defaults, since the URDF says nothing of them.
        moves_tool: whether it moves the tool frame.
    """

    name: str
    kind: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    defaults: tuple[str, ...]
    moves_tool: bool


@dataclass(frozen=True)
class BodyReport:
    """A collision geometry, as the judge takes it.

    Attributes:
        link: whose it is.
        kind: "mesh", "box", "sphere", "cylinder" and so on.
        triangles: of a mesh; 0 of others.
        size: edges of its bounding box in its own frame [m].
        moves: whether a joint moves it.
    """

    link: str
    kind: str
    triangles: int
    size: tuple[float, float, float]
    moves: bool


@dataclass(frozen=True)
class InverseKinematicsReport:
    """Inverse kinematics of poses that random configurations have.

    Attributes:
        method: in words.
        poses: how many were tried.
        solved: for how many a configuration was found, each checked by forward kinematics.
        recovered: among whose configurations the one that made the pose was, where these are finitely many; None for
            arms of more than six joints.
        solutions: mean number of configurations found.
        seconds: mean time of a pose [s].
    """

    method: str
    poses: int
    solved: int
    recovered: int | None
    solutions: float
    seconds: float


@dataclass(frozen=True)
class ReachReport:
    """Where the tool frame gets in random configurations.

    Attributes:
        lower, upper: bounding box of its positions in the root frame [m].
        distance: the greatest from the origin of the first joint that moves it [m].
        bound: which no configuration exceeds [m].
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    distance: float
    bound: float


@dataclass(frozen=True)
class RobotReport:
    """What `check_robot` found out. Parts are missing (None or empty) where something before them failed.

    Attributes:
        name: of the robot.
        root_frame, tool_frame: names; empty if the robot could not be loaded.
        joints: those that move.
        held: values of those that do not, by name [rad or m].
        bodies: collision geometry.
        inverse_kinematics, reach, self_collision: see there.
        findings: the worst first.
    """

    name: str
    root_frame: str = ""
    tool_frame: str = ""
    joints: tuple[JointReport, ...] = ()
    held: dict[str, float] = field(default_factory=dict)
    bodies: tuple[BodyReport, ...] = ()
    surveyed: tuple[JointSurvey, ...] = ()
    inverse_kinematics: InverseKinematicsReport | None = None
    reach: ReachReport | None = None
    self_collision: SelfCollisionReport | None = None
    findings: tuple[Finding, ...] = ()

    @property
    def can_plan(self) -> bool:
        """Whether nothing was found that prevents planning."""
        return all(finding.severity is not Severity.ERROR for finding in self.findings)


def worst_first(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Findings by severity, otherwise in their order."""
    order = list(Severity)
    return tuple(sorted(findings, key=lambda finding: order.index(finding.severity)))
