"""A checker whose truth is plain: discs in the plane."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.scene.pose import FloatArray


class DiscChecker:
    """Collision checking of a point among discs, exact for states and for whole edges.

    Args:
        centres: (k, n).
        radii: (k,).
    """

    def __init__(self, centres: FloatArray, radii: FloatArray) -> None:
        self._centres = np.asarray(centres, dtype=np.float64)
        self._radii = np.asarray(radii, dtype=np.float64)
        self.checks = 0

    def is_free(self, configuration: FloatArray) -> bool:
        self.checks += 1
        return bool((np.linalg.norm(self._centres - configuration, axis=1) > self._radii).all())

    def is_edge_free(self, start: FloatArray, end: FloatArray, resolution: float | None = None) -> bool:
        self.checks += 1
        direction = end - start
        length = float(direction @ direction)
        fraction = np.zeros(len(self._centres))
        if length > 0.0:
            fraction = np.clip((self._centres - start) @ direction / length, 0.0, 1.0)
        nearest = start + fraction[:, None] * direction
        return bool((np.linalg.norm(nearest - self._centres, axis=1) > self._radii).all())

    def colliding_bodies(self, configuration: FloatArray) -> tuple[str, str] | None:
        return None if self.is_free(configuration) else ("point", "disc")

    def clone(self) -> DiscChecker:
        return DiscChecker(self._centres, self._radii)
