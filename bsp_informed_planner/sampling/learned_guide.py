"""Guidance by networks (Algorithm 3), with fallback to exact keypoints."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.errors import InvalidOptionError, KeypointsUnavailableError, ModelUnavailableError
from bsp_informed_planner.networks.registry import Model
from bsp_informed_planner.sampling.cvae_sampler import CvaeMixture, cvae_sampler
from bsp_informed_planner.sampling.guidance import ConfigurationChain, Guidance
from bsp_informed_planner.sampling.guide import LEARNED, GuideSetting
from bsp_informed_planner.sampling.keypoint_estimation import EstimatedChain, SceneView, estimator_of
from bsp_informed_planner.sampling.keypoint_guide import ExactKeypointGuide
from bsp_informed_planner.sampling.models import KEYPOINT_KINDS, find_model
from bsp_informed_planner.sampling.sampler import Sampler
from bsp_informed_planner.sampling.tube import tube_sampler
from bsp_informed_planner.scene.pose import FloatArray

SHORTEST_PATH_ID = "cvae_shortest_path"
#: Kinds of models of local samplers, the best first.
SAMPLER_KINDS = ("segment_cvae", "cvae")


@dataclass(frozen=True)
class LearnedGuideOptions:
    """How networks guide.

    Attributes:
        chain_count: chains that are drawn.
        goal_count: goals that they are shared out to, the nearest ones.
        fallback: whether the exact chain takes their place if none of them is free; else the shortest one is taken
            as it is.
        local_sampler: "cvae" or "tube": what samples between keypoints of the chain.

    Raises:
        InvalidOptionError: for a number or name that is none.
    """

    chain_count: int = 16
    goal_count: int = 4
    fallback: bool = True
    local_sampler: str = "cvae"

    def __post_init__(self) -> None:
        for name in ("chain_count", "goal_count"):
            if getattr(self, name) < 1:
                raise InvalidOptionError(name, getattr(self, name), "at least 1")
        if self.local_sampler not in ("cvae", "tube"):
            raise InvalidOptionError("local_sampler", self.local_sampler, "cvae or tube")


class LearnedGuide:
    """Draws chains of keypoints from a network, takes the best that is free, and samples between its keypoints.

    What the network sees of the scene is made once, when it is first needed.

    Args:
        setting: robot and scene.
        keypoints: model that estimates keypoints.
        sampler: model of local samplers; None: Gaussian tubes.
        options: see there.
    """

    def __init__(
        self,
        setting: GuideSetting,
        keypoints: Model,
        sampler: Model | None,
        options: LearnedGuideOptions | None = None,
    ) -> None:
        self._setting = setting
        self._keypoints = keypoints
        self._sampler = sampler
        self._options = options or LearnedGuideOptions()
        self._estimator = estimator_of(keypoints)
        self._views: dict[str, SceneView] = {}

    def guide(
        self,
        start: FloatArray,
        goals: FloatArray,
        checker: CollisionChecker,
        should_stop: Callable[[], bool] | None = None,
    ) -> Guidance:
        """See `Guide`. `fallback_reason` says if exact keypoints took the place of the network's.

        Raises:
            KeypointsUnavailableError: if neither the network nor the decomposition has a chain.
        """
        begin = time.monotonic()
        stop = should_stop or (lambda: False)
        chains = self.estimated(start, goals)
        taken = best_free_chain(chains, checker, stop)
        reason = ""
        if taken is None and self._options.fallback:
            reached = sum(chain.reached for chain in chains)
            reason = (
                f"exact keypoints: of {len(chains)} chains of model '{self._keypoints.card.name}' {reached} reach the "
                "goal and none of them is free"
            )
            exact = ExactKeypointGuide(self._setting.robot, self._setting.decomposition(), self._setting.options)
            configuration_chains = exact.chains(start, goals, checker, should_stop)
        else:
            arrived = [chain for chain in chains if chain.reached]
            if taken is None and not arrived:
                raise KeypointsUnavailableError(
                    f"none of {len(chains)} chains of model '{self._keypoints.card.name}' reaches the goal"
                )
            taken = taken or min(arrived, key=lambda chain: chain.length)
            configuration_chains = (self._lifted(taken),)
        sampler = self.sampler([chain.configurations for chain in configuration_chains])
        return Guidance(LEARNED, configuration_chains, sampler, reason, time.monotonic() - begin)

    def estimated(self, start: FloatArray, goals: FloatArray) -> list[EstimatedChain]:
        """Chains of the network from start (n,) to the nearest of the goals (k, n), unchecked.

        They follow from the seed of the setting and the problem.
        """
        options = self._options
        order = np.argsort(np.linalg.norm(goals - start, axis=1), kind="stable")[: options.goal_count]
        shares = np.diff(np.linspace(0, options.chain_count, len(order) + 1).astype(int))
        rng = np.random.default_rng(self._setting.seed)
        view = self._view(self._keypoints)
        return [
            chain
            for index, share in zip(order, shares, strict=True)
            for chain in self._estimator.chains(view, start, goals[index], max(int(share), 1), rng)
        ]

    def _view(self, model: Model) -> SceneView:
        key = repr(model.encoding)
        if key not in self._views:
            self._views[key] = SceneView.of(self._setting.scene, model)
        return self._views[key]

    def _lifted(self, chain: EstimatedChain) -> ConfigurationChain:
        robot = self._setting.robot
        points = [robot.forward_kinematics(configuration).position for configuration in chain.configurations]
        return ConfigurationChain(chain.configurations, np.array(points))

    def sampler(self, chains: Sequence[FloatArray]) -> Sampler:
        """See `Guide`."""
        robot, scene = self._setting.robot, self._setting.scene
        if self._sampler is None or self._options.local_sampler == "tube":
            return tube_sampler(chains, self._setting.options.tube_sigma(robot), robot.lower, robot.upper)
        pairs = [pair for chain in chains for pair in zip(chain[:-1], chain[1:], strict=True)]
        view = None if self._sampler.card.kind == "segment_cvae" else self._view(self._sampler)
        return cvae_sampler(self._sampler, scene, view, pairs, robot.lower, robot.upper)


class ShortestPathGuide:
    """Samples of whole paths without keypoints (Ichter, Harrison and Pavone, 2018): the paper's baseline.

    Args:
        setting: robot and scene.
        sampler: model of kind "cvae_shortest_path".
    """

    def __init__(self, setting: GuideSetting, sampler: Model) -> None:
        self._setting = setting
        self._sampler = sampler
        self._view: SceneView | None = None

    def guide(
        self,
        start: FloatArray,
        goals: FloatArray,
        checker: CollisionChecker,
        should_stop: Callable[[], bool] | None = None,
    ) -> Guidance:
        """See `Guide`: samples between the start and the nearest goal, and no chains."""
        begin = time.monotonic()
        goal = goals[int(np.argmin(np.linalg.norm(goals - start, axis=1)))]
        return Guidance(SHORTEST_PATH_ID, (), self.sampler([np.array((start, goal))]), "", time.monotonic() - begin)

    def sampler(self, chains: Sequence[FloatArray]) -> CvaeMixture:
        """See `Guide`: between the ends of the first chain."""
        robot, scene = self._setting.robot, self._setting.scene
        self._view = self._view or SceneView.of(scene, self._sampler)
        ends = (chains[0][0], chains[0][-1])
        return cvae_sampler(self._sampler, scene, self._view, [ends], robot.lower, robot.upper)


def best_free_chain(
    chains: list[EstimatedChain], checker: CollisionChecker, should_stop: Callable[[], bool]
) -> EstimatedChain | None:
    """The shortest chain that reaches its target and is free; None if there is none, or time is over before."""
    for chain in sorted((chain for chain in chains if chain.reached), key=lambda chain: chain.length):
        if should_stop():
            return None
        edges = zip(chain.configurations[:-1], chain.configurations[1:], strict=True)
        if all(checker.is_edge_free(a, b) for a, b in edges):
            return chain
    return None


def keypoint_guide(setting: GuideSetting) -> LearnedGuide:
    """Keypoints one after the other, with the models for the setting's robot.

    Without a model of samplers, these are Gaussian tubes.

    Raises:
        ModelUnavailableError: if there is no model of keypoints for the robot.
        ModelError: if a model is damaged.
    """
    keypoints = find_model(setting.robot, KEYPOINT_KINDS, setting.models)
    try:
        sampler = find_model(setting.robot, SAMPLER_KINDS, setting.models)
    except ModelUnavailableError:
        sampler = None
    return LearnedGuide(setting, keypoints, sampler)


def shortest_path_guide(setting: GuideSetting) -> ShortestPathGuide:
    """The guide of the sampler id "cvae_shortest_path".

    Raises:
        ModelUnavailableError: if there is no such model for the robot.
    """
    return ShortestPathGuide(setting, find_model(setting.robot, (SHORTEST_PATH_ID,), setting.models))
