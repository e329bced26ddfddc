"""Samples in unseen mazes: how many are valid, and how much of the shortest path they cover."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.maze.samplers import SAMPLERS
from bsp_informed_planner.benchmarks.maze.world import MazeWorld
from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.benchmarks.statistics import Estimate, column, mean, median
from bsp_informed_planner.errors import ModelUnavailableError
from bsp_informed_planner.sampling.path_shapes import resampled

SAMPLES, COVERING, NEAR, POINTS = 600, 400, 0.04, 64


def samples_part(quick: bool, models: str | None) -> Part:
    """Samples of all samplers, none of which is mixed with uniform ones."""
    cases: list[Parameters] = [{"models": models}] * (40 if quick else 300)
    return Part("samples", "Samples in unseen mazes", cases, measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Valid share and coverage of each sampler in one maze."""
    world = MazeWorld.random(rng)
    path = resampled(world.shortest_path, POINTS)
    row: dict[str, object] = {}
    for name, method in SAMPLERS.items():
        fresh = world.afresh()
        begin = time.perf_counter()
        try:
            sampler = method.make(fresh, 0, parameters["models"])
        except ModelUnavailableError:
            continue
        made = time.perf_counter()
        samples = sampler.sampler.sample(rng, SAMPLES)
        row[f"{name}_guide_ms"] = 1e3 * (made - begin)
        row[f"{name}_samples_ms"] = 1e3 * (time.perf_counter() - made)
        row[f"{name}_valid"] = float((world.distance.at(samples) > 0.0).mean())
        nearest = np.linalg.norm(path[:, None] - samples[None, :COVERING], axis=2).min(axis=1)
        row[f"{name}_cover"] = float((nearest < NEAR).mean())
        row[f"{name}_fallback"] = bool(sampler.fallback)
    return row


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table of all samplers."""
    section.text(
        f"*Valid*: share of {SAMPLES} samples outside of walls. *Covered*: share of the shortest path within {NEAR} m "
        f"of one of the first {COVERING} samples; a sampler can be valid and useless. *Fallback*: mazes in which exact "
        "keypoints, or uniform samples, took the place of the network's. Times include all that guidance takes, of one "
        f"core; the samples' are of {SAMPLES}."
    )
    names = [name for name in SAMPLERS if f"{name}_valid" in rows[0]]
    section.table(
        ["sampler", "valid", "covered", "fallback", "guidance [ms]", "samples [ms]"],
        [
            [
                SAMPLERS[name].title,
                _mean(rows, f"{name}_valid", rng),
                _mean(rows, f"{name}_cover", rng),
                f"{float(column(rows, f'{name}_fallback').mean()):.1%}",
                median(column(rows, f"{name}_guide_ms"), rng),
                median(column(rows, f"{name}_samples_ms"), rng),
            ]
            for name in names
        ],
    )


def _mean(rows: Sequence[Row], name: str, rng: np.random.Generator) -> Estimate:
    return mean(column(rows, name), rng)
