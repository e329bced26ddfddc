"""Guidance of arms by whole paths: what networks see, what they propose, and the library."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import load_file
from typer.testing import CliRunner

from bsp_informed_planner.cli.app import app
from bsp_informed_planner.cli.train import TrainArguments, run_train
from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.errors import InvalidOptionError, KeypointsUnavailableError, ModelError, ModelMismatchError
from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.path_examples import PathExamples, PathObjective, tool_box
from bsp_informed_planner.networks.card import ModelCard, ModelRobot
from bsp_informed_planner.networks.path_chains import PathChains, Proposals
from bsp_informed_planner.networks.problem_view import ProblemView, ViewOptions, turns_about_vertical
from bsp_informed_planner.networks.registry import build_network
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import JointGoal, PlanningProblem, PlanOptions
from bsp_informed_planner.planning.worker import head_start_of
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.kinematic_chain import KinematicChain
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.sampling.chain_repair import ChainRepair
from bsp_informed_planner.sampling.guide import GuideSetting, make_guide
from bsp_informed_planner.sampling.path_chain_guide import PathChainGuide
from bsp_informed_planner.sampling.path_library import PathLibrary, PathLibraryGuide
from bsp_informed_planner.sampling.path_proposals import PathProposals
from bsp_informed_planner.sampling.path_shapes import path_of, resampled, shape_of
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene
from bsp_informed_planner.scene.signed_distance import SignedDistance

ARM = ur5()
OPTIONS = ViewOptions((-0.7, -0.8, -0.5), (0.9, 0.8, 0.9), spread=40, around=10, line=5)


@pytest.fixture(scope="module")
def shelves(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Paths of a few shelves, collected as the documentation says."""
    folder = tmp_path_factory.mktemp("shelves")
    words = f"collect --robot ur5 --paths-only --problems 40 --validation 8 --seed 3 --out {folder}"
    outcome = CliRunner().invoke(app, words.split())
    assert outcome.exit_code == 0, outcome.output
    return folder


@pytest.fixture(scope="module")
def experience(shelves: Path) -> Experience:
    return Experience.load(shelves, split="train", solved=True)


@pytest.fixture(scope="module")
def models(shelves: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network that has learned next to nothing, and a library."""
    folder = tmp_path_factory.mktemp("models")
    run_train(TrainArguments(shelves, "path_chains", folder, steps=30, batch_size=16, validate_every=10))
    run_train(TrainArguments(shelves, "path_library", folder))
    return folder


def setting_of(experience: Experience, models: Path, number: int = 0) -> GuideSetting:
    def never() -> object:
        raise AssertionError("whole paths need no decomposition")

    return GuideSetting(ARM, experience.scene(number), never, models=str(models))  # type: ignore[arg-type]


def random_path(rng: np.random.Generator, count: int) -> FloatArray:
    return rng.uniform(-2.0, 2.0, (count, 6))


# --- paths as shapes ---


@given(st.integers(0, 2**32), st.integers(2, 9))
@settings(max_examples=30, deadline=None)
def test_a_shape_is_the_path_again_between_its_own_ends(seed: int, count: int) -> None:
    path = random_path(np.random.default_rng(seed), count)
    again = path_of(shape_of(path, 30), path[0], path[-1])
    np.testing.assert_allclose(again, resampled(path, 32), atol=1e-12)
    reverse = path_of(shape_of(path, 30)[::-1], path[-1], path[0])
    np.testing.assert_allclose(reverse[::-1], again, atol=1e-12)


def test_shapes_of_many_paths_at_once() -> None:
    rng = np.random.default_rng(0)
    shapes, starts, goals = rng.normal(size=(2, 3, 4, 6)), rng.normal(size=(2, 1, 6)), rng.normal(size=(2, 1, 6))
    paths = path_of(shapes, starts, goals)
    assert paths.shape == (2, 3, 6, 6)
    np.testing.assert_array_equal(paths[1, 2], path_of(shapes[1, 2], starts[1, 0], goals[1, 0]))


# --- what networks see ---


def test_points_on_links_are_those_of_pinocchio() -> None:
    chain = KinematicChain.to_frame(ARM.model, ARM.model.getFrameId(ARM.tool_frame))
    states = np.random.default_rng(1).uniform(ARM.lower, ARM.upper, (20, 6))
    data = ARM.model.createData()
    for state, points in zip(states, chain.body_points(states), strict=True):
        pin.framesForwardKinematics(ARM.model, data, state)
        origins = [data.oMi[joint].translation for joint in range(1, 7)]
        origins.append(data.oMf[ARM.model.getFrameId(ARM.tool_frame)].translation)
        np.testing.assert_allclose(points[1::2], origins[1:], atol=1e-9)
        np.testing.assert_allclose(points[::2], 0.5 * (np.array(origins[1:]) + origins[:-1]), atol=1e-9)


def turned(scene: Scene, angle: float) -> Scene:
    turn = Pose.from_xyz_rpy([0.0, 0.0, 0.0], [0.0, 0.0, angle])
    obstacles = [Obstacle(o.id, o.shapes, turn * o.pose) for o in scene.obstacles.values()]
    return Scene.of(obstacles, scene.bounds, scene.frame)


@pytest.mark.parametrize("angle", [0.4, -1.1])
def test_a_turn_of_scene_and_first_joint_changes_nothing_but_the_azimuth(experience: Experience, angle: float) -> None:
    assert turns_about_vertical(ARM)
    assert not turns_about_vertical(PointRobot())
    view, scene, path = ProblemView(ARM, OPTIONS), experience.scene(0), experience.paths[0]
    before = view.conditions(SignedDistance(scene), path[:1], path[-1:])
    there = path[[0, -1]] + angle * np.eye(6)[0]
    after = view.conditions(SignedDistance(turned(scene, angle)), there[:1], there[1:])
    assert before.shape == (1, view.size)
    azimuth = 36
    assert (after - before)[0, azimuth] == pytest.approx(angle, abs=1e-5)
    rest = np.arange(view.size) != azimuth
    np.testing.assert_allclose(after[0, rest], before[0, rest], atol=1e-4)


def test_without_scene_nothing_is_seen_of_it(experience: Experience) -> None:
    path = experience.paths[0]
    blind = ProblemView(ARM, replace(OPTIONS, scene=False))
    conditions = [blind.conditions(SignedDistance(experience.scene(k)), path[:1], path[-1:])[0] for k in range(2)]
    np.testing.assert_array_equal(conditions[0], conditions[1])
    assert not conditions[0][37:].any()
    seeing = ProblemView(ARM, OPTIONS)
    assert seeing.size == blind.size
    assert seeing.conditions(SignedDistance(experience.scene(0)), path[:1], path[-1:])[0, 37:].std() > 0.1


def test_options_survive_their_card() -> None:
    assert ViewOptions.from_json(OPTIONS.to_json()) == OPTIONS
    with pytest.raises(InvalidOptionError):
        ViewOptions.from_json({"lower": [0, 0, 0], "colour": "red"})


# --- training ---


def test_examples_go_both_ways(experience: Experience) -> None:
    view = ProblemView(ARM, OPTIONS)
    few = experience.subset(np.arange(3))
    examples = PathExamples(few, view, 5, lambda done, total: None)
    assert len(examples) == 6
    batch = examples.batch(np.arange(6), None)
    assert batch["conditions"].shape == (6, view.size)
    for number in range(3):
        ahead, back = batch["shapes"][2 * number : 2 * number + 2].numpy()
        np.testing.assert_array_equal(back, ahead[::-1])
        np.testing.assert_allclose(ahead, shape_of(few.paths[number], 5), atol=1e-6)
        # The start of one direction is the goal of the other, turned by another azimuth.
        conditions = batch["conditions"][2 * number : 2 * number + 2].numpy()
        np.testing.assert_allclose(conditions[0, 1:6], conditions[1, 7:12], atol=2e-3)


def test_the_best_head_counts() -> None:
    class Fixed(PathChains):
        def forward(self, conditions: torch.Tensor) -> Proposals:
            shapes = torch.zeros(len(conditions), 2, 1, 2)
            shapes[:, 1] = 1.0
            return Proposals(shapes, torch.zeros(len(conditions), 2))

    objective = PathObjective(Fixed(3, 2, heads=2, waypoints=1, hidden=4, layers=1), np.array([2.0, 1.0]), 0.0, 0.0)
    terms = objective({"conditions": torch.zeros(1, 3), "shapes": torch.full((1, 1, 2), 0.9)})
    # 0.1 from the second head: the first joint counts twice as much.
    assert float(terms["loss"]) == pytest.approx(0.1**2 + 0.05**2, abs=1e-6)


def test_the_box_is_where_the_tool_is(experience: Experience) -> None:
    lower, upper = tool_box(experience, ARM)
    tools = ARM.reference_points(np.concatenate(list(experience.paths)))
    inside = ((tools[:, 2] > lower[2]) & (tools[:, 2] < upper[2])).mean()
    assert inside > 0.95
    assert upper[0] > 0.5  # the goal is straight ahead


# --- the network without torch ---


def test_it_computes_what_torch_computes(models: Path) -> None:
    network = build_network(ModelCard.read(models / "shelf_path_chains.json"))
    network.load_state_dict(load_file(models / "shelf_path_chains.safetensors"))
    network.eval()
    proposals = PathProposals.load(models / "shelf_path_chains.json")
    conditions = np.random.default_rng(0).normal(size=(5, len(proposals.mean))).astype(np.float32)
    shapes, logits = proposals.propose(conditions, 3)
    with torch.inference_mode():
        expected = network(torch.from_numpy(conditions))
    best = expected.logits.argsort(dim=1, descending=True)[:, :3].numpy()
    rows = np.arange(5)[:, None]
    np.testing.assert_allclose(shapes, expected.shapes.numpy()[rows, best], atol=1e-4)
    np.testing.assert_allclose(logits, expected.logits.numpy()[rows, best], atol=1e-4)
    every, _ = proposals.propose(conditions, 1000)
    assert every.shape[:2] == expected.logits.shape


def test_weights_that_do_not_fit_their_card_are_refused(models: Path, tmp_path: Path) -> None:
    card = ModelCard.read(models / "shelf_path_chains.json")
    weights = (models / "shelf_path_chains.safetensors").read_bytes()
    file = tmp_path / "other.safetensors"
    for change, reason in (({"heads": 7}, "other sizes"), ({"waypoints": None}, "waypoints|other sizes|int")):
        architecture = {k: v for k, v in {**card.architecture, **change}.items() if v is not None}
        replace(card, architecture=architecture).write(file.with_suffix(".json"))
        file.write_bytes(weights)
        with pytest.raises(ModelError, match=reason):
            PathProposals.load(file)
    card.write(file.with_suffix(".json"))
    file.write_bytes(weights[:5000])
    with pytest.raises(ModelError, match="cannot be read"):
        PathProposals.load(file)


# --- guides ---


@pytest.mark.parametrize("sampler_id", ["learned", "path_library"])
def test_chains_lead_from_start_to_goals_within_limits(sampler_id: str, models: Path, experience: Experience) -> None:
    setting = setting_of(experience, models)
    guide = make_guide(sampler_id, setting)
    path = experience.paths[0]
    goals = np.stack((path[-1], path[-1] + 0.1, path[-1] - 0.1))
    guidance = guide.guide(path[0], goals, BoundedChecker(ARM, setting.scene))
    assert guidance.sampler_id == sampler_id
    assert not guidance.fallback_reason
    assert 3 <= len(guidance.chains) <= 16
    for chain in guidance.chains:
        np.testing.assert_array_equal(chain.configurations[0], path[0])
        assert (chain.configurations[-1] == goals).all(axis=1).any()
        assert ((chain.configurations >= ARM.lower) & (chain.configurations <= ARM.upper)).all()
        np.testing.assert_allclose(chain.keypoints, ARM.reference_points(chain.configurations), atol=1e-12)
    assert guidance.sampler is not None
    samples = guidance.sampler.sample(np.random.default_rng(0), 50)
    assert samples.shape == (50, 6)


def test_chains_are_repaired_in_the_scene_unless_the_network_is_blind(models: Path, experience: Experience) -> None:
    setting, path = setting_of(experience, models), experience.paths[0]
    checker = BoundedChecker(ARM, setting.scene)
    model = PathProposals.load(models / "shelf_path_chains.json")
    blind = replace(model, card=replace(model.card, encoding={**model.card.encoding, "scene": False}))

    def chains(guide: PathChainGuide) -> FloatArray:
        found = guide.guide(path[0], path[-1:], checker).chains
        return np.array([chain.configurations for chain in found])

    proposed = PathChainGuide(setting, model).proposed(path[0], path[-1:])
    np.testing.assert_array_equal(chains(PathChainGuide(setting, model, repair=False)), proposed)
    assert np.abs(chains(PathChainGuide(setting, model)) - proposed).max() > 1e-3
    unseen = PathChainGuide(setting, blind)
    np.testing.assert_array_equal(chains(unseen), unseen.proposed(path[0], path[-1:]))


def test_paths_of_the_library_are_repaired_in_the_scene(models: Path, experience: Experience) -> None:
    setting, path = setting_of(experience, models), experience.paths[0]
    library = PathLibrary.of(ARM, list(experience.paths)[1:])
    checker = BoundedChecker(ARM, setting.scene)
    nearest = library.nearest(path[0], path[-1:], 5)

    def chains(repair: bool) -> FloatArray:
        found = PathLibraryGuide(setting, library, 5, repair).guide(path[0], path[-1:], checker).chains
        return np.array([chain.configurations for chain in found])

    np.testing.assert_array_equal(chains(False), nearest)
    expected = ChainRepair(ARM, setting.scene).repaired(nearest, checker)
    assert np.abs(expected - nearest).max() > 1e-3
    np.testing.assert_array_equal(chains(True), expected)


def test_networks_of_another_view_are_refused(models: Path, experience: Experience) -> None:
    model = PathProposals.load(models / "shelf_path_chains.json")
    encoding = {**model.card.encoding, "spread": 17}
    with pytest.raises(ModelMismatchError, match="length of a condition"):
        PathChainGuide(setting_of(experience, models), replace(model, card=replace(model.card, encoding=encoding)))


@pytest.mark.parametrize("sampler_id", ["learned", "path_library"])
def test_the_planner_plans_with_them(sampler_id: str, models: Path, experience: Experience) -> None:
    number = int(np.argmax([len(path) for path in experience.paths]))
    path = experience.paths[number]
    planner = Planner(ARM, experience.scene(number), models=str(models))
    options = PlanOptions("rrt_connect", sampler_id, allowed_seconds=20.0, first_solution=True, head_start=0, seed=1)
    result = planner.plan(PlanningProblem(path[0], [JointGoal(path[-1])]), options)
    assert result.guidance.sampler_id == sampler_id
    assert result.guidance.chains


def test_guidance_that_comes_quickly_is_asked_for_sooner() -> None:
    exact = head_start_of("keypoint_tube", ARM)
    for sampler_id in ("learned", "path_library"):
        assert 0 < head_start_of(sampler_id, ARM) < exact
        assert head_start_of(sampler_id, PointRobot()) == exact  # its networks take longer than that


# --- the library ---


def library_of(count: int, capacity: int = 50, seed: int = 0) -> tuple[PathLibrary, list[FloatArray]]:
    rng = np.random.default_rng(seed)
    paths = [random_path(rng, 4) for _ in range(count)]
    return PathLibrary.of(ARM, paths, 10, capacity), paths


def test_it_finds_what_it_holds_whatever_the_azimuth() -> None:
    library, paths = library_of(20)
    turn = 0.7 * np.eye(6)[0]
    found = library.nearest(paths[3][0] + turn, (paths[3][-1] + turn)[None], 3)
    assert found.shape == (3, 12, 6)
    np.testing.assert_allclose(found[0], resampled(paths[3] + turn, 12), atol=1e-9)
    np.testing.assert_array_equal(found[1:, -1], [paths[3][-1] + turn] * 2)


def test_it_looks_for_all_goals() -> None:
    library, paths = library_of(20)
    goals = np.stack((paths[3][-1] + 0.3, paths[3][-1]))
    np.testing.assert_array_equal(library.nearest(paths[3][0], goals, 1)[0, -1], goals[1])


def test_it_grows_and_forgets_the_oldest() -> None:
    library, paths = library_of(20, capacity=30)
    rng = np.random.default_rng(5)
    fresh = [random_path(rng, 3) for _ in range(300)]
    library.add(fresh[0])
    assert len(library) == 21
    np.testing.assert_allclose(
        library.nearest(fresh[0][0], fresh[0][-1:], 2)[0], resampled(fresh[0], 12), atol=1e-9
    )  # before it is in the index
    for path in fresh[1:]:
        library.add(path)
    assert len(library) <= 30 + 256
    newest = library.nearest(fresh[-1][0], fresh[-1][-1:], 1)[0]
    np.testing.assert_allclose(newest, resampled(fresh[-1], 12), atol=1e-9)
    forgotten = library.nearest(paths[0][0], paths[0][-1:], 1)[0]
    assert np.abs(forgotten - resampled(paths[0], 12)).max() > 0.05


def test_it_begins_empty(experience: Experience, models: Path) -> None:
    library, _ = library_of(0)
    guide = PathLibraryGuide(setting_of(experience, models), library)
    path = experience.paths[0]
    checker = BoundedChecker(ARM, experience.scene(0))
    with pytest.raises(KeypointsUnavailableError, match="no paths"):
        guide.guide(path[0], path[-1:], checker)
    guide.learn(path)
    assert len(guide.guide(path[0], path[-1:], checker).chains) == 1


def test_plans_that_succeed_are_learned(models: Path, experience: Experience, tmp_path: Path) -> None:
    for file in models.glob("shelf_path_library.*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    planner = Planner(ARM, experience.scene(0), models=str(tmp_path))
    guide = planner._guides.get("path_library")
    assert isinstance(guide, PathLibraryGuide)
    before = len(guide._library)
    path = experience.paths[0]
    options = PlanOptions("rrt_connect", "path_library", allowed_seconds=20.0, first_solution=True, seed=1)
    planner.plan(PlanningProblem(path[0], [JointGoal(path[-1])]), options)
    assert len(guide._library) == before + 1


def test_it_survives_its_file_and_damage_is_named(tmp_path: Path) -> None:
    library, paths = library_of(20)
    identity = ModelRobot(ARM.name, tuple(ARM.joint_names), 3, ARM.tool_frame)
    file = library.save(ModelCard("some_library", "path_library", {}, {}, identity), tmp_path)
    again = PathLibrary.load(file, ARM)
    assert len(again) == 20
    found = again.nearest(paths[3][0], paths[3][-1:], 1)[0]
    np.testing.assert_allclose(found, resampled(paths[3], 12), atol=5e-3)  # half precision
    file.write_bytes(file.read_bytes()[:500])
    with pytest.raises(ModelError, match="cannot be read"):
        PathLibrary.load(file, ARM)
    with pytest.raises(InvalidOptionError):
        PathLibrary(ARM, np.zeros((3, 12)), np.zeros((2, 10, 6)))
