"""Signed distances of points from shapes: positive outside, negative inside."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.scene.polytope_distance_kernels import distance_to_polytope

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@kernel
def to_box(x: float, y: float, z: float, boxes: Floats, box: int) -> float:
    """Signed distance from a row of `boxes` (b, 15): centre, rotation row by row, half edges."""
    dx, dy, dz = x - boxes[box, 0], y - boxes[box, 1], z - boxes[box, 2]
    outside, deepest = 0.0, -np.inf
    for k in range(3):
        local = boxes[box, 3 + k] * dx + boxes[box, 6 + k] * dy + boxes[box, 9 + k] * dz
        beyond = abs(local) - boxes[box, 12 + k]
        deepest = max(deepest, beyond)
        if beyond > 0.0:
            outside += beyond * beyond
    return math.sqrt(outside) if deepest > 0.0 else deepest


@kernel
def to_cylinder(height: float, radial: float, radius: float, half_height: float) -> float:
    """Signed distance from a cylinder around the origin, in its own cylindrical coordinates."""
    beyond, above = radial - radius, abs(height) - half_height
    if beyond > 0.0 and above > 0.0:
        return math.sqrt(beyond * beyond + above * above)
    return max(beyond, above)


@kernel
def to_cone(height: float, radial: float, radius: float, half_height: float) -> float:
    """Signed distance from a cone with its tip at +half_height and its base at -half_height."""
    slope = math.sqrt(4.0 * half_height * half_height + radius * radius)
    beyond = (2.0 * half_height * radial + radius * (height - half_height)) / slope
    below = -half_height - height
    if beyond <= 0.0 and below <= 0.0:
        return max(beyond, below)
    # Distances from the base disc and from the line from its rim to the tip.
    to_base = math.sqrt(max(radial - radius, 0.0) ** 2 + below * below)
    along = ((radius - radial) * radius + (height + half_height) * 2.0 * half_height) / (slope * slope)
    along = min(max(along, 0.0), 1.0)
    to_side = math.sqrt(
        (radial - radius * (1.0 - along)) ** 2 + (height + half_height - 2.0 * half_height * along) ** 2
    )
    return min(to_base, to_side)


@kernel
def signed_distances(
    points: Floats,
    boxes: Floats,
    spheres: Floats,
    cylinders: Floats,
    cones: Floats,
    half_spaces: Floats,
    vertices: Floats,
    loops: Indices,
    loop_offsets: Indices,
    planes: Floats,
    facet_offsets: Indices,
) -> Floats:
    """Signed distance of points from the nearest body.

    Args:
        points: (m, 3) [m].
        boxes: (b, 15) centre, rotation row by row, half edges.
        spheres: (s, 4) centre, radius.
        cylinders, cones: (c, 8) centre, unit axis, radius, half height.
        half_spaces: (h, 4) outward unit normal n and offset d of n . x <= d.
        vertices, loops, loop_offsets, planes, facet_offsets: of convex polytopes, see `facet_arrays`.

    Returns:
        (m,) [m]; infinity without bodies.
    """
    result = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        nearest = np.inf
        for box in range(boxes.shape[0]):
            nearest = min(nearest, to_box(x, y, z, boxes, box))
        for k in range(spheres.shape[0]):
            dx, dy, dz = x - spheres[k, 0], y - spheres[k, 1], z - spheres[k, 2]
            nearest = min(nearest, math.sqrt(dx * dx + dy * dy + dz * dz) - spheres[k, 3])
        for kind in range(2):
            bodies = cylinders if kind == 0 else cones
            for k in range(bodies.shape[0]):
                dx, dy, dz = x - bodies[k, 0], y - bodies[k, 1], z - bodies[k, 2]
                height = dx * bodies[k, 3] + dy * bodies[k, 4] + dz * bodies[k, 5]
                radial = math.sqrt(max(dx * dx + dy * dy + dz * dz - height * height, 0.0))
                if kind == 0:
                    nearest = min(nearest, to_cylinder(height, radial, bodies[k, 6], bodies[k, 7]))
                else:
                    nearest = min(nearest, to_cone(height, radial, bodies[k, 6], bodies[k, 7]))
        for k in range(half_spaces.shape[0]):
            height = half_spaces[k, 0] * x + half_spaces[k, 1] * y + half_spaces[k, 2] * z - half_spaces[k, 3]
            nearest = min(nearest, height)
        for body in range(facet_offsets.shape[0] - 1):
            highest = -np.inf
            for facet in range(facet_offsets[body], facet_offsets[body + 1]):
                height = planes[facet, 0] * x + planes[facet, 1] * y + planes[facet, 2] * z - planes[facet, 3]
                highest = max(highest, height)
            # The height over a facet is the depth inside, and a lower bound of the distance outside.
            if highest >= nearest:
                continue
            if highest > 0.0:
                highest = distance_to_polytope(
                    points[i], vertices, loops, loop_offsets, planes,
                    facet_offsets[body], facet_offsets[body + 1], nearest,
                )  # fmt: skip
            nearest = min(nearest, highest)
        result[i] = nearest
    return result
