"""Algorithm 3 online: estimated chains, local samplers, fallbacks."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from maze_experience import write_maze_experience
from safetensors.numpy import load_file, save_file

from bsp_informed_planner.cli.train import TrainArguments, run_train
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.graph import shortest_chain
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import (
    InvalidOptionError,
    KeypointsUnavailableError,
    MissingPackageError,
    ModelError,
    ModelMismatchError,
    ModelUnavailableError,
    UnknownSamplerError,
)
from bsp_informed_planner.networks.cvae import Cvae
from bsp_informed_planner.networks.keypoint_heatmap import KeypointHeatmap
from bsp_informed_planner.networks.registry import Model, load_model
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import JointGoal, PlanningProblem, PlanOptions
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.sampling.cvae_sampler import CvaeMixture, cvae_sampler
from bsp_informed_planner.sampling.guide import GUIDES, GuideSetting, make_guide
from bsp_informed_planner.sampling.keypoint_estimation import (
    EstimatedChain,
    EstimationOptions,
    SceneView,
    estimator_of,
    sequential_chains,
)
from bsp_informed_planner.sampling.learned_guide import LearnedGuide, LearnedGuideOptions, best_free_chain
from bsp_informed_planner.sampling.models import find_model, require_sound_models
from bsp_informed_planner.sampling.scene_guides import SceneGuides, load_guide
from bsp_informed_planner.scene.maze import MazeProblem, random_maze
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene
from bsp_informed_planner.scene.shapes import Box

KINDS = ("heatmap", "sequential_regression", "segment_cvae", "cvae", "cvae_shortest_path")


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Models that have learned next to nothing."""
    folder = tmp_path_factory.mktemp("models")
    write_maze_experience(folder / "mazes", training=8, validation=2)
    for kind in KINDS:
        run_train(TrainArguments(folder / "mazes", kind, folder / kind, steps=2, batch_size=4, validate_every=2))
        for file in (folder / kind).glob("maze_*"):
            file.rename(folder / file.name)
    return folder


@pytest.fixture(scope="module")
def maze() -> MazeProblem:
    return random_maze(np.random.default_rng(5))


def setting_of(maze: MazeProblem, models: Path) -> GuideSetting:
    decomposition = decompose(maze.scene, DecompositionOptions(dimension=2))
    return GuideSetting(PointRobot(), maze.scene, lambda: decomposition, models=str(models))


def load(models: Path, kind: str) -> Model:
    return load_model(models / f"maze_{kind}.safetensors")


# --- the loop of Algorithm 3 ---


def test_chains_end_within_delta_of_the_target() -> None:
    def halfway(currents: FloatArray, numbers: np.ndarray) -> FloatArray:
        return 0.5 * (currents + np.array([1.0, 0.0]))

    chains = sequential_chains(halfway, np.zeros(2), np.array([1.0, 0.0]), 3, EstimationOptions(delta=0.1))
    for points, reached in chains:
        assert reached
        np.testing.assert_allclose(points[:, 0], [0.0, 0.5, 0.75, 0.875, 1.0])


def test_chains_of_different_lengths_and_one_that_never_arrives() -> None:
    steps = np.array([[0.5], [0.25], [-0.1]])

    def move(currents: FloatArray, numbers: np.ndarray) -> FloatArray:
        # Chains that have ended are not asked about again.
        assert len(currents) == len(numbers)
        assert (currents < 0.99).all()
        return currents + steps[numbers]

    options = EstimationOptions(delta=0.01, max_keypoints=6)
    chains = sequential_chains(move, np.zeros(1), np.ones(1), 3, options)
    assert [reached for _, reached in chains] == [True, True, False]
    assert [len(points) for points, _ in chains] == [3, 5, 7]
    assert chains[0][0][-1, 0] == 1.0


def test_a_start_at_the_target_takes_no_network() -> None:
    def never(currents: FloatArray, numbers: np.ndarray) -> FloatArray:
        raise AssertionError(currents)

    chains = sequential_chains(never, np.zeros(2), np.full(2, 0.01), 2, EstimationOptions())
    assert all(reached and len(points) == 2 for points, reached in chains)


def test_estimation_options_are_checked() -> None:
    for wrong in ({"delta": 0.0}, {"temperature": -1.0}, {"max_keypoints": 0}):
        with pytest.raises(InvalidOptionError):
            EstimationOptions(**wrong)


# --- estimators ---


def test_the_first_chain_of_a_heatmap_is_its_likeliest_and_the_others_are_drawn(
    models: Path, maze: MazeProblem
) -> None:
    model = load(models, "heatmap")
    view = SceneView.of(maze.scene, model)
    estimator = estimator_of(model, EstimationOptions(max_keypoints=4))
    first = estimator.chains(view, maze.start, maze.goal, 5, np.random.default_rng(0))
    second = estimator.chains(view, maze.start, maze.goal, 5, np.random.default_rng(1))
    again = estimator.chains(view, maze.start, maze.goal, 5, np.random.default_rng(0))
    np.testing.assert_array_equal(first[0].configurations, second[0].configurations)
    assert not np.array_equal(first[1].configurations, second[1].configurations)
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.configurations, other.configurations)
    for chain in first:
        np.testing.assert_array_equal(chain.configurations[0], maze.start)
        steps = np.linalg.norm(np.diff(chain.configurations, axis=0), axis=1)
        assert (steps > 0.0).all()  # a keypoint where one is already is no step


def test_draws_follow_the_distribution_of_the_network(models: Path, maze: MazeProblem) -> None:
    model = load(models, "heatmap")
    view = SceneView.of(maze.scene, model)
    network = model.network
    assert isinstance(network, KeypointHeatmap)
    with torch.inference_mode():
        fields = network(torch.from_numpy(view.values)[None], torch.from_numpy(maze.goal.astype(np.float32))[None])
        start = torch.from_numpy(maze.start.astype(np.float32))[None, None]
        logits = network.logits(fields, start)[0, 0].double().numpy()
        places = network.keypoints(fields)[0].double().numpy()
    logits[np.linalg.norm(places - maze.start, axis=1) < 1.0 / network.cells] = -np.inf
    expected = np.exp(logits - logits.max())
    expected /= expected.sum()
    estimator = estimator_of(model, EstimationOptions(max_keypoints=1))
    chains = estimator.chains(view, maze.start, maze.goal, 20_001, np.random.default_rng(0))[1:]
    drawn = np.array([chain.configurations[1] for chain in chains])
    # Means of the places, since single cells are drawn too rarely to be counted.
    np.testing.assert_allclose(drawn.mean(axis=0), expected @ places, atol=0.02)


def test_a_regression_has_one_chain(models: Path, maze: MazeProblem) -> None:
    model = load(models, "sequential_regression")
    chains = estimator_of(model).chains(
        SceneView.of(maze.scene, model), maze.start, maze.goal, 16, np.random.default_rng(0)
    )
    assert len(chains) == 1


def test_estimators_are_made_of_keypoint_models_only(models: Path) -> None:
    with pytest.raises(ModelMismatchError, match="heatmap"):
        estimator_of(load(models, "cvae"))


# --- local samplers ---


def test_a_mixture_draws_from_each_condition_by_its_weight() -> None:
    """A decoder that returns its condition: the shares of the samples are the weights."""
    network = Cvae(2, 2, latent_size=1, hidden=4, layers=1)
    with torch.no_grad():
        for parameter in network.decoder.parameters():
            parameter.zero_()
        hidden, output = (layer for layer in network.decoder if isinstance(layer, torch.nn.Linear))
        hidden.weight[:2, 1:] = torch.eye(2)
        output.weight[:, :2] = torch.eye(2)
    conditions = np.array([[0.1, 0.2], [0.7, 0.9]], np.float32)

    def identity(states: FloatArray, members: np.ndarray) -> FloatArray:
        return states + 0.0 * members[:, None]

    mixture = CvaeMixture(network, conditions, np.array([3.0, 1.0]), identity, np.zeros(2), np.array([1.0, 0.5]))
    samples = mixture.sample(np.random.default_rng(0), 4000)
    first = np.isclose(samples, [0.1, 0.2], atol=1e-6).all(axis=1)
    second = np.isclose(samples, [0.7, 0.5], atol=1e-6).all(axis=1)  # clipped to the limits
    assert (first | second).all()
    assert 0.72 < first.mean() < 0.78
    assert not (np.sort(first)[::-1] == first).all()  # shuffled


@pytest.mark.parametrize("kind", ["segment_cvae", "cvae", "cvae_shortest_path"])
def test_samplers_of_models(kind: str, models: Path, maze: MazeProblem) -> None:
    chain = np.array([maze.start, [0.5, 0.5], maze.goal])
    pairs = list(zip(chain[:-1], chain[1:], strict=True))
    sampler = cvae_sampler(load(models, kind), maze.scene, None, pairs, np.zeros(2), np.ones(2))
    samples = sampler.sample(np.random.default_rng(0), 50)
    assert samples.shape == (50, 2)
    assert np.isfinite(samples).all()
    np.testing.assert_array_equal(samples, sampler.sample(np.random.default_rng(0), 50))


# --- guides ---


def test_the_best_chain_is_the_shortest_free_one(maze: MazeProblem) -> None:
    checker = ExactChecker(PointRobot(), maze.scene)
    decomposition = decompose(maze.scene, DecompositionOptions(dimension=2))
    free = shortest_chain(decomposition, maze.start, maze.goal).points[:, :2]
    back = np.concatenate((free[:2], free[:1], free))
    blocked = np.stack((maze.start, maze.goal))
    chains = [EstimatedChain(points, True) for points in (back, blocked, free)] + [EstimatedChain(free[:-1], False)]
    best = best_free_chain(chains, checker, lambda: False)
    assert best is chains[2]
    assert best_free_chain(chains[1:2], checker, lambda: False) is None
    assert best_free_chain(chains, checker, lambda: True) is None


def test_networks_that_have_learned_nothing_fall_back_to_exact_keypoints(models: Path, maze: MazeProblem) -> None:
    guide = make_guide("learned", setting_of(maze, models))
    checker = ExactChecker(PointRobot(), maze.scene)
    guidance = guide.guide(maze.start, maze.goal[None], checker)
    assert guidance.sampler_id == "learned"
    assert guidance.fallback_reason.startswith("exact keypoints: of 16 chains of model 'maze_heatmap'")
    assert guidance.sampler is not None
    assert len(guidance.chains) >= 1
    for chain in guidance.chains[:1]:
        edges = zip(chain.configurations[:-1], chain.configurations[1:], strict=True)
        assert all(checker.is_edge_free(a, b) for a, b in edges)
        assert chain.keypoints.shape == (len(chain.configurations), 3)
    assert guidance.sampler.sample(np.random.default_rng(0), 10).shape == (10, 2)


def test_without_fallback_and_without_a_chain_it_says_so(models: Path, maze: MazeProblem) -> None:
    guide = LearnedGuide(
        setting_of(maze, models), load(models, "sequential_regression"), None, LearnedGuideOptions(fallback=False)
    )
    with pytest.raises(KeypointsUnavailableError, match="maze_sequential_regression"):
        guide.guide(maze.start, maze.goal[None], ExactChecker(PointRobot(), maze.scene))


def test_chains_are_shared_out_to_the_nearest_goals(models: Path, maze: MazeProblem) -> None:
    guide = LearnedGuide(
        setting_of(maze, models), load(models, "heatmap"), None, LearnedGuideOptions(chain_count=7, goal_count=2)
    )
    goals = np.array([maze.start + 0.4, maze.start + 0.005, maze.start + 0.01])
    chains = guide.estimated(maze.start, goals)
    assert len(chains) == 7
    ends = {tuple(chain.configurations[-1]) for chain in chains}
    assert ends == {tuple(goals[1]), tuple(goals[2])}


def test_the_baseline_of_shortest_paths_has_no_chains(models: Path, maze: MazeProblem) -> None:
    guide = make_guide("cvae_shortest_path", setting_of(maze, models))
    guidance = guide.guide(maze.start, maze.goal[None], ExactChecker(PointRobot(), maze.scene))
    assert not guidance.chains
    assert guidance.sampler is not None
    assert not guidance.fallback_reason


def test_guides_by_their_ids(models: Path, maze: MazeProblem) -> None:
    setting = setting_of(maze, models)
    assert next(iter(GUIDES)) == "keypoint_tube"
    assert set(GUIDES) >= {"learned", "cvae_shortest_path", "gmm"}
    exact = make_guide("keypoint_tube", setting).guide(
        maze.start, maze.goal[None], ExactChecker(PointRobot(), maze.scene)
    )
    assert exact.chains
    with pytest.raises(UnknownSamplerError, match="learned"):
        make_guide("oracle", setting)


def test_a_robot_without_a_model_gets_exact_keypoints(maze: MazeProblem, tmp_path: Path) -> None:
    guides = SceneGuides(setting_of(maze, tmp_path))
    for sampler_id, kind in (
        ("learned", "path_chains or heatmap"),
        ("cvae_shortest_path", "cvae_shortest_path"),
        ("gmm", "gmm"),
    ):
        with pytest.raises(ModelUnavailableError, match=kind):
            guides.get(sampler_id)
        guidance = guides.guide(sampler_id, maze.start, maze.goal[None], ExactChecker(PointRobot(), maze.scene))
        assert guidance.sampler_id == "keypoint_tube"
        assert guidance.chains
        assert guidance.fallback_reason.startswith(f"{sampler_id}: no model of kind {kind}")
    with pytest.raises(UnknownSamplerError):
        guides.guide("oracle", maze.start, maze.goal[None], ExactChecker(PointRobot(), maze.scene))


def test_without_a_model_and_without_keypoints_samples_are_uniform(maze: MazeProblem, tmp_path: Path) -> None:
    """A wall from end to end: no chain at all."""
    wall = Obstacle(
        "wall",
        ((Box(np.array([0.05, 2.0, 0.2])), Pose.identity()),),
        Pose(np.array([0.5, 0.5, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])),
    )
    scene = Scene.of([wall], maze.scene.bounds)
    decomposition = decompose(scene, DecompositionOptions(dimension=2))
    guides = SceneGuides(GuideSetting(PointRobot(), scene, lambda: decomposition, models=str(tmp_path)))
    guidance = guides.guide("learned", np.array([0.1, 0.5]), np.array([[0.9, 0.5]]), ExactChecker(PointRobot(), scene))
    assert (guidance.sampler_id, guidance.chains, guidance.sampler) == ("uniform", (), None)
    assert "learned: no model" in guidance.fallback_reason
    assert "no keypoints" in guidance.fallback_reason


def test_guides_are_made_once_for_a_scene(models: Path, maze: MazeProblem) -> None:
    guides = SceneGuides(setting_of(maze, models))
    assert guides.get("learned") is guides.get("learned")
    reasons = {name: load_guide(name, PointRobot(), str(models)) for name in GUIDES}
    assert reasons["gmm"] == f"gmm: no model of kind gmm for robot 'point' in {models}"
    assert [name for name, reason in reasons.items() if reason] == ["gmm", "path_library"]


def test_what_is_damaged_is_named_before_it_is_used(models: Path, tmp_path: Path) -> None:
    assert set(require_sound_models()) >= {"maze_heatmap", "maze_segment_cvae"}
    with pytest.raises(ModelError, match="no folder"):
        require_sound_models(tmp_path / "missing")
    for file in models.glob("maze_cvae.*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    assert require_sound_models(tmp_path) == ("maze_cvae",)
    weights = tmp_path / "maze_cvae.safetensors"
    whole = weights.read_bytes()
    weights.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ModelError, match=r"maze_cvae\.safetensors: cannot be read"):
        require_sound_models(tmp_path)
    arrays = load_file(models / "maze_cvae.safetensors")
    next(iter(arrays.values())).flat[0] = np.nan
    save_file(arrays, weights)
    with pytest.raises(ModelError, match="not finite"):
        require_sound_models(tmp_path)


def test_a_missing_package_is_named(maze: MazeProblem, models: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = "bsp_informed_planner.sampling.learned_guide"
    monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "bsp_informed_planner.sampling.cvae_sampler")
    guides = SceneGuides(setting_of(maze, models))
    with pytest.raises(MissingPackageError, match="torch"):
        guides.get("learned")
    guidance = guides.guide("learned", maze.start, maze.goal[None], ExactChecker(PointRobot(), maze.scene))
    assert guidance.sampler_id == "keypoint_tube"
    assert "torch" in guidance.fallback_reason


# --- the planner ---


@pytest.mark.parametrize("sampler_id", ["learned", "cvae_shortest_path", "gmm"])
def test_plans_with_shipped_models(sampler_id: str) -> None:
    maze = random_maze(np.random.default_rng(2**50 + 3))
    planner = Planner(PointRobot(), maze.scene)
    options = PlanOptions("rrt_star", sampler_id, allowed_seconds=20.0, first_solution=True, max_samples=3000, seed=1)
    result = planner.plan(PlanningProblem(maze.start, [JointGoal(maze.goal)]), options)
    assert result.guidance.sampler_id == sampler_id
    assert result.guidance.sampler is not None
    assert bool(result.guidance.chains) == (sampler_id == "learned")


def test_a_plan_with_a_model_that_is_missing_says_why(tmp_path: Path, maze: MazeProblem) -> None:
    planner = Planner(PointRobot(), maze.scene, models=str(tmp_path))
    options = PlanOptions("rrt_star", "learned", allowed_seconds=20.0, first_solution=True, seed=1)
    result = planner.plan(PlanningProblem(maze.start, [JointGoal(maze.goal)]), options)
    assert result.guidance.sampler_id == "keypoint_tube"
    assert "no model of kind path_chains or heatmap" in result.guidance.fallback_reason


def test_a_robot_without_a_model_is_named(models: Path, maze: MazeProblem) -> None:
    with pytest.raises(ModelUnavailableError, match="robot 'ur5"):
        find_model(ur5(), ("heatmap",), models)
    first = find_model(PointRobot(), ("cvae", "heatmap"), models)
    assert first.card.kind == "cvae"
    assert find_model(PointRobot(), ("cvae",), models) is first  # read once


def test_guide_options_are_checked() -> None:
    for wrong in ({"chain_count": 0}, {"goal_count": 0}, {"local_sampler": "oracle"}):
        with pytest.raises(InvalidOptionError):
            LearnedGuideOptions(**wrong)
