"""An arm described by a URDF."""

from __future__ import annotations

import logging
import math
import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from bsp_informed_planner.errors import (
    InvalidOptionError,
    UnknownFrameError,
    UnknownJointError,
)
from bsp_informed_planner.robots.description import RobotDescription, XmlSource, read_description
from bsp_informed_planner.robots.inverse_kinematics import InverseKinematics, solver_for
from bsp_informed_planner.robots.kinematic_chain import KinematicChain
from bsp_informed_planner.robots.motion_bound import joint_axes, motion_levers, motion_radii
from bsp_informed_planner.robots.pinocchio_models import build_models
from bsp_informed_planner.robots.windings import windings
from bsp_informed_planner.scene.pose import FloatArray, Pose, frozen_array

logger = logging.getLogger(__name__)

# For joints whose URDF gives no velocity limit, or one of zero or infinity [rad/s or m/s].
DEFAULT_VELOCITY_LIMIT = 1.0
# URDFs hold no acceleration limits [rad/s^2 or m/s^2].
DEFAULT_ACCELERATION_LIMIT = 5.0


@dataclass(frozen=True)
class ArmSource:
    """What an arm was loaded from: the arguments of `load_arm`, its paths absolute."""

    urdf: XmlSource
    srdf: XmlSource | None = None
    package_dirs: tuple[str, ...] = ()
    tool_frame: str | None = None
    locked_joints: Mapping[str, float] = field(default_factory=dict)
    acceleration_limits: float | Mapping[str, float] = DEFAULT_ACCELERATION_LIMIT


def load_arm(
    urdf: XmlSource,
    srdf: XmlSource | None = None,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    tool_frame: str | None = None,
    locked_joints: Mapping[str, float] | None = None,
    acceleration_limits: float | Mapping[str, float] = DEFAULT_ACCELERATION_LIMIT,
) -> ArmRobot:
    """Load an arm from its URDF and SRDF.

    Revolute, continuous, prismatic and fixed joints are supported. Continuous joints become revolute with limits of
    -2 pi and 2 pi. Collision geometry is the URDF's own. All pairs of links are checked for collision with each other
    but those that a joint connects, those that cannot move relative to each other, and those that the SRDF disables.

    Args:
        urdf: path of a URDF file, or the XML itself.
        srdf: path of an SRDF file, or the XML itself.
        package_dirs: folders in which the packages of `package://` URIs lie; meshes come from these folders, and from
            that of the URDF file, alone.
        tool_frame: the link whose origin is the reference point. Default: the parent link of the SRDF's end effector
            (or the tip of its chain), otherwise the link "tool0", otherwise the last link of the longest chain.
        locked_joints: joints to hold at a value [rad or m], such as those of a gripper or of another arm, by name or by
            pattern ("finger_*"). They are no part of a configuration. Joints that mimic a locked joint are held too.
        acceleration_limits: of all joints, or by joint name, in which case the others have
            `DEFAULT_ACCELERATION_LIMIT` [rad/s^2 or m/s^2].

    Raises:
        RobotDescriptionError: if a file or a mesh is missing or cannot be read, or no joint is left to move.
        UnsupportedJointError: for a mimic, floating, planar or other joint that is neither supported nor locked.
        UnknownJointError: if `locked_joints` or `acceleration_limits` name no joint that moves.
        UnknownFrameError: if `tool_frame` is not a link.
        InvalidOptionError: if a locked value is outside its joint's limits, or an acceleration limit is not positive.
    """
    description = read_description(urdf, srdf, package_dirs, locked_joints)
    model, collision_model = build_models(description)
    source = ArmSource(
        urdf=_absolute(urdf),
        srdf=_absolute(srdf) if srdf is not None else None,
        package_dirs=tuple(os.path.abspath(path) for path in package_dirs),
        tool_frame=tool_frame,
        locked_joints=dict(locked_joints or {}),
        acceleration_limits=acceleration_limits,
    )
    return ArmRobot(description, model, collision_model, source)


class ArmRobot:
    """An arm of revolute and prismatic joints on a fixed base; `load_arm` makes it. See `Robot` for its attributes.

    Immutable; threads may share one. A pickled arm is loaded again from its files.

    Attributes:
        source: what it was loaded from.
        description: what that says.
        revolute: (n,) which joints turn; the others are prismatic.
    """

    def __init__(
        self,
        description: RobotDescription,
        model: pin.Model,
        collision_model: pin.GeometryModel,
        source: ArmSource,
    ) -> None:
        """Use `load_arm`."""
        self.source = source
        self.description = description
        self.model = model
        self.collision_model = collision_model
        self.name = description.name
        by_place = sorted(range(1, model.njoints), key=lambda joint: int(model.joints[joint].idx_v))
        self.joint_names: tuple[str, ...] = tuple(model.names[joint] for joint in by_place)
        self.lower: FloatArray = frozen_array(model.lowerPositionLimit)
        self.upper: FloatArray = frozen_array(model.upperPositionLimit)
        self.continuous = np.array([name in description.continuous_joints for name in self.joint_names], dtype=np.bool_)
        self.revolute = ~joint_axes(model)[1][[joint - 1 for joint in by_place]]
        for flags in (self.continuous, self.revolute):
            flags.setflags(write=False)
        self.velocity_limits: FloatArray = frozen_array(self._velocity_limits())
        self.acceleration_limits: FloatArray = frozen_array(self._acceleration_limits(source.acceleration_limits))
        self.workspace_dimension = 3
        self.root_frame = description.root_link
        self._frame_ids = {f.name: i for i, f in enumerate(model.frames) if f.type == pin.FrameType.BODY}
        self.tool_frame = source.tool_frame or self._default_tool_frame()
        self._require_frame(self.tool_frame)
        self.motion_levers: FloatArray = frozen_array(motion_levers(model, collision_model))
        self.motion_radii: FloatArray = frozen_array(motion_radii(self.motion_levers))
        self._home = np.clip(np.zeros(len(by_place)), self.lower, self.upper)
        self._lock = threading.Lock()
        self._chains: dict[str, KinematicChain] = {}
        self._solvers: dict[str, InverseKinematics] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return _reloaded, (self.source,)

    @property
    def dof(self) -> int:
        """Number of joints n."""
        return len(self.joint_names)

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of all links."""
        return tuple(self._frame_ids)

    @property
    def orientation_free(self) -> bool:
        """False."""
        return False

    def forward_kinematics(self, configuration: FloatArray, frame: str | None = None) -> Pose:
        """See `Robot.forward_kinematics`."""
        matrix = self.forward_matrix(configuration, frame)
        return Pose(matrix[:3, 3], pin.Quaternion(matrix[:3, :3]).coeffs())

    def forward_matrix(self, configuration: FloatArray, frame: str | None = None) -> FloatArray:
        """(4, 4) pose of a link (default: the tool frame) in the root frame. Faster than `forward_kinematics`.

        Raises:
            UnknownFrameError: for a frame that the robot does not have.
            ValueError: if the configuration has not n values.
        """
        values = np.asarray(configuration, dtype=np.float64)
        if values.shape != (self.dof,):
            raise ValueError(f"a configuration of shape {values.shape}: expected ({self.dof},)")
        chain = self.chain(frame)
        return chain.forward(values[chain.indices])

    def reference_points(self, configurations: FloatArray) -> FloatArray:
        """See `Robot.reference_points`."""
        chain = self.chain()
        return chain.positions(np.asarray(configurations, dtype=np.float64)[:, chain.indices])

    def inverse_kinematics(
        self, pose: Pose, frame: str | None = None, rng: np.random.Generator | None = None
    ) -> FloatArray:
        """All configurations found that bring a link to a pose. See `Robot.inverse_kinematics`.

        Arms of six revolute joints that EAIK can solve are solved in closed form, others numerically; then at most 16
        configurations are returned. Joints that do not move the frame are held at zero, or at the limit next to it.
        """
        solver = self._solver(frame or self.tool_frame)
        return self._configurations(solver, solver.solve(_matrix(pose), rng))

    def inverse_kinematics_batch(
        self, poses: Sequence[Pose] | FloatArray, frame: str | None = None, rng: np.random.Generator | None = None
    ) -> list[FloatArray]:
        """`inverse_kinematics` of many poses, given as such or as an array of matrices (k, 4, 4).

        Raises:
            ValueError: if a matrix is not finite or its rotation is none.
        """
        if isinstance(poses, np.ndarray):
            matrices = _checked_matrices(poses)
        else:
            matrices = np.array([_matrix(pose) for pose in poses]).reshape(-1, 4, 4)
        solver = self._solver(frame or self.tool_frame)
        return [self._configurations(solver, values) for values in solver.solve_batch(matrices, rng)]

    def inverse_kinematics_method(self, frame: str | None = None) -> str:
        """How inverse kinematics of a frame (default: the tool frame) is solved, in words.

        Raises:
            UnknownFrameError: for a frame that the robot does not have.
        """
        return self._solver(frame or self.tool_frame).method

    def joints_moving(self, frame: str | None = None) -> tuple[str, ...]:
        """The joints between the root and a frame (default: the tool frame): the others do not move it.

        Raises:
            UnknownFrameError: for a frame that the robot does not have.
        """
        return tuple(self.joint_names[i] for i in self.chain(frame).indices)

    def windings(self, configuration: FloatArray) -> FloatArray:
        """See `Robot.windings`; at most 4096, the configuration itself first."""
        return windings(np.asarray(configuration, dtype=np.float64), self.lower, self.upper, self.revolute)

    def _configurations(self, solver: InverseKinematics, values: FloatArray) -> FloatArray:
        """(k, n) from values of the chain's joints (k, m)."""
        if solver.chain.dof == self.dof:
            return values  # the joints of a chain come in the order of the configuration
        configurations = np.tile(self._home, (len(values), 1))
        configurations[:, solver.chain.indices] = values
        return configurations

    def chain(self, frame: str | None = None) -> KinematicChain:
        """The joints between the root and a frame (default: the tool frame).

        Raises:
            UnknownFrameError: for a frame that the robot does not have.
        """
        frame = frame or self.tool_frame
        if frame not in self._chains:
            self._chains[frame] = KinematicChain.to_frame(self.model, self._require_frame(frame))
        return self._chains[frame]

    def _solver(self, frame: str) -> InverseKinematics:
        if frame not in self._solvers:
            with self._lock:
                self._solvers[frame] = solver_for(self.model, self._require_frame(frame))
        return self._solvers[frame]

    def _require_frame(self, frame: str) -> int:
        if frame not in self._frame_ids:
            raise UnknownFrameError(frame, self.frames)
        return self._frame_ids[frame]

    def _default_tool_frame(self) -> str:
        if self.description.end_effector_link is not None:
            return self.description.end_effector_link
        if "tool0" in self._frame_ids:
            return "tool0"
        supports, frames = self.model.supports, self.model.frames
        depths = {name: len(supports[frames[i].parentJoint]) for name, i in self._frame_ids.items()}
        deepest = max(depths.values())
        return [name for name, depth in depths.items() if depth == deepest][-1]

    def _velocity_limits(self) -> list[float]:
        limits = [self.description.joint_limits[name][2] for name in self.joint_names]
        missing = [name for name, limit in zip(self.joint_names, limits, strict=True) if math.isnan(limit)]
        if missing:
            logger.warning(
                "%s: no usable velocity limit for %s; %g rad/s or m/s is taken",
                self.name,
                ", ".join(missing),
                DEFAULT_VELOCITY_LIMIT,
            )
        return [DEFAULT_VELOCITY_LIMIT if math.isnan(limit) else limit for limit in limits]

    def _acceleration_limits(self, limits: float | Mapping[str, float]) -> list[float]:
        if isinstance(limits, Mapping):
            unknown = [name for name in limits if name not in self.joint_names]
            if unknown:
                raise UnknownJointError(unknown, self.joint_names)
            values = [float(limits.get(name, DEFAULT_ACCELERATION_LIMIT)) for name in self.joint_names]
        else:
            values = [float(limits)] * len(self.joint_names)
        for name, value in zip(self.joint_names, values, strict=True):
            if not 0.0 < value < math.inf:
                raise InvalidOptionError(f"acceleration limit of '{name}'", value, "a positive number")
        return values


def _absolute(source: XmlSource) -> XmlSource:
    if isinstance(source, str) and source.lstrip()[:1] == "<":
        return source
    return os.path.abspath(source)


def _reloaded(source: ArmSource) -> ArmRobot:
    return load_arm(**vars(source))


def _matrix(pose: Pose) -> FloatArray:
    """(4, 4) matrix of a pose, faster than by its property."""
    x, y, z, w = pose.quaternion.tolist()
    px, py, pz = pose.position.tolist()
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w), px],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w), py],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y), pz],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _checked_matrices(matrices: FloatArray) -> FloatArray:
    matrices = np.ascontiguousarray(matrices, dtype=np.float64)
    if matrices.ndim != 3 or matrices.shape[1:] != (4, 4):
        raise ValueError(f"poses of shape {matrices.shape}: expected (k, 4, 4)")
    message = "a matrix is no pose: it is not finite, or its rotation is none"
    if not np.isfinite(matrices).all():
        raise ValueError(message)
    rotations = matrices[:, :3, :3]
    orthonormal = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0) < 1e-6
    if not (orthonormal & (np.linalg.det(rotations) > 0.0)).all():
        raise ValueError(message)
    return matrices
