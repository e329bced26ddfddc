"""Facets: clipping to the workspace, snapping onto shared planes."""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.decomposition.clipping_kernels import (
    BOUNDS_PLANES,
    MINIMUM_AREA,
    NO_PLANE,
    ZERO,
    bounding_sphere,
    bounds_planes,
    clip_to_front,
    copy_planes,
    copy_polygon,
    polygon_area,
)

# Cosine of the largest angle between planes that may become one (4.5 mrad), and its sine rounded up.
PARALLEL = 0.99999
PARALLEL_SINE = 4.5e-3
# A facet moves inwards by at most this share of the thickness of its polytope, so that something is left of it.
INWARDS_SHARE = 0.25
# What a plane is used by: nothing; partitions of the tree, but no facet; facets.
UNUSED, OF_PARTITION, OF_FACET = 0, 1, 2


@kernel
def clip_facets(
    vertices: Floats,
    loops: Indices,
    loop_offsets: Indices,
    facet_offsets: Indices,
    lower: Floats,
    upper: Floats,
) -> tuple[Floats, Indices, Indices, Indices, Floats, Floats]:
    """Clips facets to the workspace and drops those outside and on its border.

    Args:
        vertices: (v, 3); loops: indices into them; loop_offsets: (f + 1,), where the loop of each facet begins.
        facet_offsets: (b + 1,) where the facets of each polytope begin.
        lower, upper: (3,) corners of the workspace.

    Returns:
        corners (n, 3), offsets (m + 1,), the original facet of each (m,), its polytope (m,), its area (m,), and a
        sphere around it (m, 4), see `bounding_sphere`.
    """
    facets = loop_offsets.shape[0] - 1
    border = bounds_planes(lower, upper)
    longest = 0
    for facet in range(facets):
        longest = max(longest, loop_offsets[facet + 1] - loop_offsets[facet])
    # Each wall of the workspace can add a corner to a facet.
    corners = np.empty((loops.shape[0] + BOUNDS_PLANES * facets, 3))
    offsets = np.zeros(facets + 1, np.int64)
    sources = np.empty(facets, np.int64)
    bodies = np.empty(facets, np.int64)
    areas = np.empty(facets)
    spheres = np.empty((facets, 4))
    room = longest + BOUNDS_PLANES + 1
    work = np.empty((3 * room, 3))
    kept, used, body = 0, 0, 0
    for facet in range(facets):
        while facet >= facet_offsets[body + 1]:
            body += 1
        count = loop_offsets[facet + 1] - loop_offsets[facet]
        for i in range(count):
            for k in range(3):
                work[i, k] = vertices[loops[loop_offsets[facet] + i], k]
        area_index, count = clip_to_front(work, room, ZERO, count, border, NO_PLANE)
        if count < 3:
            continue
        area = polygon_area(work, area_index * room, count)
        if area < MINIMUM_AREA:
            continue
        copy_polygon(work, area_index * room, count, corners, used)
        bounding_sphere(corners, used, count, spheres, kept)
        used += count
        sources[kept] = facet
        bodies[kept] = body
        areas[kept] = area
        kept += 1
        offsets[kept] = used
    return (
        corners[:used].copy(),
        offsets[: kept + 1].copy(),
        sources[:kept].copy(),
        bodies[:kept].copy(),
        areas[:kept].copy(),
        spheres[:kept].copy(),
    )


@kernel(inline="always")
def thickness_behind(vertices: Floats, begin: int, end: int, planes: Floats, row: int, limit: float) -> float:
    """How far a polytope reaches behind the plane of one of its facets [m], any number of at least `limit` beyond that.

    Args:
        vertices: the polytope's are the rows from `begin` to `end`.
        planes, row: the outward plane of the facet.
        limit: [m].
    """
    deepest = 0.0
    for i in range(begin, end):
        depth = planes[row, 3]
        for k in range(3):
            depth -= planes[row, k] * vertices[i, k]
        deepest = max(deepest, depth)
        if deepest >= limit:
            break
    return deepest


@kernel
def snap_facets(
    corners: Floats,
    offsets: Indices,
    sources: Indices,
    bodies: Indices,
    areas: Floats,
    vertices: Floats,
    vertex_offsets: Indices,
    facet_planes: Floats,
    given: Floats,
    uses: Indices,
    lower: Floats,
    upper: Floats,
    plane_tolerance: float,
    gap_tolerance: float,
) -> tuple[Floats, Indices, Floats]:
    """Gives nearly coplanar facets, of either orientation, the same plane.

    A facet takes the plane of a larger one if it moves by at most `gap_tolerance` outwards, which only makes the
    obstacle larger, or by at most `plane_tolerance` inwards. A plate thinner than the tolerance does not vanish: a
    plane never takes both sides of one polytope, and moves none inwards by more than a share of its thickness. Planes
    of facets are preferred to those of mere partitions.

    Args:
        corners, offsets, sources, bodies, areas: clipped facets, see `clip_facets`; large ones are dealt with first.
        vertices: (v, 3) of the polytopes; vertex_offsets: (b + 1,) where those of each begin.
        facet_planes: (f, 4) outward planes of the original facets.
        given: (g, 4) planes that are there already, those of the workspace first; uses: (g,) UNUSED, OF_PARTITION or
            OF_FACET.
        lower, upper: (3,) corners of the workspace.

    Returns:
        shared planes (p, 4), the given ones first; the shared plane of each clipped facet (m,); and the outward planes
        of all original facets after snapping (f, 4).
    """
    count = sources.shape[0]
    total = given.shape[0]
    planes = np.empty((total + count, 4))
    copy_planes(given, planes)
    plane_of = np.empty(count, np.int64)
    snapped = facet_planes.copy()
    # Members of a plane as a linked list of clipped facets, and their orientation.
    last_member = np.full(total + count, -1, np.int64)
    previous_member = np.full(count, -1, np.int64)
    side = np.empty(count)

    # Planes that can be close to each other within the workspace have nearly the same distance from its centre: they
    # are in the same bin or in neighbouring ones.
    centre = np.empty(3)
    square = 0.0
    for k in range(3):
        centre[k] = 0.5 * (lower[k] + upper[k])
        square += (upper[k] - lower[k]) ** 2
    radius = 0.5 * math.sqrt(square)
    outwards = max(plane_tolerance, gap_tolerance)
    width = outwards + PARALLEL_SINE * radius
    bins = int(radius / width) + 2
    head = np.full(bins, -1, np.int64)
    following = np.full(total + count, -1, np.int64)
    for p in range(total):
        if uses[p] == UNUSED:
            continue
        distance = abs(planes[p, 0] * centre[0] + planes[p, 1] * centre[1] + planes[p, 2] * centre[2] - planes[p, 3])
        index = min(int(distance / width), bins - 1)
        following[p] = head[index]
        head[index] = p

    needed = plane_tolerance / INWARDS_SHARE
    order = np.argsort(-areas, kind="mergesort")  # equal ones in their order
    for rank in range(count):
        f = order[rank]
        source = sources[f]
        n0, n1, n2, d = (
            facet_planes[source, 0],
            facet_planes[source, 1],
            facet_planes[source, 2],
            facet_planes[source, 3],
        )
        distance = abs(n0 * centre[0] + n1 * centre[1] + n2 * centre[2] - d)
        own_bin = min(int(distance / width), bins - 1)
        body = bodies[f]
        thickness = thickness_behind(
            vertices, vertex_offsets[body], vertex_offsets[body + 1], facet_planes, source, needed
        )
        inwards = min(plane_tolerance, INWARDS_SHARE * thickness)
        best, best_move, best_side = -1, np.inf, 1.0
        for index in range(max(own_bin - 1, 0), min(own_bin + 2, bins)):
            p = head[index]
            while p >= 0:
                cosine = n0 * planes[p, 0] + n1 * planes[p, 1] + n2 * planes[p, 2]
                if abs(cosine) >= PARALLEL:
                    orientation = 1.0 if cosine > 0.0 else -1.0
                    largest, fits = 0.0, True
                    for i in range(offsets[f], offsets[f + 1]):
                        move = orientation * (
                            planes[p, 3]
                            - planes[p, 0] * corners[i, 0]
                            - planes[p, 1] * corners[i, 1]
                            - planes[p, 2] * corners[i, 2]
                        )
                        if move < -inwards or move > outwards:
                            fits = False
                            break
                        largest = max(largest, abs(move))
                    if p < uses.shape[0] and uses[p] == OF_PARTITION:
                        largest += outwards
                    if fits and largest < best_move:
                        member = last_member[p]
                        while member >= 0:
                            if side[member] != orientation and bodies[member] == bodies[f]:
                                fits = False
                                break
                            member = previous_member[member]
                        if fits:
                            best, best_move, best_side = p, largest, orientation
                p = following[p]
        if best < 0:
            best = total
            total += 1
            for k in range(4):
                planes[best, k] = facet_planes[source, k]
            following[best] = head[own_bin]
            head[own_bin] = best
        plane_of[f] = best
        side[f] = best_side
        previous_member[f] = last_member[best]
        last_member[best] = f
        for k in range(4):
            snapped[source, k] = best_side * planes[best, k]
    return planes[:total].copy(), plane_of, snapped
