"""Inverse kinematics of any serial chain, by damped least squares from many seeds."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.robots.kinematic_chain import KinematicChain
from bsp_informed_planner.scene.pose import FloatArray

_ITERATIONS, _PATIENCE = 40, 8
_DISTINCT = 1e-3
# A redundant arm has infinitely many solutions; those that differ by less than this in every joint count as one [rad].
_DISTINCT_REDUNDANT = 0.1


class NumericalInverseKinematics:
    """Damped least squares within the joint limits, from random seeds.

    An arm of six joints or fewer has finitely many branches, at most 16: all that the seeds lead to are returned. For
    a redundant arm the search ends when it has found `max_solutions` distinct configurations. An arm of fewer than six
    joints reaches few poses exactly.
    """

    def __init__(self, chain: KinematicChain, seeds: int = 64, max_solutions: int = 16) -> None:
        """
        Args:
            chain: joints and frame.
            seeds: how many random configurations are tried.
            max_solutions: at most so many solutions are returned.
        """
        self.chain = chain
        self.method = f"numerical (damped least squares from {seeds} random seeds)"
        self._max_solutions = max_solutions
        self._distinct = _DISTINCT_REDUNDANT if chain.dof > 6 else _DISTINCT
        low, high = np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi)
        within_turn = ~chain.prismatic & (low < high)
        self._low = np.where(within_turn, low, chain.lower)
        self._high = np.where(within_turn, high, chain.upper)
        self._shape = (seeds, chain.dof)
        self._seeds = self._random_seeds(np.random.default_rng(0))
        self._origin = chain.offsets[0]
        self._reach = chain.reach

    def solve(self, target: FloatArray, rng: np.random.Generator | None = None) -> FloatArray:
        """See `InverseKinematics`.

        Args:
            target: (4, 4) pose of the frame in the root frame.
            rng: where the seeds come from; the same seeds every time by default.
        """
        if self.chain.dof == 0 or float(np.linalg.norm(target[:3, 3] - self._origin)) > self._reach + 1e-9:
            return np.empty((0, self.chain.dof))
        seeds = self._seeds if rng is None else self._random_seeds(rng)
        return self.chain.solve(
            target, seeds, _ITERATIONS, _PATIENCE, self._distinct, self._max_solutions, inside=True
        )[0]

    def solve_batch(self, targets: FloatArray, rng: np.random.Generator | None = None) -> list[FloatArray]:
        """See `InverseKinematics`."""
        return [self.solve(target, rng) for target in targets]

    def _random_seeds(self, rng: np.random.Generator) -> FloatArray:
        return rng.uniform(self._low, self._high, self._shape)
