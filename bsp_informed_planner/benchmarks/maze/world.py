"""A maze with all that chains and samples are judged by."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse.csgraph import dijkstra

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.decomposition.decomposition import Decomposition, decompose
from bsp_informed_planner.decomposition.graph import has_line_of_sight, shortest_chain
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.sampling.guide import GuideSetting
from bsp_informed_planner.scene.maze import MazeProblem, random_maze
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.scene.signed_distance import SignedDistance

FLAT = DecompositionOptions(dimension=2)
#: Walls are thinner by so much on each side where small errors are forgiven [m].
FORGIVEN = 0.01
#: Corners of walls are passed at this distance by the shortest path [m].
_CORNER = 1e-4


@dataclass(frozen=True, eq=False)
class ChainVerdict:
    """What a chain of keypoints is worth.

    Attributes:
        reached: it ends at the goal.
        valid: none of its keypoints is in a wall.
        connected: all its segments are free.
        nearly: all its segments are free of walls that are 1 cm thinner on each side.
        length: [m].
        keypoints: start and goal included.
    """

    reached: bool
    valid: bool
    connected: bool
    nearly: bool
    length: float
    keypoints: int

    @property
    def usable(self) -> bool:
        """Ends at the goal, without a keypoint in a wall, connectable but for 1 cm."""
        return self.reached and self.valid and self.nearly

    @property
    def free(self) -> bool:
        """Ends at the goal and is free outright."""
        return self.reached and self.connected


class MazeWorld:
    """A maze and its problem. What is derived from them is made when first asked for.

    Args:
        maze: the maze.
        checker: of its scene; None: one of its own.
    """

    robot = PointRobot()

    def __init__(self, maze: MazeProblem, checker: BoundedChecker | None = None) -> None:
        self.maze = maze
        self.scene = maze.scene
        self.start, self.goal = maze.start, maze.goal
        self.checker = checker or BoundedChecker(self.robot, self.scene)

    @staticmethod
    def random(rng: np.random.Generator) -> MazeWorld:
        """A random maze."""
        return MazeWorld(random_maze(rng))

    def afresh(self) -> MazeWorld:
        """The same maze with nothing derived from it but the checker: to time what guidance takes."""
        return MazeWorld(self.maze, self.checker)

    @cached_property
    def decomposition(self) -> Decomposition:
        return decompose(self.scene, FLAT)

    def setting(self, seed: int = 0, models: str | None = None) -> GuideSetting:
        """For guides.

        Args:
            seed: of guides that draw chains.
            models: folder of models; None: those that come with the package.
        """
        return GuideSetting(self.robot, self.scene, lambda: self.decomposition, models=models, seed=seed)

    @cached_property
    def distance(self) -> SignedDistance:
        return SignedDistance(self.scene, 0.0)

    @cached_property
    def exact_chain(self) -> FloatArray:
        """(m, 2) the chain of the decomposition [m]."""
        return np.asarray(shortest_chain(self.decomposition, self.start, self.goal).points[:, :2])

    @cached_property
    def _thinner(self) -> Decomposition:
        return decompose(_thinner_walls(self.maze), FLAT)

    def judge(self, chain: FloatArray, reached: bool) -> ChainVerdict:
        """Judges a chain (m, 2) [m]."""
        points = np.column_stack((chain, np.zeros(len(chain))))
        pairs = list(zip(points[:-1], points[1:], strict=True))
        return ChainVerdict(
            reached,
            bool((self.distance.at(chain[1:-1]) >= 0.0).all()),
            all(has_line_of_sight(self.decomposition, a, b) for a, b in pairs),
            all(has_line_of_sight(self._thinner, a, b) for a, b in pairs),
            float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum()),
            len(chain),
        )

    @cached_property
    def shortest_path(self) -> FloatArray:
        """(m, 2) the shortest path, by the visibility graph of the walls' corners [m]."""
        walls = self.maze.walls
        lower, upper = walls[:, :2] - _CORNER, walls[:, 2:] + _CORNER
        corners = np.concatenate([np.stack((x[:, 0], y[:, 1]), axis=1) for x in (lower, upper) for y in (lower, upper)])
        inside = ((corners > 0.0) & (corners < self.maze.size)).all(axis=1)
        nodes = np.concatenate(([self.start, self.goal], corners[inside & (_clear(corners, walls))]))
        first, second = np.triu_indices(len(nodes), 1)
        sees = visible(nodes[first], nodes[second], walls)
        lengths = np.linalg.norm(nodes[first] - nodes[second], axis=1)
        graph = np.zeros((len(nodes), len(nodes)))
        graph[first[sees], second[sees]] = lengths[sees]
        _, before = dijkstra(graph, directed=False, indices=0, return_predecessors=True)
        chain = [1]
        while chain[-1] != 0:
            chain.append(int(before[chain[-1]]))
        return np.asarray(nodes[chain[::-1]])


def visible(starts: FloatArray, ends: FloatArray, walls: FloatArray) -> np.ndarray:
    """(k,) which segments between points (k, 2) meet the inside of none of the walls (w, 4)."""
    direction = ends - starts
    direction = np.where(np.abs(direction) < 1e-12, 1e-12, direction)
    first = (walls[None, :, :2] - starts[:, None]) / direction[:, None]
    second = (walls[None, :, 2:] - starts[:, None]) / direction[:, None]
    enter = np.minimum(first, second).max(axis=2).clip(min=0.0)
    leave = np.maximum(first, second).min(axis=2).clip(max=1.0)
    return np.asarray(~(enter < leave).any(axis=1))


def _clear(points: FloatArray, walls: FloatArray) -> np.ndarray:
    """(k,) which points (k, 2) lie in none of the walls."""
    inside = (points[:, None] > walls[None, :, :2]) & (points[:, None] < walls[None, :, 2:])
    return ~np.any(np.all(inside, axis=2), axis=1)


def _thinner_walls(maze: MazeProblem) -> Scene:
    walls = maze.walls + np.array([FORGIVEN, FORGIVEN, -FORGIVEN, -FORGIVEN])
    walls = walls[(walls[:, 2:] - walls[:, :2] > 1e-6).all(axis=1)]
    return MazeProblem(walls, maze.start, maze.goal, maze.size).scene
