"""Guides: what makes guidance for a problem, by the sampler id of a plan.

A guide is made for one robot and one scene, and then asked for each problem. To add one, write a factory and name it in
`GUIDES`; nothing else knows which guides there are.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.errors import UnknownSamplerError
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import Guidance, KeypointGuideOptions
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene


class Guide(Protocol):
    """Makes guidance for problems of one robot in one scene."""

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


#: Sampler id -> "module:factory"; a factory takes a GuideSetting. Modules are imported when first asked for: some load
#: torch.
GUIDES: dict[str, str] = {
    "keypoint_tube": "bsp_informed_planner.sampling.keypoint_guide:exact_guide",
    "learned": "bsp_informed_planner.sampling.learned_guide:learned_guide",
    "cvae_shortest_path": "bsp_informed_planner.sampling.learned_guide:shortest_path_guide",
    "gmm": "bsp_informed_planner.sampling.gmm:gmm_guide",
}


def make_guide(sampler_id: str, setting: GuideSetting) -> Guide:
    """The guide of a sampler id.

    Raises:
        UnknownSamplerError: for an id without a guide.
        ModelUnavailableError: if it needs a model that is not there for this robot.
    """
    if sampler_id not in GUIDES:
        raise UnknownSamplerError(sampler_id, tuple(GUIDES))
    module, factory = GUIDES[sampler_id].split(":")
    guide: Guide = getattr(importlib.import_module(module), factory)(setting)
    return guide
