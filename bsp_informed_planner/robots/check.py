"""Does an arm's description serve for planning, and what should be changed in it?"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import coal
import numpy as np

from bsp_informed_planner.errors import BspPlannerError
from bsp_informed_planner.robots.arm import ArmRobot, load_arm
from bsp_informed_planner.robots.description import COMPOUND, XmlSource
from bsp_informed_planner.robots.findings import (
    geometry_findings,
    joint_findings,
    joints_must_be_held,
    kinematics_findings,
    missing_meshes,
    self_collision_findings,
    tip_findings,
)
from bsp_informed_planner.robots.report import (
    BodyReport,
    Finding,
    InverseKinematicsReport,
    JointReport,
    ReachReport,
    RobotReport,
    Severity,
    worst_first,
)
from bsp_informed_planner.robots.self_collision import sample_self_collisions
from bsp_informed_planner.robots.survey import Survey, survey_urdf
from bsp_informed_planner.scene.pose import FloatArray

# Configurations that the reach is taken from.
_REACH_SAMPLES = 5000


@dataclass(frozen=True)
class CheckOptions:
    """How thorough a check is.

    Attributes:
        samples: configurations that self-collision is looked for in.
        poses: for inverse kinematics.
        seed: of both.
        proposes_srdf: whether a finding says how to get an SRDF; not where one is being written anyway.
    """

    samples: int = 10_000
    poses: int = 200
    seed: int = 0
    proposes_srdf: bool = True


def check_robot(
    urdf: XmlSource,
    srdf: XmlSource | None = None,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    tool_frame: str | None = None,
    locked_joints: Mapping[str, float] | None = None,
    options: CheckOptions | None = None,
    on_progress: Callable[[str, int, int], None] | None = None,
) -> tuple[RobotReport, ArmRobot | None]:
    """Check a robot description as far as it goes.

    Joints that cannot be planned for and are not held are errors; so that the rest can be looked at all the same, they
    are held in the middle of their range.

    Args:
        urdf, srdf, package_dirs, tool_frame, locked_joints: as for `load_arm`.
        options: None for the defaults.
        on_progress: told the name of the part, and how much of how much of it is done.

    Returns:
        the report, and the arm that it is about; None if none could be loaded.
    """
    options = options or CheckOptions()
    locked = dict(locked_joints or {})
    findings: list[Finding] = []
    try:
        survey = survey_urdf(urdf, package_dirs, locked)
    except BspPlannerError as error:
        return RobotReport("", findings=(Finding(Severity.ERROR, "description", str(error)),)), None
    report = RobotReport(survey.name, surveyed=survey.joints)
    unusable = []
    for joint in survey.joints:
        if joint.held is None and (joint.mimics or joint.kind in COMPOUND) and joint.kind != "fixed":
            unusable.append(joint)
            name, _, value = joint.lock.partition("=")
            locked.setdefault(name, float(value))
    missing = [body.problem for body in survey.bodies if body.problem]
    findings += joints_must_be_held(unusable) + missing_meshes(survey.bodies)
    tell = on_progress or _nobody
    tell("loading", 0, 1)
    try:
        robot = load_arm(urdf, srdf, package_dirs, tool_frame, locked)
    except BspPlannerError as error:
        if str(error) not in missing:
            findings.append(Finding(Severity.ERROR, "description", str(error)))
        return replace(report, findings=worst_first(findings)), None
    finally:
        tell("loading", 1, 1)

    joints, bodies = _joints(robot, survey), _bodies(robot)
    findings += joint_findings(robot, joints) + geometry_findings(robot, survey, bodies)
    if tool_frame is None:
        findings += tip_findings(robot, survey)
    rng = np.random.default_rng(options.seed)
    reach = _reach(robot, rng)
    kinematics = _inverse_kinematics(robot, options.poses, rng, tell)
    findings += kinematics_findings(robot, kinematics)
    self_collision = None
    if bodies:
        self_collision = sample_self_collisions(
            robot,
            options.samples,
            rng,
            lambda done, total: tell("self-collision", done, total),
        )
        findings += self_collision_findings(self_collision, srdf is None and options.proposes_srdf)
    report = replace(
        report,
        root_frame=robot.root_frame,
        tool_frame=robot.tool_frame,
        joints=joints,
        held=dict(robot.description.locked_joints),
        bodies=bodies,
        inverse_kinematics=kinematics,
        reach=reach,
        self_collision=self_collision,
        findings=worst_first(findings),
    )
    return report, robot


def _nobody(part: str, done: int, total: int) -> None:
    """Told of progress where nobody wants to know."""


def _joints(robot: ArmRobot, survey: Survey) -> tuple[JointReport, ...]:
    by_name = {joint.name: joint for joint in survey.joints}
    moving = set(robot.joints_moving())
    return tuple(
        JointReport(
            name=name,
            kind=by_name[name].kind,
            lower=float(robot.lower[i]),
            upper=float(robot.upper[i]),
            velocity=float(robot.velocity_limits[i]),
            acceleration=float(robot.acceleration_limits[i]),
            defaults=(("velocity",) if math.isnan(by_name[name].velocity) else ()) + ("acceleration",),
            moves_tool=name in moving,
        )
        for i, name in enumerate(robot.joint_names)
    )


def _bodies(robot: ArmRobot) -> tuple[BodyReport, ...]:
    bodies = []
    for item in robot.collision_model.geometryObjects:
        geometry = item.geometry
        geometry.computeLocalAABB()
        size = np.asarray(geometry.aabb_local.max_) - np.asarray(geometry.aabb_local.min_)
        is_mesh = isinstance(geometry, coal.BVHModelBase)
        bodies.append(
            BodyReport(
                link=robot.model.frames[item.parentFrame].name,
                kind="mesh" if is_mesh else type(geometry).__name__.lower(),
                triangles=int(geometry.num_tris) if is_mesh else 0,
                size=(float(size[0]), float(size[1]), float(size[2])),
                moves=int(item.parentJoint) > 0,
            )
        )
    return tuple(bodies)


def _reach(robot: ArmRobot, rng: np.random.Generator) -> ReachReport:
    chain = robot.chain()
    values = rng.uniform(chain.lower, chain.upper, (_REACH_SAMPLES, chain.dof))
    points = np.array([chain.forward(row)[:3, 3] for row in values])
    lower, upper = points.min(axis=0), points.max(axis=0)
    return ReachReport(
        lower=(float(lower[0]), float(lower[1]), float(lower[2])),
        upper=(float(upper[0]), float(upper[1]), float(upper[2])),
        distance=float(np.linalg.norm(points - chain.offsets[0], axis=1).max()),
        bound=chain.reach,
    )


def _inverse_kinematics(
    robot: ArmRobot, poses: int, rng: np.random.Generator, on_progress: Callable[[str, int, int], None]
) -> InverseKinematicsReport:
    moving = [robot.joint_names.index(name) for name in robot.joints_moving()]
    configurations = rng.uniform(robot.lower, robot.upper, (poses, robot.dof))
    targets = np.array([robot.forward_matrix(configuration) for configuration in configurations])
    on_progress("inverse kinematics", 0, poses)
    robot.inverse_kinematics_batch(targets[:1])  # the solver is made with the first
    solved = recovered = solutions = 0
    begin = time.perf_counter()
    answers = []
    for done, target in enumerate(targets, start=1):
        answers += robot.inverse_kinematics_batch(target[None])
        on_progress("inverse kinematics", done, poses)
    seconds = time.perf_counter() - begin
    for configuration, target, answer in zip(configurations, targets, answers, strict=True):
        right = [row for row in answer if np.abs(robot.forward_matrix(row) - target).max() < 1e-5]
        solved += bool(right)
        solutions += len(right)
        recovered += any(_same(robot, row[moving], configuration[moving], moving) for row in right)
    return InverseKinematicsReport(
        method=robot.inverse_kinematics_method(),
        poses=poses,
        solved=solved,
        recovered=None if len(moving) > 6 else recovered,
        solutions=solutions / max(poses, 1),
        seconds=seconds / max(poses, 1),
    )


def _same(robot: ArmRobot, first: FloatArray, second: FloatArray, joints: list[int]) -> bool:
    """Whether two configurations of some joints are equal up to full turns."""
    difference = first - second
    turns = robot.revolute[joints]
    difference[turns] = np.remainder(difference[turns] + np.pi, 2 * np.pi) - np.pi
    return bool(np.abs(difference).max(initial=0.0) < 1e-3)
