"""Rigid transforms."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

# A length this close to one is left alone, so that storing and reading back a unit vector changes no bit of it.
UNIT_LENGTH_TOLERANCE = 1e-14
# Arrays of so many bytes are compared as bytes.
_SHORT = 256
# So many numbers are looked at one by one.
_FEW = 8


def frozen_array(values: ArrayLike, shape: tuple[int, ...] | None = None) -> FloatArray:
    """A read-only float64 copy of `values`.

    Args:
        values: numbers.
        shape: the shape that it must have; -1 stands for any length.

    Raises:
        ValueError: if the shape is another or a value is not finite.
    """
    array = np.array(values, dtype=np.float64)
    if shape is not None and array.shape != shape and not _has_shape(array, shape):
        raise ValueError(f"expected an array of shape {shape}, got {array.shape}")
    # Of few numbers Python sees it sooner than NumPy, and scenes are full of them.
    if not (all(map(math.isfinite, array.ravel().tolist())) if array.size <= _FEW else np.isfinite(array).all()):
        raise ValueError("a value is not finite")
    array.setflags(write=False)
    return array


def _has_shape(array: FloatArray, shape: tuple[int, ...]) -> bool:
    return array.ndim == len(shape) and all(want in (-1, have) for want, have in zip(shape, array.shape, strict=True))


def same_array(first: NDArray[Any], second: NDArray[Any]) -> bool:
    """Whether two arrays of one data type have the same shape and equal values.

    For short arrays that are equal this takes a tenth of the time of `np.array_equal`: whole scenes are compared by it.
    """
    if first is second:
        return True
    if first.nbytes <= _SHORT and first.shape == second.shape and first.tobytes() == second.tobytes():
        return True
    # Numbers can be equal in other bytes, as 0.0 and -0.0 are.
    return np.array_equal(first, second)


@dataclass(frozen=True, eq=False)
class Pose:
    """Position and orientation of a frame in another (REP-103: metres, right-handed).

    Attributes:
        position: (3,) [m].
        quaternion: (4,) as x, y, z, w, of unit length.
    """

    position: FloatArray
    quaternion: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", frozen_array(self.position, (3,)))
        quaternion = frozen_array(self.quaternion, (4,))
        # Values of any size must not overflow.
        norm = math.hypot(*quaternion)
        if not 0.5 < norm < 1.5:
            raise ValueError(f"a quaternion of length {norm:.3g} is no rotation")
        if abs(norm - 1.0) > UNIT_LENGTH_TOLERANCE:
            quaternion = frozen_array(quaternion / norm)
        object.__setattr__(self, "quaternion", quaternion)

    @staticmethod
    def identity() -> Pose:
        return Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))

    @staticmethod
    def from_matrix(matrix: ArrayLike) -> Pose:
        """From a (4, 4) homogeneous matrix.

        Raises:
            ValueError: if its upper left part is no rotation.
        """
        array = np.asarray(matrix, dtype=np.float64)
        return Pose(array[:3, 3], _quaternion_of(array[:3, :3]))

    @staticmethod
    def from_xyz_rpy(xyz: ArrayLike, rpy: ArrayLike = (0.0, 0.0, 0.0)) -> Pose:
        """From a position [m] and fixed-axis roll, pitch, yaw [rad], as in URDF."""
        roll, pitch, yaw = (0.5 * float(angle) for angle in np.asarray(rpy, dtype=np.float64))
        cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
        quaternion = np.array(
            [
                sr * cp * cy - cr * sp * sy,
                cr * sp * cy + sr * cp * sy,
                cr * cp * sy - sr * sp * cy,
                cr * cp * cy + sr * sp * sy,
            ]
        )
        return Pose(np.asarray(xyz, dtype=np.float64), quaternion)

    @staticmethod
    def from_rotation_vector(vector: ArrayLike, position: ArrayLike = (0.0, 0.0, 0.0)) -> Pose:
        """From a rotation about the direction of `vector` (3,) by its length [rad], and a position [m]."""
        array = np.asarray(vector, dtype=np.float64)
        angle = float(np.linalg.norm(array))
        # sinc keeps the quotient right at angle zero: sin(angle / 2) / angle = sinc(angle / 2 pi) / 2.
        scale = 0.5 * float(np.sinc(angle / (2.0 * math.pi)))
        return Pose(np.asarray(position, dtype=np.float64), np.append(scale * array, math.cos(0.5 * angle)))

    @cached_property
    def rotation(self) -> FloatArray:
        """(3, 3) rotation matrix, read-only."""
        # Written out: an order of magnitude faster than scipy for a single rotation, and scenes are full of them.
        x, y, z, w = self.quaternion.tolist()
        matrix = np.array(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
                [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
                [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )
        matrix.setflags(write=False)
        return matrix

    @property
    def matrix(self) -> FloatArray:
        """(4, 4) homogeneous matrix."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.position
        return matrix

    def __mul__(self, other: Pose) -> Pose:
        """The pose of `other`'s frame, given in this one, in the frame that this pose is given in."""
        ax, ay, az, aw = self.quaternion.tolist()
        bx, by, bz, bw = other.quaternion.tolist()
        product = np.array(
            [
                aw * bx + ax * bw + ay * bz - az * by,
                aw * by - ax * bz + ay * bw + az * bx,
                aw * bz + ax * by - ay * bx + az * bw,
                aw * bw - ax * bx - ay * by - az * bz,
            ]
        )
        return Pose(self.rotation @ other.position + self.position, product)

    def inverse(self) -> Pose:
        return Pose(-(self.rotation.T @ self.position), self.quaternion * np.array([-1.0, -1.0, -1.0, 1.0]))

    def apply(self, points: ArrayLike) -> FloatArray:
        """Points (..., 3) of this frame in the frame that the pose is given in [m]."""
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.position

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Pose)
            and same_array(self.position, other.position)
            and same_array(self.quaternion, other.quaternion)
        )


def _quaternion_of(rotation: FloatArray) -> FloatArray:
    """(4,) quaternion x, y, z, w of a (3, 3) rotation matrix (Shepperd 1978: divides by the largest part)."""
    if not (np.abs(rotation @ rotation.T - np.eye(3)) < 1e-4).all() or np.linalg.det(rotation) < 0.0:
        raise ValueError(f"no rotation matrix: {rotation.tolist()}")
    trace = float(np.trace(rotation))
    diagonal = [float(value) for value in np.diagonal(rotation)]
    quaternion = np.empty(4)
    largest = int(np.argmax([*diagonal, trace]))
    if largest == 3:
        quaternion[:3] = [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
        quaternion[3] = 1.0 + trace
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        quaternion[i] = 1.0 + 2.0 * diagonal[i] - trace
        quaternion[j] = rotation[j, i] + rotation[i, j]
        quaternion[k] = rotation[k, i] + rotation[i, k]
        quaternion[3] = rotation[k, j] - rotation[j, k]
    return np.asarray(quaternion / np.linalg.norm(quaternion))
