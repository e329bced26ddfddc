"""The models that come with the package: complete, small, and good for something."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from bsp_informed_planner.benchmarks.maze.world import MazeWorld
from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.networks.card import SHIPPED, ModelCard
from bsp_informed_planner.networks.registry import load_model, shipped_models
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem_with_goals
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.sampling.guide import GUIDES, GuideSetting, make_guide
from bsp_informed_planner.sampling.keypoint_estimation import SceneView, estimator_of
from bsp_informed_planner.sampling.models import find_model
from bsp_informed_planner.sampling.path_shapes import straight

#: Seeds of no training: those begin with a bit for their split, or are below this.
UNSEEN = 2**50


def test_they_are_small_and_their_cards_say_how_to_make_them() -> None:
    files = sorted(SHIPPED.iterdir())
    assert sum(file.stat().st_size for file in files) <= 10e6
    assert shipped_models()
    for name in shipped_models():
        card = ModelCard.read(SHIPPED / f"{name}.json")
        assert card.training["command"].startswith("bsp-planner train ")
        assert card.data["collection_seed"] >= 0
        assert card.versions["torch"]


#: Those that torch runs.
NETWORKS = [name for name in shipped_models() if name.split("_", 1)[1] not in ("gmm", "path_library", "path_chains")]


@pytest.mark.parametrize("name", NETWORKS)
def test_they_can_be_loaded_by_name(name: str) -> None:
    model = load_model(name)
    assert model.card.name == name
    assert sum(parameter.numel() for parameter in model.network.parameters()) == model.card.parameters


def test_chains_in_unseen_mazes_are_mostly_usable() -> None:
    """Loose bounds on a few mazes; the benchmark of the networks measures."""
    model = find_model(MazeWorld.robot, ("heatmap",))
    plain = best = 0
    mazes = 25
    for number in range(mazes):
        world = MazeWorld.random(np.random.default_rng(UNSEEN + number))
        view = SceneView.of(world.scene, model)
        chains = estimator_of(model).chains(view, world.start, world.goal, 16, np.random.default_rng(number))
        verdicts = [world.judge(chain.configurations, chain.reached) for chain in chains]
        plain += verdicts[0].usable
        best += any(verdict.usable for verdict in verdicts)
    assert plain >= 0.6 * mazes
    assert best >= 0.85 * mazes


@pytest.mark.parametrize("sampler_id", sorted(set(GUIDES) - {"path_library"}))
def test_every_guide_works_in_a_maze_as_it_comes(sampler_id: str) -> None:
    world = MazeWorld.random(np.random.default_rng(UNSEEN + 100))
    guidance = make_guide(sampler_id, world.setting()).guide(world.start, world.goal[None], world.checker)
    assert guidance.sampler_id == sampler_id
    assert guidance.sampler is not None
    samples = guidance.sampler.sample(np.random.default_rng(0), 500)
    assert ((samples >= 0.0) & (samples <= 1.0)).all()
    if sampler_id != "gmm":  # which draws where similar places are, be they on the way or not
        nearest = np.linalg.norm(world.shortest_path[:, None] - samples[None], axis=2).min(axis=1)
        assert nearest.max() < 0.2


@pytest.mark.parametrize("sampler_id", sorted(GUIDES))
def test_every_guide_works_in_a_shelf_as_it_comes(sampler_id: str) -> None:
    arm = ur5()
    problem, goals = random_shelf_problem_with_goals(arm, np.random.default_rng(UNSEEN))
    setting = GuideSetting(arm, problem.scene, lambda: decompose(problem.scene))
    guidance = make_guide(sampler_id, setting).guide(problem.start, goals, BoundedChecker(arm, problem.scene))
    assert guidance.sampler_id == sampler_id
    assert not guidance.fallback_reason
    assert guidance.sampler is not None
    samples = guidance.sampler.sample(np.random.default_rng(0), 200)
    assert ((samples >= arm.lower) & (samples <= arm.upper)).all()
    assert bool(guidance.chains) == (sampler_id not in ("gmm", "cvae_shortest_path"))


def test_chains_in_unseen_shelves_are_mostly_free_edges() -> None:
    """Loose bounds on a few shelves; `bsp-planner evaluate` measures."""
    arm, rng = ur5(), np.random.default_rng(UNSEEN + 1)
    shares: dict[str, list[float]] = {"learned": [], "line": []}
    for _ in range(12):
        problem, goals = random_shelf_problem_with_goals(arm, rng)
        checker = BoundedChecker(arm, problem.scene)
        setting = GuideSetting(arm, problem.scene, functools.partial(decompose, problem.scene))
        chains = make_guide("learned", setting).guide(problem.start, goals[:1], checker).chains
        edges = np.concatenate([checker.surely_free_edges(chain.configurations) for chain in chains])
        shares["learned"].append(float(edges.mean()))
        line = straight(problem.start, goals[0], 14)
        shares["line"].append(float(checker.surely_free_edges(line).mean()))
    learned, line_share = (float(np.mean(shares[name])) for name in ("learned", "line"))
    assert learned > max(0.5, line_share - 0.05)
