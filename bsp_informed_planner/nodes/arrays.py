"""NumPy arrays in message fields."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.scene.pose import FloatArray


def float64_field(values: FloatArray) -> array[float]:
    """An array of any shape, flattened row by row, for a float64[] field."""
    return array("d", np.ascontiguousarray(values, dtype=np.float64).tobytes())


def float64_rows(table: FloatArray) -> list[array[float]]:
    """The rows of a table, (k, n), each for a float64[] field of a message of its own."""
    flat, width = float64_field(table), table.shape[1]
    return [flat[first : first + width] for first in range(0, len(flat), width)]


def int32_field(values: np.ndarray) -> array[int]:
    """The same for an int32[] field."""
    return array("i", np.ascontiguousarray(values, dtype=np.int32).tobytes())


def uint32_field(values: np.ndarray) -> array[int]:
    """The same for a uint32[] field."""
    return array("I", np.ascontiguousarray(values, dtype=np.uint32).tobytes())


def rows(values: Sequence[float], width: int, name: str) -> FloatArray:
    """A flat field as rows: (k, width).

    Raises:
        ValueError: if its length is no multiple of the width.
    """
    flat = np.asarray(values, dtype=np.float64)
    if width < 1 or flat.size % width:
        raise ValueError(f"{name}: {flat.size} numbers are no rows of {width}")
    return flat.reshape(-1, width)
