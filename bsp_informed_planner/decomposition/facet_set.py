"""Facets of convex polytopes in flat arrays, as kernels take them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.decomposition.selection_kernels import exchange_bodies
from bsp_informed_planner.scene.facet_arrays import facet_arrays
from bsp_informed_planner.scene.polytopes import ConvexPolytope


@dataclass(frozen=True, eq=False)
class FacetSet:
    """The facets of b convex polytopes, in flat arrays.

    Attributes:
        vertices: (v, 3) [m].
        vertex_offsets: (b + 1,) where the vertices of each polytope begin.
        loops: (l,) indices into `vertices`, the corners of each facet in order.
        loop_offsets: (f + 1,) where the loop of each facet begins.
        planes: (f, 4) rows (n, d): outward unit normal n, with n . x <= d [m] inside.
        facet_offsets: (b + 1,) where the facets of each polytope begin.
        owners: (b,) number of the obstacle that each polytope belongs to.
    """

    vertices: Floats
    vertex_offsets: Indices
    loops: Indices
    loop_offsets: Indices
    planes: Floats
    facet_offsets: Indices
    owners: Indices

    @staticmethod
    def of(polytopes: Iterable[ConvexPolytope], owners: Iterable[int] | None = None) -> FacetSet:
        """The facets of polytopes, which all belong to obstacle 0 if no owners are given."""
        bodies = list(polytopes)
        arrays = facet_arrays(bodies)
        return FacetSet(*arrays, np.zeros(len(bodies), np.int64) if owners is None else np.fromiter(owners, np.int64))

    @staticmethod
    def joined(first: FacetSet, second: FacetSet) -> FacetSet:
        """The facets of two sets, in order."""
        return first.exchanged(np.zeros(len(first), np.bool_), second)

    def exchanged(self, is_gone: Flags, added: FacetSet) -> FacetSet:
        """The facets of those polytopes that are not gone (b,), and then others."""
        owners = np.concatenate((self.owners[~is_gone], added.owners))
        return FacetSet(*exchange_bodies(*self.arrays, is_gone, *added.arrays), owners)

    @property
    def arrays(self) -> tuple[Floats, Indices, Indices, Indices, Floats, Indices]:
        """All attributes but the owners: arguments of kernels."""
        return self.vertices, self.vertex_offsets, self.loops, self.loop_offsets, self.planes, self.facet_offsets

    def __len__(self) -> int:
        return len(self.owners)

    @property
    def facet_count(self) -> int:
        return len(self.planes)
