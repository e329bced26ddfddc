"""What networks see of a scene, and the coordinates in which they see states. Both are part of a model's card."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.scene.encodings import (
    FloatGrid,
    GridFrame,
    basis_points,
    distance_grid,
    distances_at,
    occupancy_grid,
)
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene


class StateFrame(Protocol):
    """The coordinates of states in a network: about 0 to 1."""

    def to_unit(self, points: FloatArray) -> FloatArray:
        """States (..., n) [rad or m] as a network takes them."""
        ...

    def to_metres(self, points: FloatArray) -> FloatArray:
        """What a network returns (..., n) as states [rad or m]."""
        ...


@dataclass(frozen=True)
class LimitsFrame:
    """Joint limits as the unit cube. `lower`, `upper`: (n,) [rad or m]."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def to_unit(self, points: FloatArray) -> FloatArray:
        lower, upper = np.array(self.lower), np.array(self.upper)
        return (points - lower) / (upper - lower)

    def to_metres(self, points: FloatArray) -> FloatArray:
        lower, upper = np.array(self.lower), np.array(self.upper)
        return points * (upper - lower) + lower


class SceneEncoding(Protocol):
    """Turns scenes into arrays of one shape. The classes below are dataclasses of JSON values."""

    @property
    def kind(self) -> str:
        """Its name in cards."""
        ...

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the arrays."""
        ...

    def encode(self, scene: Scene) -> FloatGrid:
        """The scene, as numbers of a size around 1.

        Raises:
            InvalidObstacleError: if an obstacle has a shape without volume.
        """
        ...

    def state_frame(self, scene: Scene) -> StateFrame:
        """The coordinates of states beside this encoding."""
        ...


@dataclass(frozen=True)
class PlanarDistances:
    """Signed distances on a grid over a planar robot's workspace, see `distance_grid`; states in its unit square."""

    cells: int
    section_height: float = 0.0
    kind: str = "planar_distances"

    @property
    def shape(self) -> tuple[int, int]:
        return self.cells, self.cells

    def encode(self, scene: Scene) -> FloatGrid:
        return distance_grid(scene, self.cells, self.section_height)

    def state_frame(self, scene: Scene) -> GridFrame:
        return GridFrame.of(scene)


@dataclass(frozen=True)
class PlanarOccupancy:
    """1 where the centre of a cell is in an obstacle or outside the workspace, else 0; states as `PlanarDistances`."""

    cells: int
    section_height: float = 0.0
    kind: str = "planar_occupancy"

    @property
    def shape(self) -> tuple[int, int]:
        return self.cells, self.cells

    def encode(self, scene: Scene) -> FloatGrid:
        return occupancy_grid(scene, self.cells, self.section_height).astype(np.float32)

    def state_frame(self, scene: Scene) -> GridFrame:
        return GridFrame.of(scene)


@dataclass(frozen=True)
class BasisDistances:
    """Signed distances at points spread over a box of the robot's root frame, in units of `cap`; states within limits.

    Attributes:
        box_lower, box_upper: (3,) of the box [m].
        count: number of points.
        cap: distances are cut off at +-cap [m].
        state_lower, state_upper: (n,) limits of the states [rad or m].
    """

    box_lower: tuple[float, ...]
    box_upper: tuple[float, ...]
    count: int
    cap: float
    state_lower: tuple[float, ...]
    state_upper: tuple[float, ...]
    kind: str = "basis_distances"

    @property
    def shape(self) -> tuple[int]:
        return (self.count,)

    def encode(self, scene: Scene) -> FloatGrid:
        points = basis_points(np.array(self.box_lower), np.array(self.box_upper), self.count)
        return distances_at(scene, points, self.cap) / np.float32(self.cap)

    def state_frame(self, scene: Scene) -> LimitsFrame:
        return LimitsFrame(self.state_lower, self.state_upper)


_ENCODINGS: dict[str, type] = {
    "planar_distances": PlanarDistances,
    "planar_occupancy": PlanarOccupancy,
    "basis_distances": BasisDistances,
}


def encoding_to_json(encoding: SceneEncoding) -> dict[str, Any]:
    """An encoding as JSON values."""
    return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(encoding).items()}  # type: ignore[call-overload]


def encoding_from_json(values: Mapping[str, Any]) -> SceneEncoding:
    """The encoding that `encoding_to_json` wrote.

    Raises:
        InvalidOptionError: if it is none.
    """
    kind = values.get("kind")
    if kind not in _ENCODINGS:
        raise InvalidOptionError("encoding", kind, f"one of {', '.join(_ENCODINGS)}")
    try:
        encoding: SceneEncoding = _ENCODINGS[kind](
            **{k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        )
    except TypeError as error:
        raise InvalidOptionError("encoding", dict(values), f"the parameters of {kind}") from error
    return encoding
