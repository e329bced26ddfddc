"""The models that can be trained from a dataset: network, loss, examples and card of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
import torch
from torch import nn

from bsp_informed_planner.errors import DatasetMismatchError, InvalidOptionError, TrainingError
from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.keypoint_examples import (
    HeatmapExamples,
    HeatmapObjective,
    HeatmapTargets,
    RegressionExamples,
    RegressionObjective,
)
from bsp_informed_planner.experience.path_examples import PathExamples, PathObjective, tool_box
from bsp_informed_planner.experience.provenance import robot_identity
from bsp_informed_planner.experience.sampler_examples import (
    SamplerObjective,
    SceneSamplerExamples,
    SegmentSamplerExamples,
)
from bsp_informed_planner.experience.training import Examples, TrainingOptions
from bsp_informed_planner.networks.card import ModelCard, ModelRobot
from bsp_informed_planner.networks.cvae import Cvae
from bsp_informed_planner.networks.encoding import (
    BasisDistances,
    PlanarDistances,
    PlanarOccupancy,
    SceneEncoding,
    encoding_to_json,
)
from bsp_informed_planner.networks.keypoint_heatmap import KeypointHeatmap
from bsp_informed_planner.networks.keypoint_regression import KeypointRegression
from bsp_informed_planner.networks.path_chains import PathChains
from bsp_informed_planner.networks.problem_view import ProblemView, ViewOptions
from bsp_informed_planner.networks.registry import build_network
from bsp_informed_planner.networks.segment_frame import CONDITION_SIZE
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.path_proposals import KIND as PATH_CHAINS

Network = TypeVar("Network", bound=nn.Module)
#: Told how many problems of how many have been read.
Report = Callable[[int, int], None]

#: Cells along the grid that the samplers of Ichter et al. see, and those that the keypoint network of the paper sees.
SAMPLER_CELLS, REGRESSION_CELLS = 11, 32
#: Distances that arms' networks see, and where they are cut off [m].
BASIS_POINTS, BASIS_CAP = 256, 0.5
#: Weight of the divergence in the loss of samplers: that of Ichter et al. for states of the whole scene. States are
#: drawn with a variance that is less by this weight than what they were trained on.
SCENE_DIVERGENCE, SEGMENT_DIVERGENCE = 4e-4, 5e-4
#: Standard deviation of noise on states that samplers are trained on, in unit coordinates: 0.02 to 0.03 remain.
SCENE_SPREAD, SEGMENT_SPREAD = 0.03, 0.02
#: Problems from which means and spreads of conditions are taken, and the least spread.
_STATISTICS, _LEAST_SCALE = 10_000, 0.02
#: End of the names of models that do not see the scene.
WITHOUT_SCENE = "_without_scene"
#: Standard deviation of noise on current keypoints of the regression.
REGRESSION_NOISE = 0.01


@dataclass(frozen=True, eq=False)
class Training:
    """All that `experience.training.train` needs for one model.

    Attributes:
        network: inside of the objective.
        objective: gives the loss of a batch.
        training, validation: examples.
        card: all but its metrics and its training.
    """

    network: nn.Module
    objective: nn.Module
    training: Examples
    validation: Examples
    card: ModelCard


@dataclass(frozen=True)
class TrainableModel:
    """A kind of model.

    Attributes:
        kind: its name on the command line and in cards.
        purpose: a sentence.
        options: how it is trained unless something else is asked for.
        prepare: makes the training from problems for training and validation, solved all of them, and a seed.
        limits: sentences for the card.
    """

    kind: str
    purpose: str
    options: TrainingOptions
    prepare: Callable[[TrainableModel, Experience, Experience, int, Report], Training]
    limits: tuple[str, ...] = field(default=())


def prepare_training(
    kind: str, experience: Experience, seed: int, problems: int | None = None, report: Report = lambda done, total: None
) -> Training:
    """Network, loss, examples and card of a model.

    Args:
        kind: of `MODELS`.
        experience: all problems of a dataset; its splits "train" and "validation" are used.
        seed: of the weights and of the choice of examples.
        problems: at most so many solved problems for training; None: all.
        report: told how many problems have been read, for each split anew.

    Raises:
        InvalidOptionError: for a kind that does not exist.
        DatasetMismatchError: if the model is not for the dataset's robot.
        TrainingError: if a split has no solved problems.
    """
    if kind not in MODELS:
        raise InvalidOptionError("model", kind, f"one of {', '.join(MODELS)}")
    training = experience.select(split="train", solved=True)
    validation = experience.select(split="validation", solved=True)
    if problems is not None:
        training = training.subset(np.arange(min(problems, len(training))))
    for name, part in (("train", training), ("validation", validation)):
        if not len(part):
            raise TrainingError(f"{experience.folder} has no solved problems in its split '{name}'")
    torch.manual_seed(seed)
    return MODELS[kind].prepare(MODELS[kind], training, validation, seed, report)


def _heatmap(
    model: TrainableModel, training: Experience, validation: Experience, seed: int, report: Report
) -> Training:
    _require_planar(training, model.kind)
    targets = HeatmapTargets()
    encoding = PlanarDistances(64)
    architecture = {"cells": encoding.cells // 2, "channels": [32, 64, 96], "embedding": 64, "attention": 2}
    card = _card(model, training, encoding, architecture, {"clearance_weight": targets.clearance_weight})
    network = _built(card, KeypointHeatmap)
    return Training(
        network,
        HeatmapObjective(network),
        HeatmapExamples(training, encoding, targets, seed, report),
        HeatmapExamples(validation, encoding, targets, seed, report),
        card,
    )


def _regression(
    model: TrainableModel,
    training: Experience,
    validation: Experience,
    seed: int,
    report: Report,
) -> Training:
    planar = _is_planar(training)
    encoding = _scene_encoding(training, REGRESSION_CELLS)
    architecture = {"scene_size": int(np.prod(encoding.shape)), "state_size": training.dof, "hidden": 256, "layers": 3}
    card = _card(model, training, encoding, architecture, {"noise": REGRESSION_NOISE})
    network = _built(card, KeypointRegression)
    return Training(
        network,
        RegressionObjective(network),
        RegressionExamples(training, encoding, planar, REGRESSION_NOISE),
        RegressionExamples(validation, encoding, planar, REGRESSION_NOISE),
        card,
    )


def _scene_sampler(
    model: TrainableModel,
    training: Experience,
    validation: Experience,
    seed: int,
    report: Report,
) -> Training:
    planar, dof = _is_planar(training), training.dof
    encoding = _scene_encoding(training, SAMPLER_CELLS)
    # A latent vector of 3 for the 6 numbers of the authors' double integrator, larger for arms.
    latent_size = 3 if planar else dof + 2
    architecture = {
        "state_size": dof,
        "condition_size": 2 * dof + int(np.prod(encoding.shape)),
        "latent_size": latent_size,
    }
    inputs = {"spread": SCENE_SPREAD, "divergence_weight": SCENE_DIVERGENCE}
    card = _card(model, training, encoding, architecture, inputs)
    network = _built(card, Cvae)
    whole = model.kind == "cvae_shortest_path"

    def examples(part: Experience) -> SceneSamplerExamples:
        return SceneSamplerExamples(part, encoding, whole, SCENE_SPREAD, planar, latent_size, seed)

    return Training(
        network, SamplerObjective(network, SCENE_DIVERGENCE), examples(training), examples(validation), card
    )


def _segment_sampler(
    model: TrainableModel,
    training: Experience,
    validation: Experience,
    seed: int,
    report: Report,
) -> Training:
    _require_planar(training, model.kind)
    encoding = PlanarDistances(SAMPLER_CELLS)
    latent_size = 3
    architecture = {
        "state_size": 2,
        "condition_size": CONDITION_SIZE,
        "latent_size": latent_size,
        "hidden": 128,
    }
    inputs = {"spread": SEGMENT_SPREAD, "divergence_weight": SEGMENT_DIVERGENCE}
    card = _card(model, training, encoding, architecture, inputs)
    network = _built(card, Cvae)

    def examples(part: Experience) -> SegmentSamplerExamples:
        return SegmentSamplerExamples(part, encoding, SEGMENT_SPREAD, latent_size, seed)

    return Training(
        network, SamplerObjective(network, SEGMENT_DIVERGENCE), examples(training), examples(validation), card
    )


def _path_chains(
    model: TrainableModel, training: Experience, validation: Experience, seed: int, report: Report
) -> Training:
    robot = robot_of(training)
    lower, upper = tool_box(training, robot)
    options = ViewOptions(lower, upper, scene=not model.kind.endswith(WITHOUT_SCENE))
    view = ProblemView(robot, options)
    architecture = {
        "condition_size": view.size,
        "state_size": training.dof,
        "heads": 16,
        "waypoints": 12,
        "hidden": 512,
        "layers": 3,
        "dropout": 0.1,
    }
    card = replace(_card(model, training, None, architecture, {}), kind=PATH_CHAINS, encoding=options.to_json())
    network = _built(card, PathChains)
    examples = PathExamples(training, view, network.output_shape[1], report)
    statistics = examples.conditions[: 2 * _STATISTICS].astype(np.float64)
    network.mean.copy_(torch.from_numpy(statistics.mean(axis=0)))
    # What hardly changes is not blown up.
    network.scale.copy_(torch.from_numpy(np.maximum(statistics.std(axis=0), _LEAST_SCALE)))
    return Training(
        network,
        PathObjective(network, robot.motion_radii),
        examples,
        PathExamples(validation, view, network.output_shape[1], report),
        card,
    )


def robot_of(experience: Experience) -> Robot:
    """The robot that comes with the package and is the dataset's.

    Raises:
        DatasetMismatchError: if there is none.
    """
    found = experience.description.robot
    if found.workspace_dimension == 2:
        robot: Robot = PointRobot(found.lower, found.upper)
    else:
        from bsp_informed_planner.robots.demo_arms import ur5

        robot = ur5()
    experience.require_robot(robot_identity(robot))
    return robot


def _card(
    model: TrainableModel,
    training: Experience,
    encoding: SceneEncoding | None,
    architecture: Mapping[str, Any],
    inputs: Mapping[str, Any],
) -> ModelCard:
    description = training.description
    robot = description.robot
    return ModelCard(
        name=f"{description.family}_{model.kind}",
        kind=model.kind,
        architecture=architecture,
        encoding={} if encoding is None else encoding_to_json(encoding),
        robot=ModelRobot(robot.name, robot.joint_names, robot.workspace_dimension, robot.tool_frame),
        inputs=inputs,
        data={
            "family": description.family,
            "collection_seed": description.seed,
            "problems": len(training),
            "first_seed": int(training.seeds.min()),
            "last_seed": int(training.seeds.max()),
            "parameters": dict(description.parameters),
        },
        limits=model.limits,
    )


def _built(card: ModelCard, kind: type[Network]) -> Network:
    """The network of a card, which is of a class."""
    network = build_network(card)
    assert isinstance(network, kind)
    return network


def _scene_encoding(experience: Experience, cells: int) -> SceneEncoding:
    """Occupancy for planar robots; else distances at points of the first scene's workspace."""
    if _is_planar(experience):
        return PlanarOccupancy(cells)
    robot, bounds = experience.description.robot, experience.scene(0).bounds
    lower, upper = (tuple(corner.tolist()) for corner in (bounds.lower, bounds.upper))
    return BasisDistances(lower, upper, BASIS_POINTS, BASIS_CAP, robot.lower, robot.upper)


def _is_planar(experience: Experience) -> bool:
    """Whether configurations are points of the plane."""
    return experience.description.robot.workspace_dimension == 2 and experience.dof == 2


def _require_planar(experience: Experience, kind: str) -> None:
    if not _is_planar(experience):
        robot = experience.description.robot
        found = f"'{robot.name}' with {experience.dof} joints"
        expected = f"a planar robot, which '{kind}' is for; for arms there is '{PATH_CHAINS}'"
        raise DatasetMismatchError(str(experience.folder), f"model '{kind}'", found, expected)


_ONLY_LIKE_ITS_DATA = (
    "Trained on one family of scenes: for others its output is a guess, and is verified like all others."
)
_MOSTLY_ENDS = (
    "Most of what it proposes follows from start and goal: `bsp-planner evaluate --controls` tells what the scene adds."
)
_SAMPLER_OPTIONS = TrainingOptions(
    steps=6000, batch_size=256, learning_rate=1e-3, warmup=100, validate_every=200, patience=10
)

_PATH_OPTIONS = TrainingOptions(
    steps=4000, batch_size=256, learning_rate=1e-3, weight_decay=0.02, warmup=200, validate_every=250
)

MODELS: dict[str, TrainableModel] = {
    model.kind: model
    for model in (
        TrainableModel(
            "heatmap",
            "keypoints of planar robots: a distribution over the next one, on a grid (the default)",
            TrainingOptions(steps=2000),
            _heatmap,
            (_ONLY_LIKE_ITS_DATA, "Keypoints closer to each other than a cell of its grid are not told apart."),
        ),
        TrainableModel(
            "sequential_regression",
            "keypoints: the paper's regression of the next one, states tiled to the scene's size",
            TrainingOptions(steps=8000, batch_size=256, learning_rate=1e-3, validate_every=200, patience=10),
            _regression,
            (_ONLY_LIKE_ITS_DATA, "A regression puts keypoints between those of ways that are equally good."),
        ),
        TrainableModel(
            PATH_CHAINS,
            "whole chains for arms, several at once, which seed the planner's trees (the default)",
            _PATH_OPTIONS,
            _path_chains,
            (
                _ONLY_LIKE_ITS_DATA,
                _MOSTLY_ENDS,
            ),
        ),
        TrainableModel(
            PATH_CHAINS + WITHOUT_SCENE,
            "the same without any look at the scene: a control, to tell what the scene is worth",
            _PATH_OPTIONS,
            _path_chains,
            ("A control: it knows start and goal alone.",),
        ),
        TrainableModel(
            "segment_cvae",
            "samples between two keypoints of planar robots, in their own frame (the default)",
            _SAMPLER_OPTIONS,
            _segment_sampler,
            (_ONLY_LIKE_ITS_DATA,),
        ),
        TrainableModel(
            "cvae",
            "samples between two keypoints, conditioned on them and the whole scene, as in the paper",
            _SAMPLER_OPTIONS,
            _scene_sampler,
            (_ONLY_LIKE_ITS_DATA,),
        ),
        TrainableModel(
            "cvae_shortest_path",
            "samples of whole paths without decomposition (Ichter et al. 2018), the paper's baseline",
            _SAMPLER_OPTIONS,
            _scene_sampler,
            (_ONLY_LIKE_ITS_DATA,),
        ),
    )
}
