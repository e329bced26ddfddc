"""The steps of the decomposition behind the tree, joined: a call from Python takes as long as a small step."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.decomposition.candidate_kernels import place_candidates
from bsp_informed_planner.decomposition.cell_kernels import solid_cells
from bsp_informed_planner.decomposition.clearance_kernels import clearances, update_clearances
from bsp_informed_planner.decomposition.portal_kernels import cut_portals, free_portals, mark_nodes
from bsp_informed_planner.decomposition.selection_kernels import join_portals

# Distances that differ by less are those of the same obstacle [m].
SAME_DISTANCE = 1e-9


@kernel
def portals_of_tree(
    node_planes: Floats,
    node_front: Indices,
    node_back: Indices,
    new_numbers: Indices,
    former_solid: Flags,
    vertices: Floats,
    vertex_offsets: Indices,
    snapped_planes: Floats,
    facet_offsets: Indices,
    lower: Floats,
    upper: Floats,
) -> tuple[Flags, Floats, Indices, Indices, Indices]:
    """Which cells are solid, and the portals of the free cells that are not of the former tree.

    Args:
        node_planes, node_front, node_back: the tree.
        new_numbers, former_solid: of the former tree, see `mark_nodes` and `solid_cells`.
        vertices, vertex_offsets, snapped_planes, facet_offsets: of the obstacles, see `solid_cells`.
        lower, upper: (3,) corners of the workspace.

    Returns:
        solid (n,); corners, offsets, cells and partitions of portals, see `free_portals`.
    """
    marks = mark_nodes(node_front, node_back, new_numbers)
    corners, offsets, cells, partitions = cut_portals(node_planes, node_front, node_back, marks, lower, upper)
    solid = solid_cells(
        node_planes, node_front, node_back, marks, new_numbers, former_solid, corners, offsets, cells,
        vertices, vertex_offsets, snapped_planes, facet_offsets,
    )  # fmt: skip
    corners, offsets, cells, partitions = free_portals(corners, offsets, cells, partitions, solid)
    return solid, corners, offsets, cells, partitions


@kernel
def candidates_of_portals(
    corners: Floats,
    offsets: Indices,
    partitions: Indices,
    node_planes: Floats,
    columns: int,
    rows: int,
    horizontal: bool,
    margin: float,
    minimum_width: float,
    cap: float,
    vertices: Floats,
    vertex_offsets: Indices,
    loops: Indices,
    loop_offsets: Indices,
    planes: Floats,
    facet_offsets: Indices,
) -> tuple[Floats, Indices, Floats]:
    """Candidates, their portals and clearances; for the arguments see `place_candidates` and `clearances`."""
    candidates, candidate_portals = place_candidates(
        corners, offsets, partitions, node_planes, columns, rows, horizontal, margin, minimum_width
    )
    distances = clearances(candidates, vertices, vertex_offsets, loops, loop_offsets, planes, facet_offsets, cap)
    return candidates, candidate_portals, distances


@kernel
def candidates_of_changed_portals(
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
    node_planes: Floats,
    columns: int,
    rows: int,
    horizontal: bool,
    margin: float,
    minimum_width: float,
    cap: float,
    is_gone: Flags,
    former_vertices: Floats,
    former_vertex_offsets: Indices,
    former_loops: Indices,
    former_loop_offsets: Indices,
    former_planes: Floats,
    former_facet_offsets: Indices,
    added_vertices: Floats,
    added_vertex_offsets: Indices,
    added_loops: Indices,
    added_loop_offsets: Indices,
    added_planes: Floats,
    added_facet_offsets: Indices,
    vertices: Floats,
    vertex_offsets: Indices,
    loops: Indices,
    loop_offsets: Indices,
    planes: Floats,
    facet_offsets: Indices,
) -> tuple[Floats, Indices, Indices, Indices, Floats, Indices, Floats]:
    """Former portals that are still there and new ones, and their candidates.

    Args:
        old_corners, ...: of the former decomposition, see `join_portals`.
        corners, offsets, cells, partitions: new portals.
        node_planes, columns, rows, horizontal, margin, minimum_width: see `place_candidates`; cap: see `clearances`.
        is_gone: (b,) which of the former polytopes are gone.
        former_vertices, ..., added_vertices, ..., vertices, ...: the former polytopes, new ones, and all that there are
            now, see `FacetSet`.

    Returns:
        corners, offsets, cells and partitions of portals; candidates, their portals and clearances.
    """
    candidates, candidate_portals = place_candidates(
        corners, offsets, partitions, node_planes, columns, rows, horizontal, margin, minimum_width
    )
    corners, offsets, cells, partitions, candidates, candidate_portals, distances = join_portals(
        old_corners, old_offsets, old_cells, old_partitions, old_candidates, old_candidate_portals, old_clearances,
        new_numbers, corners, offsets, cells, partitions, candidates, candidate_portals,
    )  # fmt: skip
    stale = update_clearances(
        candidates, distances, is_gone,
        former_vertices, former_vertex_offsets, former_loops, former_loop_offsets, former_planes, former_facet_offsets,
        added_vertices, added_vertex_offsets, added_loops, added_loop_offsets, added_planes, added_facet_offsets,
        SAME_DISTANCE,
    )  # fmt: skip
    points = np.empty((stale.shape[0], 3))
    for index in range(stale.shape[0]):
        for k in range(3):
            points[index, k] = candidates[stale[index], k]
    found = clearances(points, vertices, vertex_offsets, loops, loop_offsets, planes, facet_offsets, cap)
    for index in range(stale.shape[0]):
        distances[stale[index]] = found[index]
    return corners, offsets, cells, partitions, candidates, candidate_portals, distances
