"""Boxes in flat arrays: their places, corners and planes."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices

BOX_VERTICES, BOX_FACES, BOX_CORNERS = 8, 6, 24


@kernel
def rotation_matrix(quaternions: Floats, row: int, matrix: Floats) -> None:
    """Writes the rotation (3, 3) by a unit quaternion, a row (x, y, z, w) of `quaternions`."""
    x, y, z, w = quaternions[row, 0], quaternions[row, 1], quaternions[row, 2], quaternions[row, 3]
    matrix[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    matrix[0, 1] = 2.0 * (x * y - z * w)
    matrix[0, 2] = 2.0 * (x * z + y * w)
    matrix[1, 0] = 2.0 * (x * y + z * w)
    matrix[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    matrix[1, 2] = 2.0 * (y * z - x * w)
    matrix[2, 0] = 2.0 * (x * z - y * w)
    matrix[2, 1] = 2.0 * (y * z + x * w)
    matrix[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@kernel
def compose_poses(
    positions: Floats, quaternions: Floats, local_positions: Floats, local_quaternions: Floats
) -> tuple[Floats, Floats]:
    """Poses given in frames that are given in another: (b, 3) positions and (b, 3, 3) rotations in that other frame."""
    count = positions.shape[0]
    composed = np.empty((count, 3))
    rotations = np.empty((count, 3, 3))
    outer, inner = np.empty((3, 3)), np.empty((3, 3))
    for box in range(count):
        rotation_matrix(quaternions, box, outer)
        rotation_matrix(local_quaternions, box, inner)
        for i in range(3):
            composed[box, i] = positions[box, i]
            for k in range(3):
                composed[box, i] += outer[i, k] * local_positions[box, k]
                rotations[box, i, k] = 0.0
                for m in range(3):
                    rotations[box, i, k] += outer[i, m] * inner[m, k]
    return composed, rotations


@kernel
def box_facets(
    sizes: Floats, positions: Floats, rotations: Floats, unit_loops: Indices
) -> tuple[Floats, Indices, Indices, Indices, Floats, Indices]:
    """The facets of boxes, as arrays of a `FacetSet`.

    Args:
        sizes: (b, 3); positions: (b, 3); rotations: (b, 3, 3).
        unit_loops: (24,) the corners of the faces towards -x, +x, -y, +y, -z, +z, four each; a corner is
            4 (x > 0) + 2 (y > 0) + (z > 0).
    """
    count = sizes.shape[0]
    vertices = np.empty((BOX_VERTICES * count, 3))
    vertex_offsets = np.empty(count + 1, np.int64)
    loops = np.empty(BOX_CORNERS * count, np.int64)
    loop_offsets = np.empty(BOX_FACES * count + 1, np.int64)
    planes = np.empty((BOX_FACES * count, 4))
    facet_offsets = np.empty(count + 1, np.int64)
    vertex_offsets[0], loop_offsets[0], facet_offsets[0] = 0, 0, 0
    for box in range(count):
        for corner in range(BOX_VERTICES):
            for i in range(3):
                value = positions[box, i]
                for k in range(3):
                    half = 0.5 * sizes[box, k] if (corner >> (2 - k)) & 1 else -0.5 * sizes[box, k]
                    value += rotations[box, i, k] * half
                vertices[BOX_VERTICES * box + corner, i] = value
        for face in range(BOX_FACES):
            row, axis = BOX_FACES * box + face, face // 2
            sign = 1.0 if face % 2 else -1.0
            planes[row, 3] = 0.5 * sizes[box, axis]
            for i in range(3):
                planes[row, i] = sign * rotations[box, i, axis]
                planes[row, 3] += planes[row, i] * positions[box, i]
            loop_offsets[row + 1] = 4 * (row + 1)
        for i in range(BOX_CORNERS):
            loops[BOX_CORNERS * box + i] = unit_loops[i] + BOX_VERTICES * box
        vertex_offsets[box + 1] = BOX_VERTICES * (box + 1)
        facet_offsets[box + 1] = BOX_FACES * (box + 1)
    return vertices, vertex_offsets, loops, loop_offsets, planes, facet_offsets
