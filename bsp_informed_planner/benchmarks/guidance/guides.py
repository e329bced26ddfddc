"""Everything that may guide an arm's plan, learned or not, and the controls."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from bsp_informed_planner.benchmarks.planning.problems import ShelfProblem
from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.errors import KeypointsUnavailableError, ModelUnavailableError
from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.sampling.chain_repair import ChainRepair
from bsp_informed_planner.sampling.guidance import ConfigurationChain, Guidance, KeypointGuideOptions
from bsp_informed_planner.sampling.guide import EXACT, Guide, GuideSetting, make_guide
from bsp_informed_planner.sampling.models import find_card, read_once
from bsp_informed_planner.sampling.path_chain_guide import PathChainGuide, lifted
from bsp_informed_planner.sampling.path_guide import path_guidance
from bsp_informed_planner.sampling.path_library import path_library_guide
from bsp_informed_planner.sampling.path_proposals import KIND, PathProposals
from bsp_informed_planner.sampling.tube import tube_sampler
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

#: From the start and goals of a plan, and a check that nothing else uses meanwhile.
MakeGuidance = Callable[[FloatArray, FloatArray, CollisionChecker], Guidance]

#: The sampler `learned` as users get it; all others, its networks alone among them, are joined by nothing.
JOINED = "joined"
TITLES = {
    "plain": "plain RRT-Connect",
    "line": "straight line + Gaussian",
    "exact": "exact keypoints + Gaussian",
    "library": "path library, its paths not repaired",
    "learned": "network",
    JOINED: "network, then exact keypoints too (`learned`)",
    "unrepaired": "network, its chains not repaired",
    "wrong_scene": "network, shown another scene (control)",
    "no_scene": "network without scene (control)",
    "no_scene_repaired": "network without scene, repaired",
    "library_repaired": "path library",
    "random": "paths of the library at random (control)",
    "cvae": "CVAE on shortest paths",
    "gmm": "GMM with workspace decomposition",
    "perfect": "a good path known + Gaussian (bound)",
}


@cache
def robot() -> ArmRobot:
    """The arm of all problems."""
    return ur5()


def guides(
    problem: ShelfProblem,
    other: Scene,
    best: FloatArray,
    models: str | None,
    controls: str | None,
    rng: np.random.Generator,
) -> Mapping[str, MakeGuidance]:
    """What may guide a plan, by a short name; those that need a model which is not there are left out.

    Each has loaded its model, and the scene is decomposed. A caller asks each once before it measures: it has then
    worked out what it needs of the scene alone, as at a second plan in it.

    Args:
        problem: to be planned.
        other: another scene, for the control.
        best: (m, n) a path that is good.
        models: folder of models; None: those that come with the package.
        controls: folder with a model of the kind "path_chains" that was trained without scenes; None: no such row.
        rng: for paths at random.
    """
    decomposition = decompose(problem.scene)
    setting = GuideSetting(robot(), problem.scene, lambda: decomposition, models=models)
    wrong = replace(setting, scene=other)
    found: dict[str, MakeGuidance] = {
        "plain": lambda start, goals, checker: Guidance("uniform"),
        "line": lambda start, goals, checker: path_guidance(robot(), np.array((start, goals[0]))),
        "perfect": lambda start, goals, checker: path_guidance(robot(), best),
    }
    wanted: tuple[tuple[str, Callable[[], Guide]], ...] = (
        ("exact", lambda: make_guide(EXACT, setting)),
        ("library", lambda: path_library_guide(setting, repair=False)),
        ("library_repaired", lambda: make_guide("path_library", setting)),
        ("learned", lambda: make_guide("learned", setting)),
        ("wrong_scene", lambda: make_guide("learned", wrong)),
        ("cvae", lambda: make_guide("cvae_shortest_path", setting)),
        ("gmm", lambda: make_guide("gmm", setting)),
    )
    for name, make in wanted:
        try:
            found[name] = _asked(make())
        except ModelUnavailableError:
            continue
    if "library" in found:
        found["random"] = _at_random(found["library"], rng)
    if "learned" in found:
        path, _ = find_card(robot(), (KIND,), models)
        network = read_once(PathProposals.load, path)
        found["unrepaired"] = _asked(PathChainGuide(setting, network, repair=False))
    if controls is not None:
        find_card(robot(), (KIND,), controls)
        found["no_scene"] = _asked(make_guide("learned", replace(setting, models=controls)))
        found["no_scene_repaired"] = _repaired(found["no_scene"], ChainRepair(robot(), problem.scene))
    return found


def _asked(guide: Guide) -> MakeGuidance:
    """What a guide answers; nothing, where it has no keypoints."""

    def ask(start: FloatArray, goals: FloatArray, checker: CollisionChecker) -> Guidance:
        begin = time.monotonic()
        try:
            return guide.guide(start, goals, checker)
        except KeypointsUnavailableError as error:
            return Guidance("uniform", fallback_reason=error.reason, seconds=time.monotonic() - begin)

    return ask


def _repaired(make: MakeGuidance, repair: ChainRepair) -> MakeGuidance:
    """The chains of a guide, pushed out of obstacles."""

    def ask(start: FloatArray, goals: FloatArray, checker: CollisionChecker) -> Guidance:
        begin = time.monotonic()
        guidance = make(start, goals, checker)
        paths = repair.repaired(np.array([chain.configurations for chain in guidance.chains]), checker)
        sigma, limits = KeypointGuideOptions().tube_sigma(robot()), (robot().lower, robot().upper)
        tube = tube_sampler(list(paths), sigma, *limits)
        return Guidance("repaired", lifted(robot(), paths), tube, seconds=time.monotonic() - begin)

    return ask


def _at_random(library: MakeGuidance, rng: np.random.Generator) -> MakeGuidance:
    """As many paths as the library gives, but shapes of those of other starts and goals."""
    lower, upper = robot().lower, robot().upper

    def ask(start: FloatArray, goals: FloatArray, checker: CollisionChecker) -> Guidance:
        elsewhere = rng.uniform(0.5 * lower, 0.5 * upper, (2, robot().dof))
        guidance = library(elsewhere[0], elsewhere[1:], checker)
        share = np.linspace(0.0, 1.0, len(guidance.chains[0].configurations))[:, None]
        line = (1.0 - share) * start + share * goals[0]
        strange = (1.0 - share) * elsewhere[0] + share * elsewhere[1]
        paths = np.array([chain.configurations - strange + line for chain in guidance.chains])
        paths[:, 1:-1] = np.clip(paths[:, 1:-1], lower, upper)
        chains: tuple[ConfigurationChain, ...] = lifted(robot(), paths)
        tube = path_guidance(robot(), np.concatenate(list(paths)))
        return Guidance("random", chains, tube.sampler, seconds=guidance.seconds)

    return ask
