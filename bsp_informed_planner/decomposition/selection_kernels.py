"""Parts of what is kept in flat arrays: some polytopes of many, some facets of many."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.decomposition.clipping_kernels import ZERO, copy_polygon


@kernel
def copy_plane(source: Floats, row: int, target: Floats, target_row: int) -> None:
    for k in range(4):
        target[target_row, k] = source[row, k]


@kernel
def exchange_bodies(
    vertices: Floats,
    vertex_offsets: Indices,
    loops: Indices,
    loop_offsets: Indices,
    planes: Floats,
    facet_offsets: Indices,
    is_gone: Flags,
    added_vertices: Floats,
    added_vertex_offsets: Indices,
    added_loops: Indices,
    added_loop_offsets: Indices,
    added_planes: Floats,
    added_facet_offsets: Indices,
) -> tuple[Floats, Indices, Indices, Indices, Floats, Indices]:
    """A `FacetSet` without the polytopes that are gone (b,), and then those of another, as arrays of the same kind."""
    bodies, more = vertex_offsets.shape[0] - 1, added_vertex_offsets.shape[0] - 1
    count, vertex_count, facet_count, corner_count = 0, 0, 0, 0
    for body in range(bodies):
        if not is_gone[body]:
            count += 1
            vertex_count += vertex_offsets[body + 1] - vertex_offsets[body]
            facet_count += facet_offsets[body + 1] - facet_offsets[body]
            corner_count += loop_offsets[facet_offsets[body + 1]] - loop_offsets[facet_offsets[body]]
    new_vertices = np.empty((vertex_count + added_vertices.shape[0], 3))
    new_vertex_offsets = np.zeros(count + more + 1, np.int64)
    new_loops = np.empty(corner_count + added_loops.shape[0], np.int64)
    new_loop_offsets = np.zeros(facet_count + added_planes.shape[0] + 1, np.int64)
    new_planes = np.empty((facet_count + added_planes.shape[0], 4))
    new_facet_offsets = np.zeros(count + more + 1, np.int64)
    into, vertex, facet, corner = 0, 0, 0, 0
    for body in range(bodies):
        if is_gone[body]:
            continue
        begin, end = vertex_offsets[body], vertex_offsets[body + 1]
        copy_polygon(vertices, begin, end - begin, new_vertices, vertex)
        for old in range(facet_offsets[body], facet_offsets[body + 1]):
            for i in range(loop_offsets[old], loop_offsets[old + 1]):
                new_loops[corner] = loops[i] - begin + vertex
                corner += 1
            copy_plane(planes, old, new_planes, facet)
            facet += 1
            new_loop_offsets[facet] = corner
        vertex += end - begin
        into += 1
        new_vertex_offsets[into] = vertex
        new_facet_offsets[into] = facet
    copy_polygon(added_vertices, ZERO, added_vertices.shape[0], new_vertices, vertex)
    for i in range(added_loops.shape[0]):
        new_loops[corner + i] = added_loops[i] + vertex
    for old in range(added_planes.shape[0]):
        copy_plane(added_planes, old, new_planes, facet + old)
        new_loop_offsets[facet + old + 1] = corner + added_loop_offsets[old + 1]
    for body in range(more):
        new_vertex_offsets[into + body + 1] = vertex + added_vertex_offsets[body + 1]
        new_facet_offsets[into + body + 1] = facet + added_facet_offsets[body + 1]
    return new_vertices, new_vertex_offsets, new_loops, new_loop_offsets, new_planes, new_facet_offsets


@kernel
def exchange_facets(
    corners: Floats,
    offsets: Indices,
    facet_planes: Indices,
    areas: Floats,
    spheres: Floats,
    bodies: Indices,
    snapped_planes: Floats,
    facet_offsets: Indices,
    is_gone: Flags,
    added_corners: Floats,
    added_offsets: Indices,
    added_planes: Indices,
    added_areas: Floats,
    added_spheres: Floats,
    added_bodies: Indices,
    added_snapped_planes: Floats,
) -> tuple[Floats, Indices, Indices, Floats, Floats, Indices, Floats]:
    """`PartitionFacets` without those of polytopes that are gone, and then others.

    Args:
        corners, offsets, facet_planes, areas, spheres, bodies, snapped_planes: of `PartitionFacets`.
        facet_offsets: of the `FacetSet` that they are from.
        is_gone: (b,) which of its polytopes are gone.
        added_corners, ...: of `PartitionFacets` to be added, in the same order.

    Returns:
        the same seven attributes, with polytopes numbered anew.
    """
    old_bodies = is_gone.shape[0]
    renumbered = np.full(old_bodies, -1, np.int64)
    left, rows = 0, 0
    for body in range(old_bodies):
        if not is_gone[body]:
            renumbered[body] = left
            left += 1
            rows += facet_offsets[body + 1] - facet_offsets[body]
    facets, corner_count = 0, 0
    for facet in range(facet_planes.shape[0]):
        if renumbered[bodies[facet]] >= 0:
            facets += 1
            corner_count += offsets[facet + 1] - offsets[facet]

    new_corners = np.empty((corner_count + added_corners.shape[0], 3))
    total = facets + added_planes.shape[0]
    new_offsets = np.zeros(total + 1, np.int64)
    new_planes, new_bodies = np.empty(total, np.int64), np.empty(total, np.int64)
    new_areas, new_spheres = np.empty(total), np.empty((total, 4))
    new_snapped = np.empty((rows + added_snapped_planes.shape[0], 4))
    kept, used = 0, 0
    for facet in range(facet_planes.shape[0]):
        body = renumbered[bodies[facet]]
        if body < 0:
            continue
        length = offsets[facet + 1] - offsets[facet]
        copy_polygon(corners, offsets[facet], length, new_corners, used)
        used += length
        new_planes[kept], new_areas[kept], new_bodies[kept] = facet_planes[facet], areas[facet], body
        copy_plane(spheres, facet, new_spheres, kept)
        kept += 1
        new_offsets[kept] = used
    copy_polygon(added_corners, ZERO, added_corners.shape[0], new_corners, used)
    for facet in range(added_planes.shape[0]):
        new_planes[kept], new_areas[kept] = added_planes[facet], added_areas[facet]
        new_bodies[kept] = left + added_bodies[facet]
        copy_plane(added_spheres, facet, new_spheres, kept)
        kept += 1
        new_offsets[kept] = used + added_offsets[facet + 1]
    row = 0
    for body in range(old_bodies):
        if not is_gone[body]:
            for facet in range(facet_offsets[body], facet_offsets[body + 1]):
                copy_plane(snapped_planes, facet, new_snapped, row)
                row += 1
    for facet in range(added_snapped_planes.shape[0]):
        copy_plane(added_snapped_planes, facet, new_snapped, row + facet)
    return new_corners, new_offsets, new_planes, new_areas, new_spheres, new_bodies, new_snapped


@kernel(inline="always")
def join_portals(
    old_corners: Floats,
    old_offsets: Indices,
    old_cells: Indices,
    old_partitions: Indices,
    old_candidates: Floats,
    old_candidate_portals: Indices,
    old_clearances: Floats,
    new_numbers: Indices,
    corners: Floats,
    offsets: Indices,
    cells: Indices,
    partitions: Indices,
    candidates: Floats,
    candidate_portals: Indices,
) -> tuple[Floats, Indices, Indices, Indices, Floats, Indices, Floats]:
    """Portals of the former tree between cells that are still there, then new portals; and their candidates.

    Args:
        old_corners, old_offsets, old_cells, old_partitions: former portals, see `free_portals`.
        old_candidates, old_candidate_portals: of the former portals, see `place_candidates`; old_clearances: of each.
        new_numbers: see `mark_nodes`.
        corners, offsets, cells, partitions, candidates, candidate_portals: what is new.

    Returns:
        corners, offsets, cells, partitions, candidates, candidate_portals and clearances; the latter are NaN for new
        candidates.
    """
    kept = np.full(old_cells.shape[0], -1, np.int64)
    portals, corner_count, total = 0, 0, 0
    for portal in range(old_cells.shape[0]):
        if new_numbers[old_cells[portal, 0]] >= 0 and new_numbers[old_cells[portal, 1]] >= 0:
            kept[portal] = portals
            portals += 1
            corner_count += old_offsets[portal + 1] - old_offsets[portal]
    for candidate in range(old_candidates.shape[0]):
        if kept[old_candidate_portals[candidate]] >= 0:
            total += 1
    new_corners = np.empty((corner_count + corners.shape[0], 3))
    new_offsets = np.zeros(portals + cells.shape[0] + 1, np.int64)
    new_cells = np.empty((portals + cells.shape[0], 2), np.int64)
    new_partitions = np.empty(portals + cells.shape[0], np.int64)
    new_candidates = np.empty((total + candidates.shape[0], 3))
    new_portals = np.empty(total + candidates.shape[0], np.int64)
    new_clearances = np.empty(total + candidates.shape[0])

    corner = 0
    for portal in range(old_cells.shape[0]):
        into = kept[portal]
        if into < 0:
            continue
        count = old_offsets[portal + 1] - old_offsets[portal]
        copy_polygon(old_corners, old_offsets[portal], count, new_corners, corner)
        corner += count
        new_offsets[into + 1] = corner
        new_cells[into, 0] = new_numbers[old_cells[portal, 0]]
        new_cells[into, 1] = new_numbers[old_cells[portal, 1]]
        new_partitions[into] = new_numbers[old_partitions[portal]]
    copy_polygon(corners, ZERO, corners.shape[0], new_corners, corner)
    for portal in range(cells.shape[0]):
        into = portals + portal
        new_offsets[into + 1] = corner + offsets[portal + 1]
        new_cells[into, 0], new_cells[into, 1] = cells[portal, 0], cells[portal, 1]
        new_partitions[into] = partitions[portal]
    into = 0
    for candidate in range(old_candidates.shape[0]):
        portal = kept[old_candidate_portals[candidate]]
        if portal < 0:
            continue
        copy_polygon(old_candidates, candidate, 1, new_candidates, into)
        new_portals[into] = portal
        new_clearances[into] = old_clearances[candidate]
        into += 1
    copy_polygon(candidates, ZERO, candidates.shape[0], new_candidates, into)
    for candidate in range(candidates.shape[0]):
        new_portals[into + candidate] = portals + candidate_portals[candidate]
        new_clearances[into + candidate] = np.nan
    return new_corners, new_offsets, new_cells, new_partitions, new_candidates, new_portals, new_clearances
