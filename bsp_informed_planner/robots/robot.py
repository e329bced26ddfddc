"""What a planner needs to know of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bsp_informed_planner.scene.pose import FloatArray, Pose


@runtime_checkable
class Robot(Protocol):
    """A robot with n joints, all of which move on a line or around an axis.

    A point robot in the plane and an arm are both of this kind: a Pinocchio model with collision geometry. Instances
    are immutable and hold no scratch memory, so threads may share one.

    Attributes:
        name: from its description.
        joint_names: (n,) in the order of a configuration.
        lower, upper: (n,) limits [rad or m]; those of a continuous joint are -2 pi and 2 pi, one turn of room either
            way from a start within (-pi, pi].
        continuous: (n,) which joints have no limits.
        revolute: (n,) which joints turn (revolute or continuous): a full turn of one leaves the robot where it was.
        velocity_limits: (n,) [rad/s or m/s].
        acceleration_limits: (n,) [rad/s^2 or m/s^2].
        workspace_dimension: 2 or 3: the dimension in which its keypoints live.
        root_frame: the frame in which scenes are given.
        tool_frame: the frame whose origin is its reference point.
        model: Pinocchio's kinematic tree, fixed base, nq == nv == n, every joint a configuration of its own
            (continuous joints are plain angles).
        collision_model: the robot's own collision geometry and the pairs of it that are checked.
        motion_levers: (g, n) how far at most any point of each of its g collision geometries moves, in metres, for a
            unit of motion of each joint, whatever the configuration.
        motion_radii: (n,) the largest of these: |motion| <= sum_j motion_radii[j] |dq_j| for any point of the robot.
    """

    name: str
    joint_names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    continuous: NDArray[np.bool_]
    revolute: NDArray[np.bool_]
    velocity_limits: FloatArray
    acceleration_limits: FloatArray
    workspace_dimension: int
    root_frame: str
    tool_frame: str
    model: pin.Model
    collision_model: pin.GeometryModel
    motion_levers: FloatArray
    motion_radii: FloatArray

    @property
    def dof(self) -> int:
        """Number of joints n."""
        ...

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of all frames of the robot."""
        ...

    @property
    def orientation_free(self) -> bool:
        """Whether the orientation of a pose has no meaning for this robot (a point)."""
        ...

    def forward_kinematics(self, configuration: FloatArray, frame: str | None = None) -> Pose:
        """Pose of a frame (default: the tool frame) in the root frame.

        Raises:
            UnknownFrameError: for a frame that the robot does not have.
        """
        ...

    def reference_points(self, configurations: FloatArray) -> FloatArray:
        """(k, 3) origins of the tool frame in configurations (k, n), in the root frame [m]."""
        ...

    def inverse_kinematics(
        self, pose: Pose, frame: str | None = None, rng: np.random.Generator | None = None
    ) -> FloatArray:
        """All configurations found that bring `frame` (default: the tool frame) to `pose`, within the limits.

        Every branch appears once, its angles as near to zero as the limits allow; `windings` gives the others.

        Args:
            pose: in the root frame [m].
            frame: of the robot.
            rng: for robots whose inverse kinematics is a search from random seeds; a fixed one by default.

        Returns:
            (k, n), k >= 0, each checked by forward kinematics (1e-6 m, 1e-6 rad).

        Raises:
            UnknownFrameError: for a frame that the robot does not have.
        """
        ...

    def inverse_kinematics_batch(
        self, poses: Sequence[Pose] | FloatArray, frame: str | None = None, rng: np.random.Generator | None = None
    ) -> list[FloatArray]:
        """`inverse_kinematics` of many poses, given as such or as an array of matrices (k, 4, 4).

        Raises:
            UnknownFrameError: for a frame that the robot does not have.
            ValueError: if a matrix is not finite or its rotation is none.
        """
        ...

    def windings(self, configuration: FloatArray) -> FloatArray:
        """All configurations within the limits that differ from this one by full turns of joints: (k, n), k >= 1."""
        ...
