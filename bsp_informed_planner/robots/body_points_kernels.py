"""Points on the links of a serial chain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.robots.chain_kernels import chain_pose

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@kernel
def body_points(rotations: Floats, offsets: Floats, prismatic: Flags, rows: Floats) -> Floats:
    """For rows of joint values (k, m): (k, 2 m, 3) what lies halfway between neighbouring joints, and what comes next.

    The origins of the joints from the second on and of the frame at the end, each after the point halfway to it.
    """
    count, dof = rows.shape
    points = np.empty((count, 2 * dof, 3))
    rotation, position = np.empty((3, 3)), np.empty(3)
    axes, origins = np.empty((dof, 3)), np.empty((dof, 3))
    for k in range(count):
        chain_pose(rotations, offsets, prismatic, rows[k], rotation, position, axes, origins)
        for j in range(dof):
            for i in range(3):
                following = origins[j + 1, i] if j + 1 < dof else position[i]
                points[k, 2 * j, i] = 0.5 * (origins[j, i] + following)
                points[k, 2 * j + 1, i] = following
    return points
