"""The samplers that are compared in mazes: the paper's, ours, controls and bounds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from bsp_informed_planner.benchmarks.maze.world import MazeWorld
from bsp_informed_planner.errors import KeypointsUnavailableError
from bsp_informed_planner.networks.registry import Model
from bsp_informed_planner.sampling.cvae_sampler import cvae_sampler
from bsp_informed_planner.sampling.gmm import SAMPLER_ID as GMM_ID
from bsp_informed_planner.sampling.gmm import GmmGuide, PrimitiveDatabase
from bsp_informed_planner.sampling.guide import Guide
from bsp_informed_planner.sampling.learned_guide import (
    SAMPLER_KINDS,
    SHORTEST_PATH_ID,
    LearnedGuide,
    LearnedGuideOptions,
    ShortestPathGuide,
)
from bsp_informed_planner.sampling.models import KEYPOINT_KINDS, find_card, find_model
from bsp_informed_planner.sampling.sampler import Sampler, UniformSampler
from bsp_informed_planner.sampling.tube import tube_sampler
from bsp_informed_planner.scene.pose import FloatArray

#: Standard deviation of tubes around the exact chain and the shortest path [m], and around the straight line.
TUBE, LINE = 0.02, 0.05


@dataclass(frozen=True)
class Made:
    """A sampler that was made for a maze.

    Attributes:
        sampler: without uniform samples.
        fallback: what took the place of what was asked for, and why; empty if nothing did.
    """

    sampler: Sampler
    fallback: str = ""


#: World, seed, folder of models (None: those of the package).
Make = Callable[[MazeWorld, int, "str | None"], Made]


@dataclass(frozen=True)
class MazeSampler:
    """A sampler under test.

    Attributes:
        title: for people.
        make: everything that has to be done for a new maze; raises ModelUnavailableError where a model is missing.
        oracle: it knows the shortest path: a bound, whose time means nothing.
        seeded: what it makes hangs on the seed.
    """

    title: str
    make: Make
    oracle: bool = False
    seeded: bool = False


def _uniform(world: MazeWorld, seed: int, models: str | None) -> Made:
    return Made(UniformSampler(world.robot.lower, world.robot.upper))


def _tube(chain_of: Callable[[MazeWorld], FloatArray], sigma: float, world: MazeWorld, *_: object) -> Made:
    return Made(tube_sampler([chain_of(world)], sigma, world.robot.lower, world.robot.upper))


def _exact_cvae(kind: str, world: MazeWorld, seed: int, models: str | None) -> Made:
    model = _model((kind,), models)
    chain = world.exact_chain
    pairs = list(zip(chain[:-1], chain[1:], strict=True))
    return Made(cvae_sampler(model, world.scene, None, pairs, world.robot.lower, world.robot.upper))


def _guided(guide: Guide, world: MazeWorld) -> Made:
    try:
        guidance = guide.guide(world.start, world.goal[None], world.checker)
    except KeypointsUnavailableError as error:
        return Made(UniformSampler(world.robot.lower, world.robot.upper), f"uniform samples: {error.reason}")
    assert guidance.sampler is not None
    return Made(guidance.sampler, guidance.fallback_reason)


def _learned(options: LearnedGuideOptions, world: MazeWorld, seed: int, models: str | None) -> Made:
    return learned(_model(KEYPOINT_KINDS, models), _model(SAMPLER_KINDS, models), options, world, seed, models)


def learned(
    keypoints: Model, samplers: Model, options: LearnedGuideOptions, world: MazeWorld, seed: int, models: str | None
) -> Made:
    """Samples between keypoints of a network (Algorithm 3)."""
    return _guided(LearnedGuide(world.setting(seed, models), keypoints, samplers, options), world)


def _shortest_path(world: MazeWorld, seed: int, models: str | None) -> Made:
    return _guided(ShortestPathGuide(world.setting(seed, models), _model((SHORTEST_PATH_ID,), models)), world)


def _gmm(world: MazeWorld, seed: int, models: str | None) -> Made:
    return _guided(GmmGuide(world.setting(seed, models), _database(models)), world)


# Files are read once in a process: whoever plans does so, too.
@lru_cache
def _model(kinds: tuple[str, ...], models: str | None) -> Model:
    return find_model(MazeWorld.robot, kinds, models)


@lru_cache
def _database(models: str | None) -> PrimitiveDatabase:
    path: Path = find_card(MazeWorld.robot, (GMM_ID,), models)[0]
    return PrimitiveDatabase.load(path)


def _straight_line(world: MazeWorld) -> FloatArray:
    return np.stack((world.start, world.goal))


#: By a short name, for columns. The names of the networks' variants: `plain` takes the likeliest chain as it is; the
#: others verify sixteen, and take the shortest free one.
SAMPLERS: Mapping[str, MazeSampler] = {
    "uniform": MazeSampler("uniform", _uniform),
    "line": MazeSampler("control: straight line + Gaussian", partial(_tube, _straight_line, LINE)),
    "shortest_path": MazeSampler("CVAE (shortest path)", _shortest_path),
    "gmm": MazeSampler("GMM", _gmm),
    "network_plain": MazeSampler(
        "ours, network, not verified", partial(_learned, LearnedGuideOptions(chain_count=1, fallback=False))
    ),
    "network": MazeSampler(
        "ours, network, no fallback", partial(_learned, LearnedGuideOptions(fallback=False)), seeded=True
    ),
    "network_fallback": MazeSampler("ours, network", partial(_learned, LearnedGuideOptions()), seeded=True),
    "network_tube": MazeSampler(
        "ours, network, Gaussian tube", partial(_learned, LearnedGuideOptions(local_sampler="tube")), seeded=True
    ),
    "exact": MazeSampler("ours, exact keypoints", partial(_exact_cvae, "segment_cvae")),
    "exact_paper": MazeSampler("ours, exact keypoints, CVAE as in the paper", partial(_exact_cvae, "cvae")),
    "exact_tube": MazeSampler("exact keypoints + Gaussian tube", partial(_tube, lambda world: world.exact_chain, TUBE)),
    "perfect": MazeSampler(
        "perfect: shortest path + Gaussian", partial(_tube, lambda world: world.shortest_path, TUBE), True
    ),
}
