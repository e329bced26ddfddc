"""Facets of the obstacles of a scene: the input of the BSP."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.decomposition.box_batch import placed_boxes
from bsp_informed_planner.decomposition.clipping_kernels import BOUNDS_PLANES, bounds_planes
from bsp_informed_planner.decomposition.facet_kernels import OF_FACET, clip_facets, snap_facets
from bsp_informed_planner.decomposition.facet_set import FacetSet
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.decomposition.selection_kernels import exchange_facets
from bsp_informed_planner.scene.polytopes import cross_section, polytopes_of_obstacle, prism, thickened
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds

# What is thinner is made so thick [m]: its facets are far larger than what counts as a rounding error.
THINNEST = 2e-5


@dataclass(frozen=True, eq=False)
class PartitionFacets:
    """Facets within the workspace, on shared planes.

    Attributes:
        corners: (n, 3) [m]; offsets: (m + 1,) where the corners of each facet begin.
        planes: (p, 4) rows (n, d), the plane n . x = d; the first six are those of the workspace.
        facet_planes: (m,) index of the plane of each facet.
        areas: (m,) [m^2].
        spheres: (m, 4) centre and radius of a sphere around each facet [m].
        bodies: (m,) index of the polytope of each facet.
        snapped_planes: (f, 4) planes of all facets of the `FacetSet` after snapping, outward.
    """

    corners: Floats
    offsets: Indices
    planes: Floats
    facet_planes: Indices
    areas: Floats
    spheres: Floats
    bodies: Indices
    snapped_planes: Floats

    def exchanged(self, facets: FacetSet, is_gone: Flags, added: PartitionFacets) -> PartitionFacets:
        """These facets of `facets` without those of polytopes that are gone (b,), and then others.

        Args:
            facets: what these are facets of.
            is_gone: (b,) for each of its polytopes.
            added: facets on the same planes and, beyond them, others.
        """
        corners, offsets, facet_planes, areas, spheres, bodies, snapped = exchange_facets(
            *self._arrays, facets.facet_offsets, is_gone, *added._arrays
        )
        return PartitionFacets(corners, offsets, added.planes, facet_planes, areas, spheres, bodies, snapped)

    @property
    def _arrays(self) -> tuple[Floats, Indices, Indices, Floats, Floats, Indices, Floats]:
        """All attributes but `planes`: arguments of kernels."""
        return (
            self.corners,
            self.offsets,
            self.facet_planes,
            self.areas,
            self.spheres,
            self.bodies,
            self.snapped_planes,
        )


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

    Boxes come first. Owners are positions of obstacles in the scene. What is thinner than 20 um is thickened to that.

    Raises:
        InvalidObstacleError: if an obstacle has a shape without volume.
    """
    flat = options.dimension == 2
    bounds = decomposed_bounds(scene, options)
    boxes, others = placed_boxes(scene)
    boxes = replace(boxes, sizes=np.maximum(boxes.sizes, THINNEST))
    if flat:
        sections, tilted = boxes.upright(options.section_height, bounds)
        polytopes, owners = tilted.polytopes(), tilted.owners.tolist()
    else:
        sections, polytopes, owners = boxes, [], []
    for number, obstacle in others:
        parts = polytopes_of_obstacle(obstacle, bounds, options.curve_tolerance)
        polytopes.extend(thickened(part, THINNEST) for part in parts)
        owners.extend([number] * len(parts))
    if flat:
        # Prisms stand out of the slab, so that their ends do not count.
        height = float(bounds.upper[2] - bounds.lower[2])
        polygons = [cross_section(polytope, options.section_height) for polytope in polytopes]
        owners = [owner for owner, polygon in zip(owners, polygons, strict=True) if polygon is not None]
        polytopes = [
            prism(polygon, bounds.lower[2] - height, bounds.upper[2] + height)
            for polygon in polygons
            if polygon is not None
        ]
    return FacetSet.joined(sections.facets(), FacetSet.of(polytopes, owners)) if polytopes else sections.facets()


def partition_facets(
    facets: FacetSet,
    bounds: WorkspaceBounds,
    options: DecompositionOptions,
    planes: Floats | None = None,
    uses: Indices | None = None,
) -> PartitionFacets:
    """Clips facets to the workspace and snaps nearly coplanar ones onto shared planes.

    Facets outside and on the border of the workspace are left out; those that snap to it have one of the first six
    planes.

    Args:
        facets: of the obstacles.
        bounds: of the workspace.
        options: of the decomposition.
        planes, uses: a table of planes (g, 4) that is there already, and what uses each, see `snap_facets`; None for
            the planes of the workspace alone.
    """
    if planes is None or uses is None:
        planes = bounds_planes(bounds.lower, bounds.upper)
        uses = np.full(BOUNDS_PLANES, OF_FACET)
    corners, offsets, sources, bodies, areas, spheres = clip_facets(
        facets.vertices, facets.loops, facets.loop_offsets, facets.facet_offsets, bounds.lower, bounds.upper
    )
    planes, facet_planes, snapped = snap_facets(
        corners,
        offsets,
        sources,
        bodies,
        areas,
        facets.vertices,
        facets.vertex_offsets,
        facets.planes,
        planes,
        uses,
        bounds.lower,
        bounds.upper,
        options.bsp.plane_tolerance,
        options.bsp.gap_tolerance,
    )
    return PartitionFacets(corners, offsets, planes, facet_planes, areas, spheres, bodies, snapped)
