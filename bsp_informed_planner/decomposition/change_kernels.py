"""Which parts of the BSP tree a change of obstacles touches."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.decomposition.cell_kernels import cells_of_body
from bsp_informed_planner.decomposition.clipping_kernels import BOUNDS_PLANES
from bsp_informed_planner.decomposition.facet_kernels import OF_FACET, OF_PARTITION, UNUSED
from bsp_informed_planner.decomposition.fate_kernels import ENTERED, KEPT, REPLACED
from bsp_informed_planner.decomposition.portal_kernels import ANY


@kernel
def fates_of_nodes(
    plane_indices: Indices,
    node_planes: Floats,
    node_front: Indices,
    node_back: Indices,
    node_solid: Flags,
    facet_planes: Indices,
    facet_bodies: Indices,
    plane_count: int,
    is_gone: Flags,
    former: Floats,
    former_offsets: Indices,
    added: Floats,
    added_offsets: Indices,
    few_cells: int,
    useless_cells: int,
    touched_share: float,
) -> tuple[Indices, Indices, int, int]:
    """What has to be partitioned anew when obstacles come and go.

    A cell is touched by an obstacle that is gone, or, unless it is an obstacle already, by an added one. A node is
    replaced with all below it if a cell below it is touched, and

    - there are at most `few_cells` below it, or
    - its plane has no facet any more, and there are at most `useless_cells` below it, or
    - at least `touched_share` of them are touched.

    Args:
        plane_indices, node_planes, node_front, node_back, node_solid: (n,) the tree.
        facet_planes, facet_bodies: (f,) plane and polytope of each former facet; plane_count: p.
        is_gone: (b,) for each former polytope.
        former, former_offsets, added, added_offsets: vertices (v, 3) of the former and of added polytopes, and where
            those of each begin.

    Returns:
        fates (n,), see `build_tree`; for each plane UNUSED, OF_PARTITION or OF_FACET (p,), as far as nodes and facets
        stay; how many cells are replaced; how many there are.
    """
    uses = np.full(plane_count, UNUSED, np.int64)
    for plane in range(BOUNDS_PLANES):
        uses[plane] = OF_FACET
    for facet in range(facet_planes.shape[0]):
        if not is_gone[facet_bodies[facet]]:
            uses[facet_planes[facet]] = OF_FACET
    nodes = node_front.shape[0]
    everywhere = np.full(nodes, ANY, np.int64)
    touched = np.zeros(nodes, np.int64)
    found = np.empty(64, np.int64)
    for body in range(former_offsets.shape[0] - 1):
        if not is_gone[body]:
            continue
        found, count = cells_of_body(
            former, former_offsets[body], former_offsets[body + 1],
            node_planes, node_front, node_back, everywhere, ANY, found,
        )  # fmt: skip
        for index in range(count):
            touched[found[index]] = 1
    for body in range(added_offsets.shape[0] - 1):
        found, count = cells_of_body(
            added, added_offsets[body], added_offsets[body + 1],
            node_planes, node_front, node_back, everywhere, ANY, found,
        )  # fmt: skip
        for index in range(count):
            if not node_solid[found[index]]:
                touched[found[index]] = 1
    cells = np.ones(nodes, np.int64)
    for node in range(nodes - 1, -1, -1):
        if node_front[node] >= 0:
            cells[node] = cells[node_front[node]] + cells[node_back[node]]
            touched[node] = touched[node_front[node]] + touched[node_back[node]]

    fates = np.full(nodes, KEPT, np.int64)
    replaced = 0
    if touched[0] > 0:
        fates[0] = ENTERED
    for node in range(nodes):
        # Children come after their parents: when their turn comes, they have got their fate.
        is_cell = node_front[node] < 0
        if fates[node] == ENTERED:
            limit = few_cells if is_cell or uses[plane_indices[node]] == OF_FACET else useless_cells
            if is_cell or cells[node] <= limit or touched[node] >= touched_share * cells[node]:
                fates[node] = REPLACED
                replaced += cells[node]
        if is_cell:
            continue
        for child in (node_front[node], node_back[node]):
            fates[child] = KEPT if fates[node] == ENTERED and touched[child] == 0 else fates[node]
        if fates[node] != REPLACED and uses[plane_indices[node]] == UNUSED:
            uses[plane_indices[node]] = OF_PARTITION
    return fates, uses, replaced, cells[0]
