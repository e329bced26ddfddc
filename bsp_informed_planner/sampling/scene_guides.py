"""All guides of one robot in one scene, and what takes the place of one that is not to be had."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.errors import (
    KeypointsUnavailableError,
    MissingPackageError,
    ModelError,
    ModelMismatchError,
    ModelUnavailableError,
)
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import Guidance
from bsp_informed_planner.sampling.guide import EXACT, Guide, GuideSetting, LearningGuide, make_guide
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds

logger = logging.getLogger(__name__)

#: Why a guide may not be made.
UNAVAILABLE = (ModelUnavailableError, ModelError, ModelMismatchError, MissingPackageError)


class SceneGuides:
    """Guides by their sampler ids, each made when it is first asked for and kept: what a guide works out about the
    scene, it works out once. For several threads.

    Args:
        setting: robot, scene and options of all of them.
    """

    def __init__(self, setting: GuideSetting) -> None:
        self.setting = setting
        self._guides: dict[str, Guide] = {}
        self._lock = threading.Lock()

    def get(self, sampler_id: str) -> Guide:
        """The guide of a sampler id.

        Raises:
            UnknownSamplerError, ModelUnavailableError, ModelError, MissingPackageError: see `make_guide`.
        """
        with self._lock:
            if sampler_id not in self._guides:
                self._guides[sampler_id] = make_guide(sampler_id, self.setting)
            return self._guides[sampler_id]

    def learn(self, sampler_id: str, path: FloatArray) -> None:
        """Tell the guide of a sampler id, if it has been asked before, of a path (m, n) that was planned."""
        guide = self._guides.get(sampler_id)
        if isinstance(guide, LearningGuide):
            guide.learn(path)

    def guide(
        self,
        sampler_id: str,
        start: FloatArray,
        goals: FloatArray,
        checker: CollisionChecker,
        should_stop: Callable[[], bool] | None = None,
    ) -> Guidance:
        """Guidance of a sampler id; else by exact keypoints; else none but uniform samples, with the reasons.

        Args:
            sampler_id: of a guide, or "uniform".
            start: (n,) free.
            goals: (k, n) free.
            checker: exact check; not used by another thread meanwhile.
            should_stop: ends the work early, with what there is.

        Raises:
            UnknownSamplerError: for an id that does not exist.
        """
        if sampler_id == "uniform":
            return Guidance("uniform")
        begin = time.monotonic()
        reasons: list[str] = []
        for candidate in dict.fromkeys((sampler_id, EXACT)):
            try:
                guidance = self.get(candidate).guide(start, goals, checker, should_stop)
            except UNAVAILABLE as error:
                reasons.append(f"{candidate}: {error}")
            except KeypointsUnavailableError as error:
                reasons.append(f"no keypoints: {error.reason}" if candidate == EXACT else f"{candidate}: {error}")
            else:
                if reasons:
                    reasons.append(guidance.fallback_reason)
                    seconds = time.monotonic() - begin
                    guidance = replace(guidance, fallback_reason="; ".join(filter(None, reasons)), seconds=seconds)
                break
        else:
            guidance = Guidance("uniform", fallback_reason="; ".join(reasons), seconds=time.monotonic() - begin)
        if reasons:
            logger.debug("%s instead of %s: %s", guidance.sampler_id, sampler_id, guidance.fallback_reason)
        return guidance


def load_guide(sampler_id: str, robot: Robot, folder: str | None = None) -> str:
    """Load the model of a guide for a robot, so that no plan has to wait: guides made later find it read.

    Args:
        sampler_id: of the guide.
        robot: whose model it is.
        folder: of models; None: those that come with the package.

    Returns:
        why the guide cannot be made; empty if it can.

    Raises:
        ModelError: if a file does not hold what its card says.
    """
    # Guides look at the scene when they are asked for guidance, and read their models before.
    scene = Scene.of([], WorkspaceBounds(-np.ones(3), np.ones(3)), robot.root_frame)
    try:
        make_guide(sampler_id, GuideSetting(robot, scene, lambda: decompose(scene), models=folder))
    except (ModelUnavailableError, MissingPackageError) as error:
        return f"{sampler_id}: {error}"
    return ""
