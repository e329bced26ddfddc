"""Guidance for arms: whole chains proposed by a network, which seed the trees of the planner."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.errors import ModelMismatchError
from bsp_informed_planner.networks.problem_view import ProblemView, ViewOptions
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.chain_repair import ChainRepair
from bsp_informed_planner.sampling.guidance import ConfigurationChain, Guidance
from bsp_informed_planner.sampling.guide import LEARNED, GuideSetting
from bsp_informed_planner.sampling.path_proposals import PathProposals
from bsp_informed_planner.sampling.path_shapes import path_of
from bsp_informed_planner.sampling.tube import TubeSampler, tube_sampler
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.signed_distance import SignedDistance

#: Chains that are handed to the planner, and the goals, the nearest ones, that they are shared out to.
CHAINS, GOALS = 8, 4


class PathChainGuide:
    """Proposes chains from the start to the nearest goals, and pushes them out of obstacles.

    None of them is checked here: the planner puts what is free of them into its trees, which takes it less time than
    the question which chain is best. They need not be free as a whole to help.

    Args:
        setting: robot and scene.
        model: of the kind "path_chains", for this robot. What one that sees no scene proposes is left as it is.
        chains: number of chains handed on, at least 1.
        repair: whether chains are pushed out of obstacles.

    Raises:
        ModelMismatchError: if the model sees problems in another way than this version does.
        InvalidObstacleError: if a shape of an obstacle has no volume.
    """

    def __init__(self, setting: GuideSetting, model: PathProposals, chains: int = CHAINS, repair: bool = True) -> None:
        self._setting = setting
        self._model = model
        self._chains = chains
        self._view = ProblemView(setting.robot, ViewOptions.from_json(model.card.encoding))
        if self._view.size != len(model.mean):
            raise ModelMismatchError(model.card.name, "length of a condition", len(model.mean), self._view.size)
        self._field = SignedDistance(setting.scene)
        self._repair = ChainRepair(setting.robot, setting.scene) if repair and self._view.options.scene else None

    def guide(
        self,
        start: FloatArray,
        goals: FloatArray,
        checker: CollisionChecker,
        should_stop: Callable[[], bool] | None = None,
    ) -> Guidance:
        """See `Guide`."""
        begin = time.monotonic()
        paths = self.proposed(start, goals)
        if self._repair is not None:
            paths = self._repair.repaired(paths, checker, should_stop)
        chains = lifted(self._setting.robot, paths)
        return Guidance(LEARNED, chains, self.sampler(list(paths)), "", time.monotonic() - begin)

    def proposed(self, start: FloatArray, goals: FloatArray) -> FloatArray:
        """(k, m, n) chains from start (n,) to the nearest of the goals (g, n), the most promising ones first."""
        robot = self._setting.robot
        nearest = goals[np.argsort(np.linalg.norm(goals - start, axis=1), kind="stable")[:GOALS]]
        starts = np.repeat(start[None], len(nearest), axis=0)
        share = -(-self._chains // len(nearest))
        shapes, _ = self._model.propose(self._view.conditions(self._field, starts, nearest), share)
        paths = path_of(shapes, starts[:, None], nearest[:, None])
        paths[..., 1:-1, :] = np.clip(paths[..., 1:-1, :], robot.lower, robot.upper)
        # The best of every goal, then the second best, ...
        return np.asarray(paths.swapaxes(0, 1).reshape(-1, *paths.shape[2:])[: max(self._chains, len(nearest))])

    def sampler(self, chains: Sequence[FloatArray]) -> TubeSampler:
        """See `Guide`: the Gaussian tube around the chains."""
        robot = self._setting.robot
        return tube_sampler(chains, self._setting.options.tube_sigma(robot), robot.lower, robot.upper)


def lifted(robot: Robot, paths: FloatArray) -> tuple[ConfigurationChain, ...]:
    """Paths (k, m, n) as chains."""
    return tuple(ConfigurationChain(path, robot.reference_points) for path in paths)
