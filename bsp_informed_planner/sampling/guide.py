"""Guides: what makes guidance for a problem, by the sampler id of a plan.

A guide is made for one robot and one scene, and then asked for each problem. To add one, write a factory and name it in
`GUIDES`; nothing else knows which guides there are.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.errors import MissingPackageError, UnknownSamplerError
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import Guidance, KeypointGuideOptions
from bsp_informed_planner.sampling.sampler import Sampler
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene


class Guide(Protocol):
    """Makes guidance for problems of one robot in one scene. May be asked by several threads at once."""

    def guide(
        self,
        start: FloatArray,
        goals: FloatArray,
        checker: CollisionChecker,
        should_stop: Callable[[], bool] | None = None,
    ) -> Guidance:
        """Guidance from the start to one of the goals.

        Args:
            start: (n,), free.
            goals: (k, n), free.
            checker: exact check; not used by another thread meanwhile.
            should_stop: ends the work early, with what there is.

        Raises:
            KeypointsUnavailableError: if there is none.
        """
        ...

    def sampler(self, chains: Sequence[FloatArray]) -> Sampler:
        """The mixture of the local samplers along chains (m, n), m >= 2, without the uniform share.

        Guides without keypoints look at the ends of the first chain alone, or at none.

        Raises:
            KeypointsUnavailableError: if there is none.
        """
        ...


@runtime_checkable
class LearningGuide(Protocol):
    """A guide that gets better by use."""

    def learn(self, path: FloatArray) -> None:
        """Take note of a path (m, n) that was planned, verified."""
        ...


@dataclass(frozen=True)
class GuideSetting:
    """What guides are made for.

    Attributes:
        robot: the robot.
        scene: in which it plans.
        decomposition: of the scene; called only by guides that need it.
        options: how keypoints are lifted to configurations.
        models: folder of models; None: those that come with the package.
        seed: of guides that draw chains.
    """

    robot: Robot
    scene: Scene
    decomposition: Callable[[], Decomposition]
    options: KeypointGuideOptions = field(default_factory=KeypointGuideOptions)
    models: str | None = None
    seed: int = 0


#: The guide that needs no model.
EXACT = "keypoint_tube"
#: The guide of the project's own networks.
LEARNED = "learned"
#: Sampler id -> "module:factory"; a factory takes a GuideSetting. Modules are imported when first asked for: some load
#: torch.
GUIDES: dict[str, str] = {
    EXACT: "bsp_informed_planner.sampling.keypoint_guide:exact_guide",
    LEARNED: "bsp_informed_planner.sampling.learned:learned_guide",
    "cvae_shortest_path": "bsp_informed_planner.sampling.learned_guide:shortest_path_guide",
    "gmm": "bsp_informed_planner.sampling.gmm:gmm_guide",
    "path_library": "bsp_informed_planner.sampling.path_library:path_library_guide",
}


#: What samples may come from: a guide, or none.
SAMPLER_IDS = (EXACT, "uniform", *(name for name in GUIDES if name != EXACT))


def make_guide(sampler_id: str, setting: GuideSetting) -> Guide:
    """The guide of a sampler id.

    Raises:
        UnknownSamplerError: for an id without a guide.
        ModelUnavailableError: if it needs a model that is not there for this robot.
        ModelError: if a model is damaged.
        MissingPackageError: if it needs a package that is not installed.
    """
    if sampler_id not in GUIDES:
        raise UnknownSamplerError(sampler_id, tuple(GUIDES))
    module, factory = GUIDES[sampler_id].split(":")
    try:
        guide: Guide = getattr(importlib.import_module(module), factory)(setting)
    except ModuleNotFoundError as error:
        raise MissingPackageError(f"sampler_id '{sampler_id}'", error.name or "torch", "learning") from error
    return guide
