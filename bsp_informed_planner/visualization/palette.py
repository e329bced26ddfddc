"""Colours that all pictures share: red, green and blue in [0, 1]."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from bsp_informed_planner.scene.pose import FloatArray

Colour = tuple[float, float, float]

START: Colour = (0.12, 0.38, 0.85)
GOAL: Colour = (0.88, 0.16, 0.22)
# Half way, so that the middle of a path is neither grey nor dim.
MIDDLE: Colour = (0.58, 0.30, 0.80)
KEYPOINT: Colour = (1.0, 0.80, 0.10)
BASE: Colour = (0.55, 0.57, 0.60)
PORTAL: Colour = (0.05, 0.65, 0.45)
CELL: Colour = (0.45, 0.52, 0.62)
CANDIDATE: Colour = (0.35, 0.42, 0.50)
GRAPH: Colour = (0.80, 0.45, 0.15)
FURNITURE: Colour = (0.88, 0.80, 0.68)
ITEM: Colour = (0.62, 0.68, 0.74)
WALL: Colour = (0.25, 0.28, 0.33)
TEXT: Colour = (0.10, 0.12, 0.16)
FAINT_TEXT: Colour = (0.38, 0.42, 0.48)
BACKGROUND: Colour = (0.965, 0.970, 0.978)


def progress_colours(fractions: ArrayLike) -> FloatArray:
    """(m, 3) colours of places along a path, from the start's at 0 to the goal's at 1."""
    values = np.clip(np.asarray(fractions, dtype=np.float64).reshape(-1), 0.0, 1.0)
    knots = np.array([START, MIDDLE, GOAL])
    return np.stack([np.interp(values, [0.0, 0.5, 1.0], knots[:, channel]) for channel in range(3)], axis=1)
