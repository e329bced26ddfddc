"""The samplers that are compared on an arm: all guides that there are models for, controls and a bound."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from bsp_informed_planner.benchmarks.planning.methods import robot
from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import KeypointsUnavailableError
from bsp_informed_planner.sampling.guidance import KeypointGuideOptions
from bsp_informed_planner.sampling.guide import EXACT, GUIDES, Guide, GuideSetting, make_guide
from bsp_informed_planner.sampling.path_library import path_library_guide
from bsp_informed_planner.sampling.sampler import Sampler
from bsp_informed_planner.sampling.tube import tube_sampler
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Situation:
    """A problem, and what some samplers are made of.

    Attributes:
        scene: of the problem.
        other_scene: another of the same family, for controls.
        start, goal: (n,) free [rad].
        checker: of the scene.
        corridor: (m, n) the first path of RRT-Connect, shortened.
        corridor_seconds: time to it [s].
        best: (m, n) the best path of a long run that is not measured.
    """

    scene: Scene
    other_scene: Scene
    start: FloatArray
    goal: FloatArray
    checker: BoundedChecker
    corridor: FloatArray
    corridor_seconds: float
    best: FloatArray


@dataclass(frozen=True)
class Made:
    """A sampler that was made for a problem.

    Attributes:
        sampler: without uniform samples; None: uniform ones alone.
        seconds: what it took: decomposition, networks, inverse kinematics, checks [s].
        fallback: what took the place of what was asked for, and why; empty if nothing did.
    """

    sampler: Sampler | None
    seconds: float = 0.0
    fallback: str = ""


@dataclass(frozen=True)
class ArmSampler:
    """A sampler under test.

    Attributes:
        title: for people.
        make: of a situation, a seed and a folder of models (None: those of the package); raises ModelUnavailableError
            where a model is missing.
        oracle: it knows a path: a bound, whose time means nothing.
    """

    title: str
    make: Callable[[Situation, int, str | None], Made]
    oracle: bool = False


def _uniform(situation: Situation, seed: int, models: str | None) -> Made:
    return Made(None)


def _guide(
    make: Callable[[GuideSetting], Guide], wrong_scene: bool, situation: Situation, seed: int, models: str | None
) -> Made:
    """A guide as it comes. With the wrong scene, only the decomposition, the fallback's, is of the right one."""
    scene = situation.other_scene if wrong_scene else situation.scene
    options = DecompositionOptions(dimension=3)
    setting = GuideSetting(robot(), scene, lambda: decompose(situation.scene, options), models=models, seed=seed)
    # Reads models, which happens once in a process.
    guide = make(setting)
    begin = time.perf_counter()
    try:
        guidance = guide.guide(situation.start, situation.goal[None], situation.checker)
    except KeypointsUnavailableError as error:
        return Made(None, time.perf_counter() - begin, f"uniform samples: {error.reason}")
    return Made(guidance.sampler, time.perf_counter() - begin, guidance.fallback_reason)


def _tube(path_of: Callable[[Situation], FloatArray], situation: Situation, *_: object) -> Made:
    sigma = KeypointGuideOptions().tube_sigma(robot())
    return Made(tube_sampler([path_of(situation)], sigma, robot().lower, robot().upper))


def _corridor(situation: Situation, seed: int, models: str | None) -> Made:
    return Made(_tube(lambda known: known.corridor, situation).sampler, situation.corridor_seconds)


def _straight_line(situation: Situation) -> FloatArray:
    return np.stack((situation.start, situation.goal))


TITLES = {
    "learned": "ours, networks",
    "cvae_shortest_path": "CVAE (shortest path)",
    "gmm": "GMM",
    EXACT: "ours, exact keypoints",
    "path_library": "path library",
}
_FIRST = {"uniform": ArmSampler("uniform", _uniform)}
_GUIDED = {
    name: ArmSampler(TITLES.get(name, name), partial(_guide, partial(make_guide, name), False))
    for name in sorted(GUIDES, key=lambda name: list(TITLES).index(name) if name in TITLES else len(TITLES))
}
_CONTROLS = {
    "learned_wrong_scene": ArmSampler(
        "control: networks that see another shelf", partial(_guide, partial(make_guide, "learned"), True)
    ),
    "library_as_it_is": ArmSampler(
        "control: path library, its paths not repaired",
        partial(_guide, partial(path_library_guide, repair=False), False),
    ),
    "line": ArmSampler("control, no scene: straight line + Gaussian", partial(_tube, _straight_line)),
    "corridor": ArmSampler("control: tube around an RRT-Connect path", _corridor),
    "perfect": ArmSampler("perfect: tube around the best path known", partial(_tube, lambda known: known.best), True),
}
#: By a short name, for columns. A guide that is added to `sampling.guide` appears here by itself.
SAMPLERS: Mapping[str, ArmSampler] = {**_FIRST, **_GUIDED, **_CONTROLS}
