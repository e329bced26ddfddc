"""Random and fixed mazes."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.scene.maze import (
    MazeOptions,
    MazeProblem,
    clearance,
    environment,
    is_connected,
    is_visible,
    random_maze,
)
from bsp_informed_planner.scene.polytopes import cross_section, scene_polytopes

CELLS = 100


def solid_cells(maze: MazeProblem) -> np.ndarray:
    """(CELLS, CELLS) whether the centre of each cell of the unit square lies in a wall."""
    centres = (np.arange(CELLS) + 0.5) / CELLS
    x, y = np.meshgrid(centres, centres, indexing="ij")
    solid = np.zeros_like(x, dtype=bool)
    for x0, y0, x1, y1 in maze.walls:
        solid |= (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
    return solid


def flood(solid: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Number of steps from `start` to each cell, -1 where there is no way: an independent check of the generator."""
    first = (int(start[0] * CELLS), int(start[1] * CELLS))
    steps = np.full(solid.shape, -1)
    steps[first] = 0
    queue = deque([first])
    while queue:
        i, j = queue.popleft()
        for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            if 0 <= a < CELLS and 0 <= b < CELLS and not solid[a, b] and steps[a, b] < 0:
                steps[a, b] = steps[i, j] + 1
                queue.append((a, b))
    return steps


def assert_good(maze: MazeProblem, distance: float, margin: float) -> None:
    steps = flood(solid_cells(maze), maze.start)
    assert steps[int(maze.goal[0] * CELLS), int(maze.goal[1] * CELLS)] > 0
    assert np.linalg.norm(maze.goal - maze.start) >= distance
    ends = np.stack((maze.start, maze.goal))
    assert clearance(maze.walls, ends).min() >= margin
    assert ends.min() >= margin
    assert ends.max() <= 1.0 - margin
    line = maze.start + np.linspace(0.0, 1.0, 2000)[:, None] * (maze.goal - maze.start)
    assert clearance(maze.walls, line).min() == 0.0


@pytest.mark.parametrize("block", range(4))
def test_random_mazes_can_be_solved(block: int) -> None:
    for seed in range(50 * block, 50 * (block + 1)):
        maze = random_maze(np.random.default_rng(seed))
        assert_good(maze, 0.4, 0.015)
        solid = solid_cells(maze)
        np.testing.assert_array_equal(flood(solid, maze.start) >= 0, ~solid)  # no closed rooms
        thin = (maze.walls[:, 2:] - maze.walls[:, :2]).min(axis=1)
        assert thin.max() <= 0.05 + 1e-9


def test_same_seed_gives_the_same_maze() -> None:
    one, two = (random_maze(np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one.walls, two.walls)
    np.testing.assert_array_equal(one.goal, two.goal)


@pytest.mark.parametrize("number", [1, 2])
def test_environments(number: int) -> None:
    maze = environment(number)
    assert_good(maze, 0.4, 0.015)
    steps = flood(solid_cells(maze), maze.start)[int(maze.goal[0] * CELLS), int(maze.goal[1] * CELLS)]
    direct = np.abs(maze.goal - maze.start).sum()
    assert steps / CELLS > 3.0 * direct


def test_unknown_environment() -> None:
    with pytest.raises(InvalidOptionError):
        environment(3)


def test_scene_of_a_maze() -> None:
    maze = random_maze(np.random.default_rng(0))
    problem = maze.problem
    np.testing.assert_array_equal(problem.start, maze.start)
    np.testing.assert_array_equal(problem.goals[0], maze.goal)
    scene = problem.scene
    assert len(scene.obstacles) == len(maze.walls)
    for wall, (polytope,) in zip(maze.walls, scene_polytopes(scene).values(), strict=True):
        assert polytope.vertices[:, 2].min() < scene.bounds.lower[2]
        assert polytope.vertices[:, 2].max() > scene.bounds.upper[2]
        polygon = cross_section(polytope, 0.0)
        assert polygon is not None
        np.testing.assert_allclose([*polygon.min(axis=0), *polygon.max(axis=0)], wall, atol=1e-12)


def test_visibility() -> None:
    walls = np.array([[0.4, 0.0, 0.6, 0.5]])
    assert not is_visible(walls, np.array([0.1, 0.2]), np.array([0.9, 0.2]))
    assert is_visible(walls, np.array([0.1, 0.6]), np.array([0.9, 0.6]))
    assert is_visible(walls, np.array([0.1, 0.2]), np.array([0.3, 0.2]))
    assert not is_visible(walls, np.array([0.5, 0.9]), np.array([0.5, 0.4]))
    assert is_visible(walls, np.array([0.3, 0.9]), np.array([0.3, 0.1]))


def test_connectivity() -> None:
    wall = np.array([[0.4, 0.0, 0.6, 1.0]])
    assert not is_connected(wall, np.array([0.1, 0.2]), np.array([0.9, 0.2]))
    assert is_connected(wall, np.array([0.1, 0.2]), np.array([0.1, 0.9]))
    door = np.array([[0.4, 0.0, 0.6, 0.5], [0.4, 0.5001, 0.6, 1.0]])
    assert is_connected(door, np.array([0.1, 0.2]), np.array([0.9, 0.2]))
    assert not is_connected(door, np.array([0.1, 0.2]), np.array([0.5, 0.2]))


@pytest.mark.parametrize(
    "options",
    [
        {"walls": (5, 4)},
        {"walls": (0, 4)},
        {"thickness": (0.0, 0.1)},
        {"gap": (0.1, np.nan)},
        {"size": -1.0},
        {"cell": 0.01},
    ],
)
def test_bad_options_are_refused(options: dict) -> None:
    with pytest.raises(InvalidOptionError):
        MazeOptions(**options)


def test_options_without_room_are_refused() -> None:
    with pytest.raises(InvalidOptionError):
        random_maze(np.random.default_rng(0), MazeOptions(walls=(100, 100)))
    with pytest.raises(InvalidOptionError):
        random_maze(np.random.default_rng(0), MazeOptions(distance=2.0))
