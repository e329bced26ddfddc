"""Facets of convex polytopes in flat arrays, as kernels take them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.scene.convex_polytope import ConvexPolytope
from bsp_informed_planner.scene.pose import FloatArray

IndexArray = NDArray[np.int64]


def facet_arrays(
    polytopes: Sequence[ConvexPolytope],
) -> tuple[FloatArray, IndexArray, IndexArray, IndexArray, FloatArray, IndexArray]:
    """The facets of b convex polytopes.

    Returns:
        vertices (v, 3) [m]; where the vertices of each polytope begin (b + 1,); loops (l,), indices into the vertices,
        the corners of each facet in order; where the loop of each facet begins (f + 1,); planes (f, 4), rows (n, d) of
        an outward unit normal n, with n . x <= d [m] inside; where the facets of each polytope begin (b + 1,).
    """
    faces = [face for body in polytopes for face in body.faces]
    vertex_offsets = _offsets([len(body.vertices) for body in polytopes])
    facet_counts = [len(body.faces) for body in polytopes]
    loop_lengths = [len(face) for face in faces]
    loops = np.concatenate([np.empty(0, np.int64), *faces])
    loops += np.repeat(np.repeat(vertex_offsets[:-1], facet_counts), loop_lengths)
    return (
        np.concatenate([np.empty((0, 3)), *(body.vertices for body in polytopes)]),
        vertex_offsets,
        loops,
        _offsets(loop_lengths),
        np.concatenate([np.empty((0, 4)), *(body.planes for body in polytopes)]),
        _offsets(facet_counts),
    )


def _offsets(counts: list[int]) -> IndexArray:
    offsets = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(counts, out=offsets[1:])
    return offsets
