"""Chains and samples before any planning: how much of them is free, and how much of a good path they cover."""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.sampling.guidance import Guidance
from bsp_informed_planner.sampling.path_shapes import resampled
from bsp_informed_planner.scene.pose import FloatArray

#: Samples that are judged, and those that a plan draws first.
SAMPLES, FIRST = 256, 64
#: Points of a good path, and how near a free sample must be to one [rad].
POINTS, NEAR = 24, 0.5


def judged(
    guidance: Guidance, best: FloatArray, checker: BoundedChecker, rng: np.random.Generator
) -> Mapping[str, float | bool | None]:
    """Columns of one guidance.

    `any_free`: whether a chain is free as a whole; `free`, `edges`: share of chains and of their edges that are;
    `valid`: share of free samples; `cover`: share of points of a good path that are near to a free sample;
    `samples_ms`: time for the first samples.
    """
    row: dict[str, float | bool | None] = {"guide_ms": 1e3 * guidance.seconds}
    verdicts = [checker.surely_free_edges(chain.configurations) for chain in guidance.chains]
    row["any_free"] = any(bool(edges.all()) for edges in verdicts)
    row["free"] = float(np.mean([edges.all() for edges in verdicts])) if verdicts else None
    row["edges"] = float(np.mean(np.concatenate(verdicts))) if verdicts else None
    if guidance.sampler is not None:
        begin = time.perf_counter()
        guidance.sampler.sample(rng, FIRST)
        row["samples_ms"] = 1e3 * (time.perf_counter() - begin)
        samples = guidance.sampler.sample(rng, SAMPLES)
        free = samples[checker.surely_free(samples)]
        row["valid"] = len(free) / SAMPLES
        points = resampled(best, POINTS)
        gaps = np.linalg.norm(points[:, None] - free[None], axis=2).min(axis=1, initial=np.inf)
        row["cover"] = float((gaps < NEAR).mean())
    return row
