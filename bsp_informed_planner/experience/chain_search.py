"""Algorithm 2, lines 4 to 16: chains of keypoints, examined until one is feasible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.decomposition.graph import KeypointChain, shortest_chain
from bsp_informed_planner.errors import KeypointsUnavailableError
from bsp_informed_planner.experience.options import CollectionOptions
from bsp_informed_planner.experience.record import Failure
from bsp_informed_planner.experience.seeds import Stage, generator
from bsp_informed_planner.experience.solving import ProblemSolver
from bsp_informed_planner.experience.tool_path import ToolPath, reentry
from bsp_informed_planner.planning.path import path_length
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.keypoint_guide import ExactKeypointGuide
from bsp_informed_planner.sampling.layers import paths_through_layers
from bsp_informed_planner.scene.pose import FloatArray


@dataclass(frozen=True, eq=False)
class SolvedChain:
    """A chain all of whose subproblems are solved, before merging.

    Attributes:
        points: (c, 3) keypoints with start and goal [m].
        subpaths: c - 1 free paths (m_i, n).
    """

    points: FloatArray
    subpaths: tuple[FloatArray, ...]

    @property
    def path(self) -> FloatArray:
        """(m, n) all subpaths in one."""
        return np.concatenate((self.subpaths[0], *(path[1:] for path in self.subpaths[1:])))


@dataclass(frozen=True, eq=False)
class ChainResult:
    """What a search came to.

    Attributes:
        chain: None if there is none.
        failure: why there is none.
        removals: how often RemoveEdge was called.
    """

    chain: SolvedChain | None
    failure: Failure | None
    removals: int


class ChainSearch:
    """Searches the connectivity graph of one problem, and removes from it what turns out not to be feasible.

    Args:
        robot, decomposition: as usual.
        solver: plans and checks.
        options: what may be spent.
        seed: of the problem, and a number that tells its searches apart.
        max_samples: that all subproblems may take.
    """

    def __init__(
        self,
        robot: Robot,
        decomposition: Decomposition,
        solver: ProblemSolver,
        options: CollectionOptions,
        seed: tuple[int, int],
        max_samples: int,
    ) -> None:
        self._robot = robot
        self._decomposition = decomposition
        self._solver = solver
        self._options = options
        self._seed = seed
        self._guide = ExactKeypointGuide(robot, decomposition, options.guide)
        self._layers: dict[int, FloatArray] = {}
        self._solved: dict[tuple[bytes, bytes], FloatArray | None] = {}
        self._samples_left = max_samples

    def run(self, start: FloatArray, goals: FloatArray) -> ChainResult:
        """Find a chain from the start (n,) to one of several goals (g, n) that share a reference point."""
        start_pose, goal_pose = self._robot.forward_kinematics(start), self._robot.forward_kinematics(goals[0])
        quaternions = (start_pose.quaternion, goal_pose.quaternion)
        nearest = goals[int(np.argmin(np.linalg.norm(goals - start, axis=1)))]
        removed_edges: set[tuple[int, int]] = set()
        removed_candidates: set[int] = set()
        rejected = False
        for removals in range(self._options.max_removals + 1):
            try:
                chain = shortest_chain(
                    self._decomposition,
                    self._in_plane(start_pose.position),
                    self._in_plane(goal_pose.position),
                    removed_candidates=sorted(removed_candidates),
                    removed_edges=sorted(removed_edges),
                    clearance_weight=self._options.guide.clearance_weight,
                )
            except KeypointsUnavailableError:
                return ChainResult(None, Failure.REENTERS if rejected else Failure.NO_CHAIN, removals)
            blocked = self._first_without_layer(chain, start, nearest, quaternions)
            if blocked is not None:
                removed_candidates.add(blocked)
                continue
            subpaths, segment, reentered = self._best_lift(chain, start, goals)
            if subpaths is not None:
                return ChainResult(SolvedChain(chain.points, subpaths), None, removals)
            if self._samples_left <= 0:
                return ChainResult(None, Failure.SUBPROBLEM_SAMPLES, removals)
            rejected = rejected or reentered
            removed_edges.add(chain.edge(segment))
        return ChainResult(None, Failure.TOO_MANY_REMOVALS, self._options.max_removals)

    def _in_plane(self, point: FloatArray) -> FloatArray:
        return point[:2] if self._decomposition.dimension == 2 else point

    def _first_without_layer(
        self, chain: KeypointChain, start: FloatArray, goal: FloatArray, quaternions: tuple[FloatArray, FloatArray]
    ) -> int | None:
        """The first candidate of a chain that no free configuration reaches; the others get their layers."""
        for position, index in enumerate(chain.candidate_indices, start=1):
            candidate = int(index)
            if candidate not in self._layers:
                self._layers[candidate] = self._guide.layer(
                    chain, position, candidate, start, goal, quaternions, self._solver.checker
                )
            if not len(self._layers[candidate]):
                return candidate
        return None

    def _best_lift(
        self, chain: KeypointChain, start: FloatArray, goals: FloatArray
    ) -> tuple[tuple[FloatArray, ...] | None, int, bool]:
        """The shortest admissible path through the configurations of a chain.

        Several choices of branches are tried, each consistent along the whole chain. Paths that enter a cell again are
        rejected; of the rest the shortest is kept (ExaminePath).

        Returns:
            the subpaths, or None; the segment that the first choice failed at; whether a path was rejected.
        """
        layers = [self._layers[int(candidate)] for candidate in chain.candidate_indices]
        lifts = paths_through_layers(
            self._robot, start, layers, goals, self._solver.is_edge_free, self._options.guide, _never
        )
        best: tuple[FloatArray, ...] | None = None
        failed_at: int | None = None
        rejected = False
        for lift in lifts:
            if best is not None and lift.length >= _length(best):
                # Straight edges are the least that the subpaths can have.
                continue
            subpaths: list[FloatArray] = []
            for a, b in zip(lift.configurations[:-1], lift.configurations[1:], strict=True):
                path = self._subpath(a, b)
                if path is None:
                    break
                subpaths.append(path)
            if len(subpaths) < len(lift.configurations) - 1:
                failed_at = len(subpaths) if failed_at is None else failed_at
                continue
            segment = self._reentered_segment(subpaths)
            if segment is not None:
                rejected = True
                failed_at = segment if failed_at is None else failed_at
            elif best is None or _length(subpaths) < _length(best):
                best = tuple(subpaths)
        return best, 0 if failed_at is None else failed_at, rejected

    def _subpath(self, start: FloatArray, goal: FloatArray) -> FloatArray | None:
        key = (start.tobytes(), goal.tobytes())
        if key not in self._solved:
            samples = min(self._options.connect_samples, self._samples_left)
            rng = generator(self._seed[0], Stage.SUBPROBLEMS, self._seed[1], len(self._solved))
            self._solved[key], spent = self._solver.solve_subproblem(start, goal, rng, samples)
            self._samples_left -= spent
        return self._solved[key]

    def _reentered_segment(self, subpaths: list[FloatArray]) -> int | None:
        """The segment in which the path comes back to a cell that it has left."""
        options = self._options
        tools = [ToolPath.of(self._robot, self._decomposition, path, options.path_step) for path in subpaths]
        return reentry(self._decomposition, tools, options.revisit_tolerance, options.allow_detours)


def _length(paths: tuple[FloatArray, ...] | list[FloatArray]) -> float:
    return sum(path_length(path) for path in paths)


def _never() -> bool:
    return False
