"""The informed subset: where a better path can still lie (Gammell et al., Informed RRT*, 2014)."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.sampling.sampler import Sampler
from bsp_informed_planner.scene.pose import FloatArray, frozen_array


class ProlateHyperspheroid:
    """All configurations x with |x - start| + |x - goal| <= cost.

    Args:
        start, goal: (n,) its foci.
        cost: its transverse diameter, at least |goal - start|.
    """

    def __init__(self, start: FloatArray, goal: FloatArray, cost: float) -> None:
        self.start = frozen_array(start, (-1,))
        self.goal = frozen_array(goal, (len(self.start),))
        self.cost = float(cost)
        distance = float(np.linalg.norm(self.goal - self.start))
        dimension = len(self.start)
        axes = np.full(dimension, np.sqrt(max(self.cost**2 - distance**2, 0.0)) / 2.0)
        axes[0] = self.cost / 2.0
        # A rotation that takes the first axis to the direction of the foci: Householder QR of that direction.
        direction = (self.goal - self.start) / distance if distance > 0.0 else np.eye(dimension)[0]
        basis = np.eye(dimension)
        basis[:, 0] = direction
        rotation = np.linalg.qr(basis)[0]
        self._map = frozen_array(rotation * axes)
        self._centre = frozen_array((self.start + self.goal) / 2.0)

    def contains(self, configurations: FloatArray) -> np.ndarray:
        """Which of the configurations (..., n) lie in the subset."""
        length = np.linalg.norm(configurations - self.start, axis=-1) + np.linalg.norm(
            configurations - self.goal, axis=-1
        )
        return np.asarray(length <= self.cost)

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Uniform in the subset: (count, n). Joint limits are not looked at."""
        dimension = len(self._centre)
        ball = rng.normal(size=(count, dimension))
        ball *= rng.uniform(size=(count, 1)) ** (1.0 / dimension) / np.linalg.norm(ball, axis=1, keepdims=True)
        return np.asarray(self._centre + ball @ self._map.T)


class InformedUniformSampler:
    """Uniform in the part of a box in which a path shorter than the best one can lie, for any of several goals.

    Args:
        start: (n,).
        goals: (k, n).
        cost: length of the best path.
        lower, upper: (n,) the box.
    """

    #: Rejection rounds before samples are clipped into the box instead.
    MAX_ROUNDS = 20

    def __init__(self, start: FloatArray, goals: FloatArray, cost: float, lower: FloatArray, upper: FloatArray) -> None:
        self.lower = frozen_array(lower, (-1,))
        self.upper = frozen_array(upper, (len(self.lower),))
        distances = np.linalg.norm(goals - start, axis=1)
        within = distances < cost
        nearest = goals[int(np.argmin(distances))]
        foci = goals[within] if within.any() else nearest[None]
        self._subsets = tuple(ProlateHyperspheroid(start, goal, max(cost, 1e-12)) for goal in foci)

    def contains(self, configurations: FloatArray) -> np.ndarray:
        """Which of the configurations (..., n) can lie on a better path."""
        return np.asarray(np.any([subset.contains(configurations) for subset in self._subsets], axis=0))

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        samples = self._draw(rng, count)
        for _ in range(self.MAX_ROUNDS):
            outside = ((samples < self.lower) | (samples > self.upper)).any(axis=1)
            if not outside.any():
                break
            samples[outside] = self._draw(rng, int(outside.sum()))
        return np.clip(samples, self.lower, self.upper)

    def _draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        choice = rng.integers(len(self._subsets), size=count)
        samples = np.empty((count, len(self.lower)))
        for index, subset in enumerate(self._subsets):
            chosen = choice == index
            samples[chosen] = subset.sample(rng, int(chosen.sum()))
        return samples


class InformedSampler:
    """Any sampler, restricted to the informed subset; what it draws outside is replaced by uniform samples inside.

    Args:
        sampler: what to restrict.
        subset: uniform on the informed subset.
    """

    def __init__(self, sampler: Sampler, subset: InformedUniformSampler) -> None:
        self.sampler = sampler
        self.subset = subset

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        samples = self.sampler.sample(rng, count)
        outside = ~self.subset.contains(samples)
        samples[outside] = self.subset.sample(rng, int(outside.sum()))
        return samples
