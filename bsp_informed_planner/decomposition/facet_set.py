"""Facets of convex polytopes in flat arrays, as kernels take them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.decomposition.array_types import Floats, Indices
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
    """

    vertices: Floats
    vertex_offsets: Indices
    loops: Indices
    loop_offsets: Indices
    planes: Floats
    facet_offsets: Indices

    @staticmethod
    def of(polytopes: Iterable[ConvexPolytope]) -> FacetSet:
        """The facets of polytopes."""
        bodies = list(polytopes)
        faces = [face for body in bodies for face in body.faces]
        vertex_offsets = _offsets([len(body.vertices) for body in bodies])
        facet_counts = [len(body.faces) for body in bodies]
        loop_lengths = [len(face) for face in faces]
        loops = np.concatenate([np.empty(0, np.int64), *faces])
        loops += np.repeat(np.repeat(vertex_offsets[:-1], facet_counts), loop_lengths)
        return FacetSet(
            np.concatenate([np.empty((0, 3)), *(body.vertices for body in bodies)]),
            vertex_offsets,
            loops,
            _offsets(loop_lengths),
            np.concatenate([np.empty((0, 4)), *(body.planes for body in bodies)]),
            _offsets(facet_counts),
        )

    @staticmethod
    def joined(first: FacetSet, second: FacetSet) -> FacetSet:
        """The facets of two sets, in order."""
        return FacetSet(
            np.concatenate((first.vertices, second.vertices)),
            np.concatenate((first.vertex_offsets, second.vertex_offsets[1:] + first.vertex_offsets[-1])),
            np.concatenate((first.loops, second.loops + len(first.vertices))),
            np.concatenate((first.loop_offsets, second.loop_offsets[1:] + first.loop_offsets[-1])),
            np.concatenate((first.planes, second.planes)),
            np.concatenate((first.facet_offsets, second.facet_offsets[1:] + first.facet_offsets[-1])),
        )

    @property
    def facet_count(self) -> int:
        return len(self.planes)


def _offsets(counts: list[int]) -> Indices:
    offsets = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(counts, out=offsets[1:])
    return offsets
