"""Runs of RRT* on samples of several samplers, as in the paper; and their rows as arrays."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Row
from bsp_informed_planner.benchmarks.maze.samplers import Made, MazeSampler
from bsp_informed_planner.benchmarks.maze.world import MazeWorld
from bsp_informed_planner.errors import ModelUnavailableError
from bsp_informed_planner.planning.rrt_star import GOAL_BIAS, plan_rrt_star
from bsp_informed_planner.sampling.sampler import UniformSampler
from bsp_informed_planner.scene.pose import FloatArray

#: Samples of a pool whose valid share is noted.
POOL = 500


@dataclass(frozen=True)
class Protocol:
    """How runs are made.

    Attributes:
        runs: of each method in a maze, each with another seed.
        samples: of each run, those of both kinds.
        grid: after how many samples costs and times are noted, ascending.
        uniform_fraction: lambda, the chance of a uniform sample.
        max_step: longest edge, eta [m].
        goal_bias: chance of trying to reach the goal instead of a sample.
    """

    runs: int
    samples: int
    grid: tuple[int, ...]
    uniform_fraction: float = 0.5
    max_step: float = 0.05
    goal_bias: float = GOAL_BIAS


def run_methods(
    world: MazeWorld,
    methods: Mapping[str, MazeSampler],
    protocol: Protocol,
    models: str | None,
    rng: np.random.Generator,
) -> Row:
    """All methods in one maze, in an order that changes from run to run; those without their model are left out.

    What does not hang on a seed is made, and timed, once.

    Returns:
        for each method M the columns of `Runs`, as lists with one entry for each run.
    """
    row: dict[str, list[Any]] = {}
    made: dict[str, _TimedSampler] = {}
    for _ in range(protocol.runs):
        for index in rng.permutation(len(methods)).tolist():
            name = list(methods)[index]
            method = methods[name]
            seed = int(rng.integers(2**32))
            try:
                if method.seeded or name not in made:
                    made[name] = _timed(method, world.afresh(), seed, models)
            except ModelUnavailableError:
                continue
            for key, value in _run(world, made[name], protocol, rng).items():
                row.setdefault(f"{name}_{key}", []).append(value)
    return row


@dataclass(frozen=True)
class _TimedSampler:
    made: Made
    seconds: float


def _timed(method: MazeSampler, world: MazeWorld, seed: int, models: str | None) -> _TimedSampler:
    begin = time.perf_counter()
    made = method.make(world, seed, models)
    return _TimedSampler(made, time.perf_counter() - begin)


def _run(world: MazeWorld, timed: _TimedSampler, protocol: Protocol, rng: np.random.Generator) -> dict[str, Any]:
    robot, sampler = world.robot, timed.made.sampler
    result = plan_rrt_star(
        world.checker.verdicts,
        world.start,
        world.goal,
        protocol.samples,
        lower=robot.lower,
        upper=robot.upper,
        max_step=protocol.max_step,
        rng=rng,
        # The planner draws uniform samples itself, which is faster.
        sampler=None if isinstance(sampler, UniformSampler) else sampler,
        uniform_fraction=protocol.uniform_fraction,
        goal_bias=protocol.goal_bias,
        milestones=protocol.grid,
    )
    solved = np.flatnonzero(np.isfinite(result.costs))
    pool = sampler.sample(rng, POOL)
    return {
        "first": int(solved[0]) + 1 if len(solved) else None,
        "first_ms": round(1e3 * result.first_seconds, 3) if len(solved) else None,
        "costs": [_rounded(result.costs[count - 1]) for count in protocol.grid],
        "ms": [round(1e3 * seconds, 3) for seconds in result.milestone_seconds.tolist()],
        "guidance_ms": round(1e3 * timed.seconds, 3),
        "fallback": bool(timed.made.fallback),
        "valid": float((world.distance.at(pool) > 0.0).mean()),
    }


def _rounded(cost: float) -> float | None:
    return round(float(cost), 4) if np.isfinite(cost) else None


@dataclass(frozen=True, eq=False)
class Runs:
    """All runs of one method: m cases with r runs each, costs and times at g numbers of samples.

    Attributes:
        first: (m, r) samples to the first path, infinite without one.
        first_ms: (m, r) time to it, without what was done before the first sample; infinite without one.
        costs: (m, r, g) of the best path, infinite without one.
        ms: (m, r, g) time, without what was done before the first sample.
        guidance_ms: (m, r) time before the first sample: decomposition, networks, checks of chains.
        fallback: (m, r) whether something else took the place of what was asked for.
        valid: (m, r) share of samples outside of walls, uniform ones left out.
    """

    first: FloatArray
    first_ms: FloatArray
    costs: FloatArray
    ms: FloatArray
    guidance_ms: FloatArray
    fallback: FloatArray
    valid: FloatArray

    @staticmethod
    def of(rows: Sequence[Row], name: str) -> Runs:
        """Of rows with the same number of runs."""

        def array(key: str) -> FloatArray:
            # None, which is no result, becomes not-a-number.
            return np.array([row[f"{name}_{key}"] for row in rows], dtype=np.float64)

        def with_failures(key: str) -> FloatArray:
            return np.asarray(np.nan_to_num(array(key), nan=np.inf, posinf=np.inf))

        return Runs(
            with_failures("first"),
            with_failures("first_ms"),
            with_failures("costs"),
            array("ms"),
            array("guidance_ms"),
            array("fallback"),
            array("valid"),
        )

    @property
    def first_ms_with_guidance(self) -> FloatArray:
        """(m, r) time to the first path, infinite without one."""
        return self.first_ms + self.guidance_ms

    def single(self) -> Runs:
        """The same with one run a case: for runs that are independent of each other, in one maze."""
        return Runs(
            **{
                name: values.reshape(-1, 1, *values.shape[2:])
                for name, values in ((name, getattr(self, name)) for name in self.__dataclass_fields__)
            }
        )


def present(rows: Sequence[Row], methods: Mapping[str, MazeSampler]) -> list[str]:
    """Names of the methods that the rows have."""
    return [name for name in methods if f"{name}_first" in rows[0]]
