"""Encodings of scenes as arrays of fixed size, for networks. They take any scene, not a generator's parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.scene.pose import FloatArray, frozen_array
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.scene.signed_distance import SignedDistance

FloatGrid = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class GridFrame:
    """Where the grid of a planar encoding lies: the smallest square around the workspace, its lower corner on theirs.

    Networks work in its coordinates, the unit square: u = (x - lower) / size.

    Attributes:
        lower: (2,) [m].
        size: edge [m].
    """

    lower: FloatArray
    size: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "lower", frozen_array(self.lower, (2,)))
        if not 0.0 < self.size < np.inf:
            raise InvalidOptionError("size", self.size, "a positive length")

    @staticmethod
    def of(scene: Scene) -> GridFrame:
        """Around the workspace of a scene."""
        lower, upper = scene.bounds.lower[:2], scene.bounds.upper[:2]
        return GridFrame(lower, float((upper - lower).max()))

    def to_unit(self, points: FloatArray) -> FloatArray:
        """Points (..., 2) [m] in the unit square."""
        return (points - self.lower) / self.size

    def to_metres(self, points: FloatArray) -> FloatArray:
        """Points (..., 2) of the unit square in the frame of the scene [m]."""
        return points * self.size + self.lower

    def cell_centres(self, cells: int) -> FloatArray:
        """(cells * cells, 2) centres of the cells of the grid [m]; x changes slowest."""
        return self.to_metres(unit_cell_centres(cells))


def unit_cell_centres(cells: int) -> FloatArray:
    """(cells * cells, 2) centres of cells x cells cells of the unit square; the first coordinate changes slowest."""
    along = (np.arange(cells) + 0.5) / cells
    return np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)


def distance_grid(scene: Scene, cells: int, section_height: float = 0.0) -> FloatGrid:
    """Signed distances at the centres of a grid over the section of a planar robot's workspace.

    The border of the workspace counts as an obstacle, since the robot cannot leave it.

    Args:
        scene: the obstacles.
        cells: along each edge of the grid, which is `GridFrame.of(scene)`.
        section_height: [m].

    Returns:
        (cells, cells), [i, j] at the i-th x and the j-th y, in edges of the grid (1 = its whole edge): positive outside
        of obstacles.

    Raises:
        InvalidObstacleError: if an obstacle has a shape without volume.
    """
    frame = GridFrame.of(scene)
    centres = frame.cell_centres(cells)
    distances = SignedDistance(scene, section_height).at(centres)
    lower, upper = scene.bounds.lower[:2], scene.bounds.upper[:2]
    inside = np.minimum(centres - lower, upper - centres).min(axis=1)
    return (np.minimum(distances, inside) / frame.size).reshape(cells, cells).astype(np.float32)


def occupancy_grid(scene: Scene, cells: int, section_height: float = 0.0) -> NDArray[np.bool_]:
    """Which centres of the cells of a grid over the section lie in an obstacle or outside the workspace.

    Arguments, order and errors as for `distance_grid`.

    Returns:
        (cells, cells).
    """
    return np.asarray(distance_grid(scene, cells, section_height) < 0.0)


def basis_points(lower: FloatArray, upper: FloatArray, count: int) -> FloatArray:
    """Points spread evenly over a box, the same ones for the same arguments: where distances are taken.

    Additive recurrence by the plastic number's generalisation (Roberts, 2018): the first so many points are always
    well spread.

    Args:
        lower, upper: (d,) corners of the box [m].
        count: number of points.

    Returns:
        (count, d) [m].
    """
    dimension = len(lower)
    # The root of x^(d + 1) = x + 1 above 1.
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (dimension + 1))
    steps = root ** -np.arange(1.0, dimension + 1.0)
    fractions = (0.5 + steps * np.arange(1, count + 1)[:, None]) % 1.0
    return np.asarray(lower + fractions * (np.asarray(upper) - lower))


def distances_at(scene: Scene, points: FloatArray, cap: float, section_height: float | None = None) -> FloatGrid:
    """Signed distances at basis points, cut off at +-cap: an encoding of fixed length for any scene.

    Args:
        scene: the obstacles.
        points: (m, 3), or (m, 2) in the section [m].
        cap: [m].
        section_height: of a planar robot's section [m]; None: three dimensions.

    Returns:
        (m,) [m].

    Raises:
        InvalidObstacleError: if an obstacle has a shape without volume.
    """
    return np.clip(SignedDistance(scene, section_height).at(points), -cap, cap).astype(np.float32)
