"""Algorithm 2 of the paper: from a problem to keypoints, paths of its subproblems, and a path of the whole."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from bsp_informed_planner.decomposition.decomposition import Decomposition, decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.experience.chain_merging import MergedChain, merge_chain
from bsp_informed_planner.experience.chain_search import ChainResult, ChainSearch, SolvedChain
from bsp_informed_planner.experience.options import CollectionOptions, default_options
from bsp_informed_planner.experience.problems import GeneratedProblem
from bsp_informed_planner.experience.record import Failure, ProblemRecord
from bsp_informed_planner.experience.seeds import Stage, generator, split_of
from bsp_informed_planner.experience.solving import ProblemSolver
from bsp_informed_planner.experience.tool_path import ToolPath, portal_crossings, reference_points
from bsp_informed_planner.planning.path import path_length
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.json_io import scene_to_json
from bsp_informed_planner.scene.pose import FloatArray


@dataclass(frozen=True, eq=False)
class _Attempt:
    """What came of the search for keypoints at one padding; `goals` (g, n) are those that are free at it."""

    solver: ProblemSolver
    result: ChainResult
    goals: FloatArray


class Collector:
    """Solves problems of one robot as Algorithm 2 does, for keypoints and for baselines alike.

    Args:
        robot: the robot.
        options: what may be spent; None: what suits the robot.
        decomposition_options: None: the defaults for this robot.
    """

    def __init__(
        self,
        robot: Robot,
        options: CollectionOptions | None = None,
        decomposition_options: DecompositionOptions | None = None,
    ) -> None:
        self.robot = robot
        self.options = options or default_options(robot)
        self.decomposition_options = decomposition_options or DecompositionOptions(dimension=robot.workspace_dimension)

    def collect(self, seed: int, problem: GeneratedProblem) -> ProblemRecord:
        """A problem and its solution, or the reason why there is none.

        Args:
            seed: of the problem; all random numbers follow from it.
            problem: scene, start and goals.

        Raises:
            SceneError: if the scene cannot be decomposed or checked.
        """
        begin = time.perf_counter()
        if not self.options.keypoints:
            return replace(self._without_keypoints(seed, problem), seconds=time.perf_counter() - begin)
        decomposition = decompose(problem.scene, self.decomposition_options)
        paddings = self.options.paddings
        # What cannot be solved close to obstacles cannot be solved away from them: hence the last padding first.
        attempt = self._attempt(seed, problem, decomposition, paddings[-1], self.options.max_samples)
        if attempt is not None and attempt.result.chain is not None:
            for padding in paddings[:-1]:
                further = self._attempt(seed, problem, decomposition, padding, self.options.max_padded_samples)
                if further is not None and further.result.chain is not None:
                    attempt = further
                    break
        record = self._record(seed, problem, decomposition, attempt)
        return replace(record, seconds=time.perf_counter() - begin)

    def _without_keypoints(self, seed: int, problem: GeneratedProblem) -> ProblemRecord:
        """The path of the whole problem as its only subproblem, as far from obstacles as one was found."""
        best: tuple[ProblemSolver, FloatArray] | None = None
        record = self._unsolved(seed, problem)
        for padding in reversed(self.options.paddings):
            solver = ProblemSolver(self.robot, problem.scene, padding, self.options)
            goals = [goal for goal in problem.goals if solver.checker.is_free(goal)]
            if not goals or not solver.checker.is_free(problem.start):
                break
            record = replace(record, failure=Failure.SUBPROBLEM_SAMPLES.value)
            goal = min(goals, key=lambda goal: float(np.linalg.norm(goal - problem.start)))
            samples = self.options.whole_samples if best is None else self.options.max_padded_samples
            rng = generator(seed, Stage.SUBPROBLEMS, self.options.paddings.index(padding))
            path = solver.connected(problem.start, goal, rng, samples)
            if path is None:
                # What cannot be solved close to obstacles cannot be solved away from them.
                break
            best = solver, path
        if best is None:
            return record
        solver, path = best
        rng = generator(seed, Stage.WHOLE, self.options.paddings.index(solver.padding))
        found = solver.solve_whole(problem.start, path[-1], rng, path)
        assert found is not None
        keypoints = found[[0, -1]]
        points = self.robot.reference_points(keypoints)
        return replace(
            record,
            goal=found[-1],
            solved=True,
            failure="",
            padding=solver.padding,
            path=found,
            path_cost=path_length(found),
            keypoints=keypoints,
            keypoints_workspace=points,
            merged=np.zeros(2, np.bool_),
            subpaths=(found,),
            chain_workspace=points,
        )

    def _unsolved(self, seed: int, problem: GeneratedProblem) -> ProblemRecord:
        """The record of a problem whose start or goal is not free."""
        empty = np.zeros((0, self.robot.dof))
        return ProblemRecord(
            seed=seed,
            split=split_of(seed),
            family=problem.family,
            stratum=problem.stratum,
            scene_json=scene_to_json(problem.scene),
            start=problem.start,
            goal=problem.goals[0],
            solved=False,
            failure=Failure.COLLIDING_END.value,
            path=empty,
            keypoints=empty,
            crossings=empty,
        )

    def _attempt(
        self,
        seed: int,
        problem: GeneratedProblem,
        decomposition: Decomposition,
        padding: float,
        max_samples: int,
    ) -> _Attempt | None:
        """The search for keypoints at one padding; None if start or goals are not free at it."""
        solver = ProblemSolver(self.robot, problem.scene, padding, self.options)
        if not solver.checker.is_free(problem.start):
            return None
        goals = np.array([goal for goal in problem.goals if solver.checker.is_free(goal)])
        if not len(goals):
            return None
        part = (seed, self.options.paddings.index(padding))
        search = ChainSearch(self.robot, decomposition, solver, self.options, part, max_samples)
        return _Attempt(solver, search.run(problem.start, goals), goals)

    def _record(
        self, seed: int, problem: GeneratedProblem, decomposition: Decomposition, attempt: _Attempt | None
    ) -> ProblemRecord:
        record = self._unsolved(seed, problem)
        if attempt is None:
            return record
        chain, solver = attempt.result.chain, attempt.solver
        known = None if chain is None else chain.path
        goal = attempt.goals[0] if known is None else known[-1]
        rng = generator(seed, Stage.WHOLE, self.options.paddings.index(solver.padding))
        path = solver.solve_whole(problem.start, goal, rng, known)
        record = replace(
            record,
            goal=goal,
            solved=chain is not None,
            failure="" if attempt.result.failure is None else attempt.result.failure.value,
            padding=solver.padding,
            removals=attempt.result.removals,
        )
        if path is not None:
            tool = ToolPath.of(self.robot, decomposition, path, self.options.path_step)
            crossings, points = portal_crossings(decomposition, tool)
            record = replace(
                record, path=path, path_cost=path_length(path), crossings=crossings, crossings_workspace=points
            )
        if chain is not None:
            merged = self._merged(seed, decomposition, chain, solver)
            record = replace(
                record,
                keypoints=merged.keypoints,
                keypoints_workspace=reference_points(self.robot, decomposition, merged.keypoints),
                merged=merged.merged,
                subpaths=merged.subpaths,
                chain_workspace=chain.points,
            )
        return record

    def _merged(
        self, seed: int, decomposition: Decomposition, chain: SolvedChain, solver: ProblemSolver
    ) -> MergedChain:
        """Lines 17 to 22, and then RRT* on every subproblem that is left."""
        merged = merge_chain(
            chain.subpaths,
            lambda state: reference_points(self.robot, decomposition, state[None])[0],
            self.options.epsilon,
            solver.is_edge_free,
            self.options.keep_sight,
        )
        subpaths = []
        for index, path in enumerate(merged.subpaths):
            rng = generator(seed, Stage.REFINEMENT, index)
            subpaths.append(solver.refine(path, rng, self.options.refine_samples))
        return replace(merged, subpaths=tuple(subpaths))
