"""Mazes: the plane with rectilinear walls whose gaps are narrow passages (the paper's first experiment)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.pose import FloatArray, Pose, frozen_array
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box

# Half the height of the workspace, and of the walls, which stand out of it [m].
HALF_HEIGHT = 0.05
WALL_HALF_HEIGHT = 0.06
# Tries for one wall, for a pair of start and goal, and for a maze, before the options are called impossible.
_WALL_TRIES, _PAIR_TRIES, _MAZE_TRIES = 30, 200, 100


@dataclass(frozen=True)
class MazeOptions:
    """What random mazes look like. Lengths in m; ranges are (least, most).

    Attributes:
        size: edge of the square workspace [0, size]^2.
        walls: number of walls; a wall can be cut into pieces by its gaps.
        thickness: of a wall.
        gap: width of a gap.
        gaps: number of gaps in a wall that is long enough; else one.
        cell: least distance between parallel walls, and from a wall to the border.
        distance: least distance between start and goal.
        clearance: least distance of start and goal from walls and border.

    Raises:
        InvalidOptionError: if a range is empty or a length is not positive.
    """

    size: float = 1.0
    walls: tuple[int, int] = (4, 8)
    thickness: tuple[float, float] = (0.02, 0.05)
    gap: tuple[float, float] = (0.06, 0.12)
    gaps: tuple[int, int] = (1, 2)
    cell: float = 0.13
    distance: float = 0.4
    clearance: float = 0.015

    def __post_init__(self) -> None:
        for name in ("walls", "thickness", "gap", "gaps"):
            least, most = getattr(self, name)
            if not 0 < least <= most < np.inf:
                raise InvalidOptionError(name, (least, most), "two positive numbers, the smaller first")
        for name in ("size", "cell", "distance", "clearance"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InvalidOptionError(name, getattr(self, name), "a positive number")
        if self.cell <= self.gap[1]:
            raise InvalidOptionError("cell", self.cell, "more than the widest gap")


@dataclass(frozen=True, eq=False)
class MazeProblem:
    """A maze with a start and a goal.

    Attributes:
        walls: (w, 4) rectangles x_min, y_min, x_max, y_max [m] in the plane z = 0.
        start, goal: (2,) [m].
        size: edge of the workspace [0, size]^2 [m].
        description: a sentence for people.
    """

    walls: FloatArray
    start: FloatArray
    goal: FloatArray
    size: float = 1.0
    description: str = "maze"

    def __post_init__(self) -> None:
        object.__setattr__(self, "walls", frozen_array(self.walls, (-1, 4)))
        object.__setattr__(self, "start", frozen_array(self.start, (2,)))
        object.__setattr__(self, "goal", frozen_array(self.goal, (2,)))

    @property
    def scene(self) -> Scene:
        """The walls as boxes through z = 0, in frame "world"; the bounds reach from z = -0.05 to 0.05 m."""
        obstacles = [
            Obstacle.of(
                f"wall_{index}",
                Box(np.array([x1 - x0, y1 - y0, 2.0 * WALL_HALF_HEIGHT])),
                Pose(np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.0]), np.array([0.0, 0.0, 0.0, 1.0])),
            )
            for index, (x0, y0, x1, y1) in enumerate(self.walls.tolist())
        ]
        bounds = WorkspaceBounds(np.array([0.0, 0.0, -HALF_HEIGHT]), np.array([self.size, self.size, HALF_HEIGHT]))
        return Scene.of(obstacles, bounds)

    @property
    def problem(self) -> ScenarioProblem:
        """As a problem of a robot with the configuration (x, y)."""
        return ScenarioProblem(self.scene, self.start, (self.goal,), description=self.description)


def random_maze(rng: np.random.Generator, options: MazeOptions | None = None) -> MazeProblem:
    """A random maze, by recursive division: each wall halves a cell, and has gaps that no later wall covers.

    The goal can always be reached. Start and goal do not see each other.

    Args:
        rng: source of randomness; the same state gives the same maze.
        options: None for the defaults.

    Raises:
        InvalidOptionError: if the options leave no room for a maze.
    """
    options = options or MazeOptions()
    for _ in range(_MAZE_TRIES):
        walls = _divide(rng, options)
        if walls is None:
            continue
        pair = _start_and_goal(rng, walls, options)
        if pair is not None and is_connected(walls, *pair, options.size):
            return MazeProblem(walls, *pair, options.size)
    raise InvalidOptionError("options", options, "room for the walls, and for start and goal out of sight")


def environment(number: int) -> MazeProblem:
    """One of two fixed mazes of the unit square with a long way through narrow passages.

    Environment 1 has five parallel walls, whose gaps lie at alternating ends. Environment 2 has rooms of several doors,
    of which the short ways end blind.

    Args:
        number: 1 or 2.

    Raises:
        InvalidOptionError: if it is another number.
    """
    if number not in _ENVIRONMENTS:
        raise InvalidOptionError("environment", number, "1 or 2")
    walls, start, goal = _ENVIRONMENTS[number]
    return MazeProblem(np.array(walls), np.array(start), np.array(goal), description=f"maze, environment {number}")


def clearance(walls: FloatArray, points: FloatArray) -> FloatArray:
    """Distance [m] of points (n, 2) to the nearest of the walls (w, 4); 0 in a wall, infinite without walls."""
    outside = np.maximum(walls[:, None, :2] - points[None], points[None] - walls[:, None, 2:]).clip(min=0.0)
    return np.asarray(np.sqrt((outside**2).sum(axis=2)).min(axis=0, initial=np.inf))


def is_visible(walls: FloatArray, start: FloatArray, goal: FloatArray) -> bool:
    """Whether the straight line between two points (2,) [m] meets none of the walls (w, 4)."""
    direction = goal - start
    # Slabs: where the line enters and leaves the range of each coordinate. A zero direction is never exactly so here:
    # the smallest normal number in its place gives the right signs of infinity.
    direction = np.where(direction == 0.0, np.finfo(float).tiny, direction)
    with np.errstate(over="ignore"):
        first, second = (walls[:, :2] - start) / direction, (walls[:, 2:] - start) / direction
    enter = np.minimum(first, second).max(axis=1)
    leave = np.maximum(first, second).min(axis=1)
    return not bool(((enter <= leave) & (leave >= 0.0) & (enter <= 1.0)).any())


def is_connected(walls: FloatArray, start: FloatArray, goal: FloatArray, size: float = 1.0) -> bool:
    """Whether a point can move from start to goal (2,) in [0, size]^2 without entering a wall.

    Exact: the coordinates of all walls make a grid whose cells are free or not as a whole.
    """
    from scipy.ndimage import label

    lines = [np.unique(np.clip(np.append(walls[:, [axis, axis + 2]], [0.0, size]), 0.0, size)) for axis in (0, 1)]
    centres = [0.5 * (line[:-1] + line[1:]) for line in lines]
    x, y = centres[0][:, None, None], centres[1][None, :, None]
    solid = ((x > walls[:, 0]) & (x < walls[:, 2]) & (y > walls[:, 1]) & (y < walls[:, 3])).any(axis=2)
    labels, _ = label(~solid)

    def cell(point: FloatArray) -> int:
        index = [
            int(np.clip(np.searchsorted(line, value, side="right") - 1, 0, len(line) - 2))
            for line, value in zip(lines, point, strict=True)
        ]
        return int(labels[index[0], index[1]])

    return cell(start) == cell(goal) != 0


def _divide(rng: np.random.Generator, options: MazeOptions) -> FloatArray | None:
    """Walls (w, 4), or None if one found no place."""
    wanted = int(rng.integers(options.walls[0], options.walls[1] + 1))
    cells: list[tuple[float, float, float, float]] = [(0.0, 0.0, options.size, options.size)]
    walls: list[tuple[float, float, float, float]] = []
    # Gaps as boxes of free space that later walls must not end in.
    gaps: list[tuple[float, float, float, float]] = []
    for _ in range(wanted):
        for _ in range(_WALL_TRIES):
            if _place_wall(rng, options, cells, walls, gaps):
                break
        else:
            return None
    return np.array(walls)


def _place_wall(
    rng: np.random.Generator,
    options: MazeOptions,
    cells: list[tuple[float, float, float, float]],
    walls: list[tuple[float, float, float, float]],
    gaps: list[tuple[float, float, float, float]],
) -> bool:
    """Tries to divide a cell, chosen by its area; on success changes the lists."""
    areas = np.array([(x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in cells])
    chosen = int(rng.choice(len(cells), p=areas / areas.sum()))
    cell = cells[chosen]
    # `along` is the axis that the wall runs along, `across` the one on which it has its position.
    widths = (cell[2] - cell[0], cell[3] - cell[1])
    across = 0 if rng.random() < widths[0] ** 2 / (widths[0] ** 2 + widths[1] ** 2) else 1
    along = 1 - across
    thickness = rng.uniform(*options.thickness)
    if widths[across] < 2.0 * options.cell + thickness:
        return False
    low = rng.uniform(cell[across] + options.cell, cell[across + 2] - options.cell - thickness)
    high = low + thickness
    begin, end = cell[along], cell[along + 2]
    for gap in gaps:
        touches = gap[along] <= end + 1e-9 and gap[along + 2] >= begin - 1e-9
        if touches and gap[across] < high and gap[across + 2] > low:
            return False
    openings = _openings(rng, options, begin, end)
    if openings is None:
        return False

    def rectangle(a: float, b: float) -> tuple[float, float, float, float]:
        return (low, a, high, b) if across == 0 else (a, low, b, high)

    position = begin
    for first, last in openings:
        if first > position:
            walls.append(rectangle(position, first))
        gaps.append(rectangle(first, last))
        position = last
    if end > position:
        walls.append(rectangle(position, end))
    below, above = list(cell), list(cell)
    below[across + 2], above[across] = low, high
    cells[chosen] = (below[0], below[1], below[2], below[3])
    cells.append((above[0], above[1], above[2], above[3]))
    return True


def _openings(
    rng: np.random.Generator, options: MazeOptions, begin: float, end: float
) -> list[tuple[float, float]] | None:
    """Gaps between begin and end, in order; None if not even one fits."""
    count = int(rng.integers(options.gaps[0], options.gaps[1] + 1))
    least = options.thickness[0]  # of the wall between two gaps
    while count > 0:
        widths = rng.uniform(*options.gap, size=count)
        spare = end - begin - widths.sum() - least * (count + 1)
        # More than one gap only where the wall stays a wall.
        if spare >= 0.0 and (count == 1 or spare >= 0.5 * (end - begin)):
            # Breaking the spare length at sorted uniform points spreads the gaps evenly.
            breaks = np.sort(rng.uniform(0.0, spare, size=count))
            starts = begin + breaks + least * np.arange(1, count + 1) + np.concatenate(([0.0], np.cumsum(widths)[:-1]))
            return [(float(a), float(a + width)) for a, width in zip(starts, widths, strict=True)]
        count -= 1
    return None


def _start_and_goal(
    rng: np.random.Generator, walls: FloatArray, options: MazeOptions
) -> tuple[FloatArray, FloatArray] | None:
    points = rng.uniform(options.clearance, options.size - options.clearance, size=(2 * _PAIR_TRIES, 2))
    free: NDArray[np.bool_] = clearance(walls, points) >= options.clearance
    points = points[free]
    for start, goal in zip(points[0::2], points[1::2], strict=False):
        far = float(np.hypot(*(goal - start))) >= options.distance
        if far and not is_visible(walls, start, goal):
            return start, goal
    return None


_Fixed = tuple[Sequence[tuple[float, float, float, float]], tuple[float, float], tuple[float, float]]
_ENVIRONMENTS: dict[int, _Fixed] = {
    1: (
        [
            (0.15, 0.00, 0.18, 0.92),
            (0.15, 0.98, 0.18, 1.00),
            (0.32, 0.00, 0.35, 0.03),
            (0.32, 0.09, 0.35, 1.00),
            (0.49, 0.00, 0.52, 0.90),
            (0.49, 0.96, 0.52, 1.00),
            (0.66, 0.00, 0.69, 0.04),
            (0.66, 0.10, 0.69, 1.00),
            (0.82, 0.00, 0.85, 0.91),
            (0.82, 0.97, 0.85, 1.00),
        ],
        (0.07, 0.10),
        (0.93, 0.10),
    ),
    2: (
        [
            # Two crossing walls with doors: four rooms.
            (0.48, 0.00, 0.52, 0.12),
            (0.48, 0.18, 0.52, 0.82),
            (0.48, 0.88, 0.52, 1.00),
            (0.00, 0.48, 0.10, 0.52),
            (0.16, 0.48, 0.48, 0.52),
            (0.52, 0.48, 0.84, 0.52),
            (0.90, 0.48, 1.00, 0.52),
            # In each room a wall that hides its doors from each other.
            (0.00, 0.27, 0.36, 0.30),
            (0.42, 0.27, 0.48, 0.30),
            (0.25, 0.52, 0.28, 0.92),
            (0.25, 0.98, 0.28, 1.00),
            (0.52, 0.68, 0.60, 0.71),
            (0.66, 0.68, 1.00, 0.71),
            # The door between the lower rooms leads into a dead end, next to the goal's room.
            (0.52, 0.25, 0.72, 0.28),
            (0.72, 0.00, 0.75, 0.36),
            (0.72, 0.42, 0.75, 0.48),
        ],
        (0.08, 0.10),
        (0.60, 0.40),
    ),
}
