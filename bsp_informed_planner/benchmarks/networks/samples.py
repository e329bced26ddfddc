"""Samples in unseen mazes: how many are valid, and how much of the shortest path they cover."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.networks.maze_world import MazeWorld
from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.benchmarks.statistics import Estimate, column, mean, median
from bsp_informed_planner.errors import BspPlannerError, ModelUnavailableError
from bsp_informed_planner.sampling.cvae_sampler import cvae_sampler
from bsp_informed_planner.sampling.learned import KEYPOINT_KINDS
from bsp_informed_planner.sampling.learned_guide import (
    SAMPLER_KINDS,
    SHORTEST_PATH_ID,
    LearnedGuide,
    LearnedGuideOptions,
    ShortestPathGuide,
)
from bsp_informed_planner.sampling.models import find_model
from bsp_informed_planner.sampling.path_shapes import resampled
from bsp_informed_planner.sampling.sampler import Sampler, UniformSampler
from bsp_informed_planner.sampling.tube import tube_sampler

SAMPLES, COVERING, NEAR, POINTS = 600, 400, 0.04, 64
#: Standard deviation of tubes around the exact chain and the shortest path [m], and around the straight line.
TUBE, LINE = 0.02, 0.05

LABELS = {
    "uniform": "uniform",
    "line": "straight line + Gaussian",
    "shortest_path": "CVAE on shortest paths",
    "network_plain": "network, plain + CVAE",
    "network": "network, verified, no fallback + CVAE",
    "network_fallback": "network, verified, fallback + CVAE",
    "network_tube": "network, verified, fallback + Gaussian",
    "exact": "exact chain + CVAE",
    "exact_paper": "exact chain + CVAE as in the paper",
    "exact_tube": "exact chain + Gaussian",
    "perfect": "shortest path + Gaussian",
}


def samples_part(quick: bool, models: str | None) -> Part:
    """Samples of all samplers, none of which is mixed with uniform ones."""
    cases: list[Parameters] = [{"models": models}] * (40 if quick else 300)
    return Part("samples", "Samples in unseen mazes", cases, measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Valid share and coverage of each sampler in one maze."""
    world = MazeWorld(rng)
    path = resampled(world.shortest_path, POINTS)
    row: dict[str, object] = {}
    for name, make in _samplers(world, parameters["models"]).items():
        begin = time.perf_counter()
        try:
            sampler, reason = make()
        except ModelUnavailableError:
            continue
        except BspPlannerError:
            # A network without a chain and without fallback leaves uniform samples.
            sampler, reason = UniformSampler(world.robot.lower, world.robot.upper), "none"
        made = time.perf_counter()
        samples = sampler.sample(rng, SAMPLES)
        row[f"{name}_guide_ms"] = 1e3 * (made - begin)
        row[f"{name}_samples_ms"] = 1e3 * (time.perf_counter() - made)
        row[f"{name}_valid"] = float((world.distance.at(samples) > 0.0).mean())
        nearest = np.linalg.norm(path[:, None] - samples[None, :COVERING], axis=2).min(axis=1)
        row[f"{name}_cover"] = float((nearest < NEAR).mean())
        row[f"{name}_fallback"] = bool(reason)
    return row


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table of all samplers."""
    section.text(
        f"*Valid*: share of {SAMPLES} samples outside of walls. *Covered*: share of the shortest path within {NEAR} m "
        f"of one of the first {COVERING} samples; a sampler can be valid and useless. *Fallback*: mazes in which exact "
        "keypoints, or uniform samples, took the place of the network's. Times include all that guidance takes, of one "
        f"core; the samples' are of {SAMPLES}."
    )
    names = [name for name in LABELS if f"{name}_valid" in rows[0]]
    section.table(
        ["sampler", "valid", "covered", "fallback", "guidance [ms]", "samples [ms]"],
        [
            [
                LABELS[name],
                _mean(rows, f"{name}_valid", rng),
                _mean(rows, f"{name}_cover", rng),
                f"{float(column(rows, f'{name}_fallback').mean()):.1%}",
                median(column(rows, f"{name}_guide_ms"), rng),
                median(column(rows, f"{name}_samples_ms"), rng),
            ]
            for name in names
        ],
    )


def _samplers(world: MazeWorld, models: str | None) -> dict[str, Callable[[], tuple[Sampler, str]]]:
    robot = world.robot
    goals = world.goal[None]

    def tube(chain: np.ndarray, sigma: float) -> tuple[Sampler, str]:
        return tube_sampler([chain], sigma, robot.lower, robot.upper), ""

    def cvae(kind: str) -> tuple[Sampler, str]:
        chain = world.exact_chain
        pairs = list(zip(chain[:-1], chain[1:], strict=True))
        model = find_model(robot, (kind,), models)
        return cvae_sampler(model, world.scene, None, pairs, robot.lower, robot.upper), ""

    def learned(options: LearnedGuideOptions) -> tuple[Sampler, str]:
        guide = LearnedGuide(
            world.setting, find_model(robot, KEYPOINT_KINDS, models), find_model(robot, SAMPLER_KINDS, models), options
        )
        guidance = guide.guide(world.start, goals, world.checker)
        assert guidance.sampler is not None
        return guidance.sampler, guidance.fallback_reason

    def shortest_path() -> tuple[Sampler, str]:
        guide = ShortestPathGuide(world.setting, find_model(robot, (SHORTEST_PATH_ID,), models))
        guidance = guide.guide(world.start, goals, world.checker)
        assert guidance.sampler is not None
        return guidance.sampler, ""

    return {
        "uniform": lambda: (UniformSampler(robot.lower, robot.upper), ""),
        "line": lambda: tube(np.stack((world.start, world.goal)), LINE),
        "shortest_path": shortest_path,
        "network_plain": lambda: learned(LearnedGuideOptions(chain_count=1, fallback=False)),
        "network": lambda: learned(LearnedGuideOptions(fallback=False)),
        "network_fallback": lambda: learned(LearnedGuideOptions()),
        "network_tube": lambda: learned(LearnedGuideOptions(local_sampler="tube")),
        "exact": lambda: cvae("segment_cvae"),
        "exact_paper": lambda: cvae("cvae"),
        "exact_tube": lambda: tube(world.exact_chain, TUBE),
        "perfect": lambda: tube(world.shortest_path, TUBE),
    }


def _mean(rows: Sequence[Row], name: str, rng: np.random.Generator) -> Estimate:
    return mean(column(rows, name), rng)
