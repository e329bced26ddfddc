"""Merging of neighbouring keypoints."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from bsp_informed_planner.decomposition.array_types import Floats
from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.decomposition.graph import has_line_of_sight


def merge_keypoints(points: ArrayLike, epsilon: float, decomposition: Decomposition | None = None) -> Floats:
    """Merges neighbouring keypoints closer than epsilon to their midpoint (paper, Algorithm 2, lines 17 to 22).

    The ends of the chain stay. The paper's procedure can cut corners of obstacles; with a decomposition given, two
    keypoints stay apart if a segment to their midpoint would leave the free cells.

    Args:
        points: (m, 3) start, keypoints, goal [m].
        epsilon: [m]; 0 merges nothing.
        decomposition: of the workspace; None for the paper's procedure.

    Returns:
        (k, 3) start, keypoints that are left, goal.

    Raises:
        ValueError: for points of another shape, or not finite.
    """
    chain = np.array(points, dtype=np.float64)
    if chain.ndim != 2 or chain.shape[1] != 3 or len(chain) < 2:
        raise ValueError(f"points of shape {chain.shape}: expected (m, 3) with m of at least 2")
    if not np.isfinite(chain).all():
        raise ValueError(f"points: number {int(np.argmax(~np.isfinite(chain).all(axis=1)))} is not finite")
    kept = [chain[0]]
    current = chain[1]
    for following, beyond in zip(chain[2:-1], chain[3:], strict=True):
        middle = 0.5 * (current + following)
        if np.linalg.norm(following - current) < epsilon and (
            decomposition is None
            or (has_line_of_sight(decomposition, kept[-1], middle) and has_line_of_sight(decomposition, middle, beyond))
        ):
            current = middle
        else:
            kept.append(current)
            current = following
    kept.append(current)
    if len(chain) > 2:
        kept.append(chain[-1])
    return np.array(kept)
