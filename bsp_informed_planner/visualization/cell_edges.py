"""Edges of the free cells of a decomposition."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.scene.pose import FloatArray

# Ends closer than this are the same [m].
RESOLUTION = 1e-5


def cell_edges(decomposition: Decomposition) -> FloatArray:
    """(e, 2, 3) edges of all free cells [m]; an edge that several cells have in full is there once."""
    parts = []
    for cell in decomposition.free_cells:
        polytope = decomposition.cell_polytope(int(cell))
        if polytope is not None:
            parts.append(polytope.vertices[polytope.edges])
    if not parts:
        return np.empty((0, 2, 3))
    edges = np.concatenate(parts)
    keys = np.round(edges / RESOLUTION).astype(np.int64)
    # The lower end first, so that an edge is the same from both sides.
    swapped = np.lexsort((keys[:, :, 2], keys[:, :, 1], keys[:, :, 0]), axis=1)[:, :1] == 1
    keys = np.where(swapped[..., None], keys[:, ::-1], keys)
    _, first = np.unique(keys.reshape(len(keys), 6), axis=0, return_index=True)
    return edges[np.sort(first)]
