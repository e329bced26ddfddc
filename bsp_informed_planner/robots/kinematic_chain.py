"""A serial chain of revolute and prismatic joints, with compiled kinematics and damped least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bsp_informed_planner.robots.body_points_kernels import body_points
from bsp_informed_planner.robots.chain_kernels import chain_pose, chain_positions, solve_batch
from bsp_informed_planner.robots.motion_bound import joint_axes
from bsp_informed_planner.scene.pose import FloatArray


@dataclass(frozen=True, eq=False)
class KinematicChain:
    """The m joints between the root of a robot and one of its frames.

    Each joint frame is turned so that the joint's axis is its z axis. The pose of the frame is the product over the
    joints of (rotations[i], offsets[i]) and the joint's motion, and of (rotations[m], offsets[m]).

    Attributes:
        indices: (m,) place of each joint in a configuration of the robot.
        prismatic: (m,) which joints move along their axis.
        rotations: (m + 1, 3, 3).
        offsets: (m + 1, 3) [m].
        lower, upper: (m,) limits [rad or m].
    """

    indices: NDArray[np.int64]
    prismatic: NDArray[np.bool_]
    rotations: FloatArray
    offsets: FloatArray
    lower: FloatArray
    upper: FloatArray

    @staticmethod
    def to_frame(model: pin.Model, frame_id: int) -> KinematicChain:
        """The chain from the root of a model with nq == nv to one of its frames."""
        frame = model.frames[frame_id]
        joints: list[int] = []
        joint = int(frame.parentJoint)
        while joint > 0:
            joints.insert(0, joint)
            joint = int(model.parents[joint])
        axes, prismatic = joint_axes(model)
        rotations, offsets = [], []
        turned = np.eye(3)  # from the frame of the last joint to its turned frame
        for joint in joints:
            placement = model.jointPlacements[joint]
            align = _frame_of_axis(axes[joint - 1])
            rotations.append(turned.T @ placement.rotation @ align)
            offsets.append(turned.T @ placement.translation)
            turned = align
        rotations.append(turned.T @ frame.placement.rotation)
        offsets.append(turned.T @ frame.placement.translation)
        indices = np.array([model.joints[joint].idx_v for joint in joints], dtype=np.int64)
        return KinematicChain(
            indices=indices,
            prismatic=np.array([prismatic[joint - 1] for joint in joints], dtype=np.bool_),
            rotations=np.ascontiguousarray(rotations),
            offsets=np.ascontiguousarray(offsets),
            lower=np.ascontiguousarray(model.lowerPositionLimit[indices]),
            upper=np.ascontiguousarray(model.upperPositionLimit[indices]),
        )

    @property
    def dof(self) -> int:
        return len(self.indices)

    @property
    def reach(self) -> float:
        """No configuration brings the origin of the frame further than this from the origin of the first joint [m]."""
        lengths = np.linalg.norm(self.offsets[1:], axis=1).sum()
        strokes = np.maximum(np.abs(self.lower), np.abs(self.upper))[self.prismatic].sum()
        return float(lengths + strokes)

    def forward(self, values: FloatArray) -> FloatArray:
        """(4, 4) pose of the frame in the root frame for joint values (m,)."""
        matrix = np.eye(4)
        axes, origins = np.empty((2, self.dof, 3))
        rotation, position = matrix[:3, :3], matrix[:3, 3]
        chain_pose(self.rotations, self.offsets, self.prismatic, values, rotation, position, axes, origins)
        return matrix

    def positions(self, rows: FloatArray) -> FloatArray:
        """(k, 3) positions of the frame in the root frame for rows of joint values (k, m)."""
        rows = np.require(rows, np.float64, ("C", "W"))
        return chain_positions(self.rotations, self.offsets, self.prismatic, rows)

    def body_points(self, rows: FloatArray) -> FloatArray:
        """(k, 2 m, 3) points on the links in the root frame for rows of joint values (k, m), see `body_points`."""
        rows = np.require(rows, np.float64, ("C", "W"))
        return body_points(self.rotations, self.offsets, self.prismatic, rows)

    def solve(
        self,
        target: FloatArray,
        seeds: FloatArray,
        iterations: int,
        patience: int,
        distinct: float,
        enough: int,
        inside: bool,
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Bring seeds to a pose by damped least squares; keep the distinct solutions within the limits.

        Args:
            target: (4, 4) pose of the frame in the root frame.
            seeds: (k, m) joint values to start from.
            iterations: at most so many steps a seed.
            patience: a seed is dropped sooner if so many steps have not halved its squared error.
            distinct: solutions that differ by less than this in all joints (modulo full turns) count as one [rad or m].
            enough: stop at this number of solutions.
            inside: whether to keep to the limits on the way, instead of wrapping and checking at the end.

        Returns:
            the solutions (j, m) in the order of their seeds, revolute joints as near to zero as the limits allow; and
            which of the seeds (k,) reached the pose, whatever the limits and other seeds.
        """
        begins = np.array([0, len(seeds)])
        (found,), reached = self.solve_batch(
            target[None], seeds, begins, iterations, patience, distinct, enough, inside
        )
        return found, reached

    def solve_batch(
        self,
        targets: FloatArray,
        seeds: FloatArray,
        begins: NDArray[np.int64],
        iterations: int,
        patience: int,
        distinct: float,
        enough: int,
        inside: bool,
    ) -> tuple[list[FloatArray], NDArray[np.bool_]]:
        """`solve` of many poses.

        Args:
            targets: (t, 4, 4).
            seeds: (k, m) those of all poses, one after the other.
            begins: (t + 1,) where those of each pose begin.
            iterations, patience, distinct, enough, inside: see `solve`.

        Returns:
            the solutions of each pose, and which of the seeds (k,) reached theirs.
        """
        # One memory layout, so that the kernel is compiled once.
        targets, seeds = np.require(targets, requirements=("C", "W")), np.require(seeds, requirements=("C", "W"))
        reached = np.zeros(len(seeds), dtype=np.bool_)
        found = np.empty_like(seeds)
        counts = np.zeros(len(targets), dtype=np.int64)
        solve_batch(
            self.rotations,
            self.offsets,
            self.prismatic,
            self.lower,
            self.upper,
            targets,
            seeds,
            begins,
            enough,
            iterations,
            patience,
            distinct,
            inside,
            found,
            reached,
            counts,
        )
        solutions = [
            found[begin : begin + count] for begin, count in zip(begins[:-1].tolist(), counts.tolist(), strict=True)
        ]
        return solutions, reached


def _frame_of_axis(axis: FloatArray) -> FloatArray:
    """A rotation (3, 3) whose third column is the axis; the identity for the z axis."""
    if axis[2] > 1.0 - 1e-15:
        return np.eye(3)
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(other, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis], axis=1)
