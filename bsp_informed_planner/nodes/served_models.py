"""The learned models that the inference node serves, and its guides for the scene in force."""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Sequence
from weakref import WeakKeyDictionary

from bsp_informed_planner.nodes.world import World
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import KeypointGuideOptions
from bsp_informed_planner.sampling.guide import EXACT, GUIDES, GuideSetting
from bsp_informed_planner.sampling.scene_guides import SceneGuides, load_guide

logger = logging.getLogger(__name__)

#: Sampler ids of baselines whose networks run in torch for every robot.
TORCH_BASELINES = ("cvae_shortest_path",)


class ServedModels:
    """Files of models, read before they are needed; guides, kept while the scene stays the same.

    Args:
        folder: of models; None: those that come with the package.
    """

    def __init__(self, folder: str | None) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._loaded: WeakKeyDictionary[Robot, list[str]] = WeakKeyDictionary()
        self._made: tuple[World, KeypointGuideOptions, SceneGuides] | None = None

    def require_sound(self) -> None:
        """Read all files of the folder.

        Raises:
            ModelError: if one of them is damaged, saying which and how.
        """
        try:
            from bsp_informed_planner.sampling.models import require_sound_models
        except ModuleNotFoundError as error:
            logger.info("package %s is not installed: keypoints are exact", error.name)
            return
        require_sound_models(self._folder)

    def load(self, robot: Robot, default: str) -> None:
        """Load the models of a robot, for all scenes to come.

        Args:
            robot: the robot.
            default: sampler id of requests that name none. A baseline that alone needs torch is not loaded unless it
                is this one: it takes seconds, and is asked for by experiments only.

        Raises:
            ModelError: if a file does not hold what its card says.
        """
        self._loaded[robot] = [EXACT]
        # Baselines last: they are loaded if torch has been, for another model.
        for sampler_id in sorted(set(GUIDES) - {EXACT}, key=lambda name: name in TORCH_BASELINES):
            if sampler_id in TORCH_BASELINES and sampler_id != default and "torch" not in sys.modules:
                logger.debug("%s: loaded when it is first asked for", sampler_id)
                continue
            reason = load_guide(sampler_id, robot, self._folder)
            if reason and sampler_id == default:
                logger.warning("%s; keypoints are exact", reason)
            elif reason:
                logger.debug(reason)
            else:
                self._loaded[robot].append(sampler_id)

    def loaded(self, robot: Robot) -> Sequence[str]:
        """Sampler ids of the models that have been loaded for a robot, and of exact keypoints."""
        return self._loaded.get(robot, [EXACT])

    def guides(self, world: World, options: KeypointGuideOptions) -> SceneGuides:
        """The guides of a scene."""
        with self._lock:
            if self._made is None or self._made[0] is not world or self._made[1] != options:
                setting = GuideSetting(
                    world.robot, world.scene, lambda: world.planner.decomposition, options, self._folder
                )
                self._made = world, options, SceneGuides(setting)
            return self._made[2]
