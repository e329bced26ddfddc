"""The learned models that the inference node serves, and its guides for the scene in force."""

from __future__ import annotations

import logging
import threading

from bsp_informed_planner.nodes.world import World
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import KeypointGuideOptions
from bsp_informed_planner.sampling.guide import GuideSetting
from bsp_informed_planner.sampling.scene_guides import SceneGuides, load_models

logger = logging.getLogger(__name__)


class ServedModels:
    """Files of models, read before they are needed; guides, kept while the scene stays the same.

    Args:
        folder: of models; None: those that come with the package.
    """

    def __init__(self, folder: str | None) -> None:
        self._folder = folder
        self._lock = threading.Lock()
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

    def load(self, robot: Robot) -> None:
        """Load the models of a robot, for all scenes to come.

        Raises:
            ModelError: if a file does not hold what its card says.
        """
        for reason in load_models(robot, self._folder):
            logger.info(reason)

    def guides(self, world: World, options: KeypointGuideOptions) -> SceneGuides:
        """The guides of a scene."""
        with self._lock:
            if self._made is None or self._made[0] is not world or self._made[1] != options:
                setting = GuideSetting(
                    world.robot, world.scene, lambda: world.planner.decomposition, options, self._folder
                )
                self._made = world, options, SceneGuides(setting)
            return self._made[2]
