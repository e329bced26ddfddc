"""Facets of the obstacles of a scene: the input of the BSP."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.decomposition.box_batch import placed_boxes
from bsp_informed_planner.decomposition.facet_kernels import clip_facets, snap_facets
from bsp_informed_planner.decomposition.facet_set import FacetSet
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.scene.polytopes import cross_section, polytopes_of_obstacle, prism
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds


@dataclass(frozen=True, eq=False)
class PartitionFacets:
    """Facets within the workspace, on shared planes.

    Attributes:
        corners: (n, 3) [m]; offsets: (m + 1,) where the corners of each facet begin.
        planes: (p, 4) rows (n, d), the plane n . x = d; the first six are those of the workspace.
        facet_planes: (m,) index of the plane of each facet.
        areas: (m,) [m^2].
        snapped_planes: (f, 4) planes of all facets of the `FacetSet` after snapping, outward.
    """

    corners: Floats
    offsets: Indices
    planes: Floats
    facet_planes: Indices
    areas: Floats
    snapped_planes: Floats


def decomposed_bounds(scene: Scene, options: DecompositionOptions) -> WorkspaceBounds:
    """The workspace; in 2D a slab around the section, as high as the workspace is long."""
    if options.dimension == 3:
        return scene.bounds
    lower, upper = scene.bounds.lower.copy(), scene.bounds.upper.copy()
    half = 0.5 * float((upper - lower)[:2].max())
    lower[2], upper[2] = options.section_height - half, options.section_height + half
    return WorkspaceBounds(lower, upper)


def read_facets(scene: Scene, options: DecompositionOptions) -> FacetSet:
    """The facets of all obstacles, as convex polytopes; in 2D of the upright prisms over their cross-sections.

    Boxes come first.

    Raises:
        InvalidObstacleError: if an obstacle has a shape without volume.
    """
    flat = options.dimension == 2
    bounds = decomposed_bounds(scene, options)
    boxes, others = placed_boxes(scene)
    if flat:
        sections, tilted = boxes.upright(options.section_height, bounds)
        polytopes = tilted.polytopes()
    else:
        sections, polytopes = boxes, []
    for obstacle in others:
        polytopes.extend(polytopes_of_obstacle(obstacle, scene.bounds, options.curve_tolerance))
    if flat:
        # Prisms stand out of the slab, so that their ends do not count.
        height = float(bounds.upper[2] - bounds.lower[2])
        polygons = (cross_section(polytope, options.section_height) for polytope in polytopes)
        polytopes = [
            prism(polygon, bounds.lower[2] - height, bounds.upper[2] + height)
            for polygon in polygons
            if polygon is not None
        ]
    return FacetSet.joined(sections.facets(), FacetSet.of(polytopes)) if polytopes else sections.facets()


def partition_facets(facets: FacetSet, bounds: WorkspaceBounds, options: DecompositionOptions) -> PartitionFacets:
    """Clips facets to the workspace and snaps nearly coplanar ones onto shared planes.

    Facets outside and on the border of the workspace are left out; those that snap to it have one of the first six
    planes.
    """
    corners, offsets, sources, areas = clip_facets(
        facets.vertices, facets.loops, facets.loop_offsets, bounds.lower, bounds.upper
    )
    polytope_of = np.repeat(np.arange(len(facets.facet_offsets) - 1), np.diff(facets.facet_offsets))
    planes, facet_planes, snapped = snap_facets(
        corners,
        offsets,
        sources,
        np.argsort(-areas, kind="stable"),
        facets.planes,
        polytope_of,
        bounds.lower,
        bounds.upper,
        options.bsp.plane_tolerance,
        options.bsp.gap_tolerance,
    )
    return PartitionFacets(corners, offsets, planes, facet_planes, areas, snapped)
