"""What a planner asks of collision checking."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.scene.pose import FloatArray


class CollisionChecker(Protocol):
    """Tells whether configurations and straight edges of a robot are free of collision in one scene.

    Not thread-safe: each thread has its own (`clone`).
    """

    @property
    def checks(self) -> int:
        """How many configurations have been given to the exact check so far."""
        ...

    def is_free(self, configuration: FloatArray) -> bool:
        """Whether a configuration (n,) is free. Limits are not looked at."""
        ...

    def is_edge_free(self, start: FloatArray, end: FloatArray, resolution: float | None = None) -> bool:
        """Whether the straight edge from start to end, both (n,), is free.

        States are checked so densely that no point of the robot moves further than `resolution` [m] from one to the
        next (default: the checker's). Both ends are checked too.
        """
        ...

    def surely_free(self, configurations: FloatArray) -> NDArray[np.bool_]:
        """(m,) which of the configurations (m, n) are known to be free without much ado; `is_free` knows the rest."""
        ...

    def surely_free_edges(self, path: FloatArray) -> NDArray[np.bool_]:
        """(m - 1,) which edges of a path (m, n) are known to be free without much ado; see `surely_free`."""
        ...

    def colliding_bodies(self, configuration: FloatArray) -> tuple[str, str] | None:
        """The names of two bodies that touch in a configuration; None if it is free."""
        ...

    @property
    def padding(self) -> float:
        """Distance that links have to keep from obstacles [m]."""
        ...

    def touching_bodies(self, configuration: FloatArray) -> tuple[str, str] | None:
        """The names of two bodies that touch, not only come closer than the padding; None if there are none."""
        ...

    def clone(self) -> CollisionChecker:
        """One of the same scene and robot, for another thread."""
        ...
