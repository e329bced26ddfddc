"""The inference node: serves keypoint chains, and samples around them.

Its models are the guides of `sampling.guide`, by their sampler ids: exact keypoints, networks, and the baselines. Files
of models are read when the node is configured, or when the robot becomes known, and never while a request waits.
"""

from __future__ import annotations

import logging
import time
from array import array
from dataclasses import dataclass

import numpy as np
from bsp_informed_planner_msgs.srv import EstimateKeypoints, SampleConfigurations

from bsp_informed_planner.errors import (
    BspPlannerError,
    InvalidOptionError,
    InvalidStateError,
    KeypointsUnavailableError,
    UnknownSamplerError,
)
from bsp_informed_planner.nodes.arrays import float64_field, rows, uint32_field
from bsp_informed_planner.nodes.error_codes import ErrorCode, error_code
from bsp_informed_planner.nodes.lifecycle import PlannerSuiteNode, run
from bsp_informed_planner.nodes.meter import Meter
from bsp_informed_planner.nodes.obstacle_conversions import point_to_msg
from bsp_informed_planner.nodes.own_thread import Reply
from bsp_informed_planner.nodes.parameters import parameter
from bsp_informed_planner.nodes.qos import SERVICES
from bsp_informed_planner.nodes.robot_preparation import RobotPreparation
from bsp_informed_planner.nodes.robot_source import RobotParameters, RobotSource
from bsp_informed_planner.nodes.served_models import ServedModels
from bsp_informed_planner.nodes.world import World, WorldTracker
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.validation import free_state
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import KeypointGuideOptions
from bsp_informed_planner.sampling.guide import EXACT, GUIDES
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.pose import FloatArray

logger = logging.getLogger(__name__)

#: Longest time for the guidance that a model is tried out with when its robot is new [s].
WARM_UP_SECONDS = 2.0
#: Head start of the planner node with a new scene [s]: it asks for guidance only if a short search finds no path.
PLANNER_FIRST = 0.01
MAX_SAMPLES = 100_000
MAX_GOALS = 1000


@dataclass(frozen=True)
class InferenceParameters(RobotParameters):
    """Parameters of the inference node."""

    model: str = parameter(
        EXACT, "Model, a sampler_id, that serves requests that name none.", choices=tuple(GUIDES), live=True
    )
    model_folder: str = parameter("", "Folder of learned models; empty: those that come with the package.")
    allow_empty_scene: bool = parameter(True, "Serve scenes without obstacles.", live=True)
    max_seconds: float = parameter(
        2.0, "Most time for the chains of one request [s].", minimum=0.01, maximum=60.0, live=True
    )
    sigma: float = parameter(
        0.2, "Standard deviation of samples around a chain [rad].", minimum=1e-3, maximum=3.0, live=True
    )


class InferenceNode(PlannerSuiteNode):
    """Serves `estimate_keypoints` and `sample_configurations` for the scene in force."""

    def __init__(self, **options: object) -> None:
        super().__init__("inference_node", **options)

    def setup(self) -> None:
        self._parameter_set = self.follow_parameters(InferenceParameters, self._on_parameters)
        self._estimates = Meter()
        self._samples = Meter()
        self._models = ServedModels(self._settings.model_folder or None)
        self._models.require_sound()
        self._world = WorldTracker(self, self._settings.allow_empty_scene, PLANNER_FIRST)
        self.release_with(self._world.close)
        self._preparation = RobotPreparation(self._world, self._try_out, self.note_error)
        self.release_with(self._preparation.close)
        self._robot_source = RobotSource(self, self._settings, self._on_robot, self.note_error)
        self.release_with(self._robot_source.close)
        # One request of a kind at a time; the scene comes in through a thread of its own.
        for kind, name, callback in (
            (EstimateKeypoints, "estimate_keypoints", self._on_estimate),
            (SampleConfigurations, "sample_configurations", self._on_sample),
        ):
            self.own_thread(name).serve(kind, name, callback, SERVICES)

    @property
    def _settings(self) -> InferenceParameters:
        return self._parameter_set.values

    def _on_robot(self, robot: Robot) -> None:
        self._models.load(robot, self._settings.model)
        self._preparation.submit(robot)

    def _try_out(self, planner: Planner, problem: ScenarioProblem) -> None:
        """Guidance by each model of a robot that is new: the next is as fast as it can be."""
        goals, options = np.array(problem.goals), KeypointGuideOptions(sigma=self._settings.sigma)
        rng = np.random.default_rng(0)
        for model in self._models.loaded(planner.robot):
            deadline = time.monotonic() + WARM_UP_SECONDS
            guidance = self._models.guides(World(planner, epoch=0), options).guide(
                model,
                problem.start,
                goals,
                planner.checker(),
                lambda: time.monotonic() > deadline,  # noqa: B023
            )
            if guidance.sampler is not None:
                guidance.sampler.sample(rng, 1)

    def _on_parameters(self, settings: InferenceParameters) -> None:
        self._world.allow_empty_scene = settings.allow_empty_scene

    def diagnostic_values(self) -> dict[str, object]:
        return {
            "robot": self._world.robot_name,
            "preparation": self._world.preparation,
            "model": self._settings.model,
            "scene_epoch": self._world.epoch,
            "scene_revision": self._world.revision,
            **self._estimates.values("estimates"),
            **self._samples.values("sample_batches"),
        }

    def _on_estimate(self, request: EstimateKeypoints.Request, reply: Reply) -> None:
        begin, response = time.monotonic(), EstimateKeypoints.Response()
        try:
            self._estimate(request, response, begin + self._settings.max_seconds)
        except Exception as error:  # noqa: BLE001 -- every request gets an answer
            self._refuse(error, response)
        response.inference_seconds = time.monotonic() - begin
        reply(response)
        self._estimates.count(response.inference_seconds)

    def _estimate(
        self, request: EstimateKeypoints.Request, response: EstimateKeypoints.Response, deadline: float
    ) -> None:
        self.require_active()
        model = response.model = self._model(request.model)
        world = self._world.current(int(request.scene_epoch), int(request.scene_revision))
        response.scene_epoch, response.scene_revision = world.epoch, world.revision
        checker = world.planner.checker()
        start = free_state(world.robot, checker, "start", np.array(request.start))
        goals = self._rows("goal", request.goals, request.joints, world.robot.dof)
        if not 1 <= len(goals) <= MAX_GOALS:
            raise InvalidOptionError("goals", len(goals), f"1 to {MAX_GOALS}")
        goals = np.array([free_state(world.robot, checker, "goal", goal) for goal in goals])
        guidance = self._models.guides(world, KeypointGuideOptions(sigma=self._settings.sigma)).guide(
            model, start, goals, checker, lambda: time.monotonic() > deadline
        )
        if guidance.sampler_id == "uniform":
            raise KeypointsUnavailableError(guidance.fallback_reason)
        response.model = guidance.sampler_id
        chains = [
            (chain.configurations, chain.keypoints) for chain in guidance.chains[: max(int(request.max_chains), 1)]
        ]
        if not chains:
            # A model without keypoints: the ends are all that its sampler needs to know.
            ends = np.array((start, goals[int(np.argmin(np.linalg.norm(goals - start, axis=1)))]))
            chains = [(ends, world.robot.reference_points(ends))]
        response.configurations = float64_field(np.concatenate([configurations for configurations, _ in chains]))
        response.joints = world.robot.dof
        response.chain_offsets = uint32_field(np.cumsum([0] + [len(configurations) for configurations, _ in chains]))
        response.keypoints = [point_to_msg(point) for _, points in chains for point in points]
        response.error_code = int(ErrorCode.SUCCESS)
        response.message = guidance.fallback_reason

    def _on_sample(self, request: SampleConfigurations.Request, reply: Reply) -> None:
        begin, response = time.monotonic(), SampleConfigurations.Response()
        try:
            self._sample(request, response)
        except Exception as error:  # noqa: BLE001 -- every request gets an answer
            self._refuse(error, response)
        response.inference_seconds = time.monotonic() - begin
        reply(response)
        self._samples.count(response.inference_seconds)

    def _sample(self, request: SampleConfigurations.Request, response: SampleConfigurations.Response) -> None:
        self.require_active()
        response.model = self._model(request.model)
        world = self._world.current(int(request.scene_epoch), int(request.scene_revision))
        response.scene_epoch, response.scene_revision = world.epoch, world.revision
        robot = world.robot
        if not 1 <= request.count <= MAX_SAMPLES:
            raise InvalidOptionError("count", request.count, f"1 to {MAX_SAMPLES}")
        configurations = self._rows("chain", request.configurations, request.joints, robot.dof)
        offsets = np.array(request.chain_offsets, dtype=np.int64)
        if len(offsets) < 2 or offsets[0] != 0 or offsets[-1] != len(configurations) or (np.diff(offsets) < 2).any():
            raise InvalidOptionError(
                "chain_offsets", offsets.tolist(), "offsets from 0 to the number of rows, two rows a chain at least"
            )
        chains = [configurations[begin:end] for begin, end in zip(offsets[:-1], offsets[1:], strict=True)]
        options = KeypointGuideOptions(sigma=self._settings.sigma)
        sampler = self._models.guides(world, options).get(response.model).sampler(chains)
        rng = np.random.default_rng(int(request.seed) or None)
        response.samples = float64_field(sampler.sample(rng, int(request.count)))
        response.joints = robot.dof
        response.error_code = int(ErrorCode.SUCCESS)

    def _model(self, name: str) -> str:
        name = name or self._settings.model
        if name not in GUIDES:
            raise UnknownSamplerError(name, tuple(GUIDES))
        return name

    def _rows(self, name: str, values: array[float], joints: int, dof: int) -> FloatArray:
        if joints != dof:
            raise InvalidStateError(name, f"{joints} joints, but the robot has {dof}")
        try:
            table = rows(values, dof, name)
        except ValueError as error:
            raise InvalidStateError(name, str(error)) from error
        if not np.isfinite(table).all():
            raise InvalidStateError(name, "a value is not finite")
        return table

    def _refuse(self, error: Exception, response: EstimateKeypoints.Response | SampleConfigurations.Response) -> None:
        response.error_code = int(error_code(error))
        response.message = str(error)
        if not response.scene_revision:
            response.scene_epoch, response.scene_revision = self._world.epoch, self._world.revision
        if not isinstance(error, BspPlannerError):
            # A caller must never wait for an answer that does not come.
            self.note_error(f"{type(error).__name__}: {error}")
            logger.error("while serving a request", exc_info=error)


def main(args: list[str] | None = None) -> None:
    """Entry point of `inference_node`."""
    run(InferenceNode, args)


if __name__ == "__main__":
    main()
