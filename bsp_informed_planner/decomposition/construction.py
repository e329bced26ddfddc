"""The making of a decomposition: from scratch, or by changing a former one where obstacles have changed."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.decomposition.assembly_kernels import (
    candidates_of_changed_portals,
    candidates_of_portals,
    portals_of_tree,
)
from bsp_informed_planner.decomposition.bsp_kernels import build_tree
from bsp_informed_planner.decomposition.change_kernels import fates_of_nodes
from bsp_informed_planner.decomposition.facet_set import FacetSet
from bsp_informed_planner.decomposition.facets import PartitionFacets, partition_facets
from bsp_informed_planner.decomposition.fate_kernels import REPLACED
from bsp_informed_planner.decomposition.options import DecompositionOptions, UpdateOptions
from bsp_informed_planner.scene.scene import WorkspaceBounds


@dataclass(frozen=True, eq=False)
class Construction:
    """What a decomposition is made of, with what it takes to change it.

    Attributes:
        facets: of the obstacles.
        pieces: those facets within the workspace, on shared planes.
        plane_indices: (n,) index of the plane of each node in `pieces.planes`, -1 for a leaf.
        node_planes, node_front, node_back, node_solid: (n,) see `Decomposition`.
        portal_corners, portal_offsets, portal_cells: see `Decomposition`.
        partitions: (p,) the node whose plane each portal is in.
        candidates, candidate_portals, candidate_clearances: see `Decomposition`.
        split_count: how often a facet was cut in two.
        replaced_cells: number of cells that are not those of the former decomposition.
        partition_seconds, portal_seconds, graph_seconds: see `DecompositionTimings`.
    """

    facets: FacetSet
    pieces: PartitionFacets
    plane_indices: Indices
    node_planes: Floats
    node_front: Indices
    node_back: Indices
    node_solid: Flags
    portal_corners: Floats
    portal_offsets: Indices
    portal_cells: Indices
    partitions: Indices
    candidates: Floats
    candidate_portals: Indices
    candidate_clearances: Floats
    split_count: int = 0
    replaced_cells: int = 0
    partition_seconds: float = 0.0
    portal_seconds: float = 0.0
    graph_seconds: float = 0.0

    @property
    def leaf_count(self) -> int:
        """Number of cells, free and solid."""
        return (len(self.node_front) + 1) // 2


def construct(facets: FacetSet, bounds: WorkspaceBounds, options: DecompositionOptions) -> Construction:
    """The decomposition of a workspace, from scratch."""
    begin = time.perf_counter()
    pieces = partition_facets(facets, bounds, options)
    return _constructed(_NOTHING, _ALL, 0, facets, pieces, None, bounds, options, begin)


def update(
    former: Construction,
    gone: Flags,
    added: FacetSet,
    bounds: WorkspaceBounds,
    options: DecompositionOptions,
    limits: UpdateOptions,
) -> Construction | None:
    """The decomposition of a workspace in which obstacles have come and gone, from the one before.

    Facets keep the planes that they have been moved to, and added ones are moved to planes that are there. Partitions
    of planes without facets stay in parts of the tree that nothing has touched. The rest is what `construct` makes.

    Args:
        former: the decomposition before.
        gone: (b,) which of its polytopes are there no more.
        added: the new polytopes.
        bounds, options: the same as before.
        limits: see there; `growth` and `changed_share` are for the caller to keep.

    Returns:
        None if more than `replaced_share` of the cells would have to be replaced.
    """
    begin = time.perf_counter()
    pieces = former.pieces
    fates, uses, replaced, cells = fates_of_nodes(
        former.plane_indices,
        former.node_planes,
        former.node_front,
        former.node_back,
        former.node_solid,
        pieces.facet_planes,
        pieces.bodies,
        len(pieces.planes),
        gone,
        former.facets.vertices,
        former.facets.vertex_offsets,
        added.vertices,
        added.vertex_offsets,
        limits.few_cells,
        limits.useless_cells,
        limits.touched_share,
    )
    if replaced > limits.replaced_share * cells:
        return None
    facets = former.facets.exchanged(gone, added)
    added_pieces = partition_facets(added, bounds, options, pieces.planes, uses)
    pieces = pieces.exchanged(former.facets, gone, added_pieces)
    return _constructed(former, fates, cells - replaced, facets, pieces, (gone, added), bounds, options, begin)


def _constructed(
    former: Construction,
    fates: Indices,
    kept_cells: int,
    facets: FacetSet,
    pieces: PartitionFacets,
    changes: tuple[Flags, FacetSet] | None,
    bounds: WorkspaceBounds,
    options: DecompositionOptions,
    begin: float,
) -> Construction:
    """A decomposition that takes the parts of a former one that the fates of its nodes leave."""
    bsp = options.bsp
    plane_indices, node_planes, front, back, new_numbers, split_count = build_tree(
        pieces.corners,
        pieces.offsets,
        pieces.facet_planes,
        pieces.areas,
        pieces.spheres,
        pieces.planes,
        former.plane_indices,
        former.node_front,
        former.node_back,
        fates,
        bsp.split_weight,
        bsp.imbalance_weight,
        bsp.area_weight,
        bsp.coplanar_weight,
        bsp.maximum_candidates,
    )
    partitioned = time.perf_counter()

    solid, corners, offsets, cells, partitions = portals_of_tree(
        node_planes,
        front,
        back,
        new_numbers,
        former.node_solid,
        facets.vertices,
        facets.vertex_offsets,
        pieces.snapped_planes,
        facets.facet_offsets,
        bounds.lower,
        bounds.upper,
    )
    cut = time.perf_counter()

    flat, grid = options.dimension == 2, options.grid
    placement: tuple[Any, ...] = (grid, 1 if flat else grid, flat, options.effective_margin)
    placement += (options.minimum_portal_width, options.clearance_cap)
    geometry: tuple[Any, ...] = facets.arrays
    if changes is None:
        candidates, candidate_portals, distances = candidates_of_portals(
            corners, offsets, partitions, node_planes, *placement, *geometry
        )
    else:
        gone, added = changes
        geometry = (gone, *former.facets.arrays, *added.arrays, *geometry)
        corners, offsets, cells, partitions, candidates, candidate_portals, distances = candidates_of_changed_portals(
            former.portal_corners,
            former.portal_offsets,
            former.portal_cells,
            former.partitions,
            former.candidates,
            former.candidate_portals,
            former.candidate_clearances,
            new_numbers,
            corners,
            offsets,
            cells,
            partitions,
            node_planes,
            *placement,
            *geometry,
        )
    done = time.perf_counter()
    return Construction(
        facets,
        pieces,
        plane_indices,
        node_planes,
        front,
        back,
        solid,
        corners,
        offsets,
        cells,
        partitions,
        candidates,
        candidate_portals,
        distances,
        int(split_count),
        (len(front) + 1) // 2 - kept_cells,
        partitioned - begin,
        cut - partitioned,
        done - cut,
    )


def _nothing() -> Construction:
    """A single cell, as if it were to be replaced."""
    none, points = np.empty(0, np.int64), np.empty((0, 3))
    leaf, start = np.full(1, -1), np.zeros(1, np.int64)
    facets = FacetSet.of(())
    pieces = PartitionFacets(
        points, start, np.empty((0, 4)), none, np.empty(0), np.empty((0, 4)), none, np.empty((0, 4))
    )
    return Construction(
        facets, pieces, leaf, np.zeros((1, 4)), leaf, leaf, np.zeros(1, np.bool_),
        points, start, np.empty((0, 2), np.int64), none, points, none, np.empty(0),
    )  # fmt: skip


_NOTHING = _nothing()
_ALL = np.full(1, REPLACED)
