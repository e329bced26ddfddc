"""Local primitives, and the Gaussian mixtures made from them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from maze_experience import write_maze_experience

from bsp_informed_planner.cli.train import TrainArguments, run_train
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import InvalidOptionError, KeypointsUnavailableError, ModelError
from bsp_informed_planner.networks.card import SHIPPED
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.sampling.gmm import GaussianMixture, GmmOptions, PrimitiveDatabase
from bsp_informed_planner.sampling.guide import GuideSetting, make_guide
from bsp_informed_planner.sampling.local_primitives import LocalPrimitives
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import (
    Box,
    Cone,
    ConvexMesh,
    Cylinder,
    HalfSpace,
    PointCloud,
    Shape,
    Sphere,
)
from bsp_informed_planner.scene.shelf import random_shelf

BOUNDS = WorkspaceBounds(-np.ones(3), np.ones(3))


def scene_of(*placed: tuple[Shape, Pose]) -> Scene:
    return Scene.of([Obstacle.of(f"{index}", shape, pose) for index, (shape, pose) in enumerate(placed)], BOUNDS)


def pair(shift: float = 0.0, turn: float = 0.0, width: float = 0.2) -> LocalPrimitives:
    """Two boxes with a gap of 0.1 m along x."""
    box = Box(np.array([width, 0.3, 0.4]))
    left = Pose.from_xyz_rpy([-0.15 + shift, 0.0, 0.0], [0.0, 0.0, turn])
    right = Pose.from_xyz_rpy([0.15 + shift, 0.0, 0.0], [0.0, 0.0, 0.0])
    return LocalPrimitives.of(scene_of((box, left), (box, right)), 0.2)


def test_pairs_that_are_close() -> None:
    box = Box(np.array([0.2, 0.2, 0.2]))
    scene = scene_of(*((box, Pose.from_xyz_rpy([x, 0.0, 0.0])) for x in (-0.6, -0.3, 0.5)))
    primitives = LocalPrimitives.of(scene, 0.15)
    assert len(primitives) == 1
    np.testing.assert_allclose(sorted(primitives.centres[0, :, 0]), [-0.6, -0.3])
    assert len(LocalPrimitives.of(scene, 5.0)) == 3
    assert not len(LocalPrimitives.of(scene_of((box, Pose.identity())), 1.0))


def test_every_shape_has_a_box_but_planes() -> None:
    shapes: list[Shape] = [
        Sphere(0.1),
        Cylinder(0.1, 0.2),
        Cone(0.1, 0.2),
        ConvexMesh(np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])),
        PointCloud(np.array([[0.01, 0.01, 0.01]]), 0.02),
        HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0),
    ]
    primitives = LocalPrimitives.of(scene_of(*((shape, Pose.identity()) for shape in shapes)), 1.0)
    assert len(primitives) == 10  # of five boxes
    assert primitives.halves.max() == pytest.approx(0.1)


def test_distances_between_primitives() -> None:
    one = pair()
    assert one.nearest_distances(one)[0] == pytest.approx(0.0, abs=1e-7)
    assert one.nearest_distances(pair(shift=0.1))[0] == pytest.approx(0.75 * 0.1)
    # One of the two boxes is turned; half a turn is none.
    assert one.nearest_distances(pair(turn=0.3))[0] == pytest.approx(0.25 * 0.15)
    assert one.nearest_distances(pair(turn=np.pi))[0] == pytest.approx(0.0, abs=1e-6)
    assert one.nearest_distances(pair(width=0.16))[0] == pytest.approx(0.75 * 0.02)
    swapped = LocalPrimitives(one.centres[:, ::-1], one.halves[:, ::-1], one.rotations[:, ::-1])
    assert one.nearest_distances(swapped)[0] == pytest.approx(0.0, abs=1e-7)
    assert np.isinf(one.nearest_distances(pair(shift=0.1), 0.07)[0])
    nothing = one.selected(np.zeros(1, dtype=bool))
    assert np.isinf(nothing.nearest_distances(one)[0])
    assert not len(one.nearest_distances(nothing))


def plain_distances(ours: LocalPrimitives, others: LocalPrimitives) -> np.ndarray:
    """(p, q) between all primitives, by the definition."""
    half_turns = np.array([np.diag(signs) for signs in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))])
    found = np.full((len(ours), len(others)), np.inf)
    for order in ([0, 1], [1, 0]):
        moved = np.linalg.norm(ours.centres[:, None] - others.centres[None, :, order], axis=3)
        moved += np.linalg.norm(ours.halves[:, None] - others.halves[None, :, order], axis=3)
        traces = np.einsum("pbij,qbik,skj->pqbs", ours.rotations, others.rotations[:, order], half_turns)
        angles = np.arccos(np.clip(0.5 * (traces.max(axis=3) - 1.0), -1.0, 1.0))
        found = np.minimum(found, 0.75 * moved.mean(axis=2) + 0.25 * angles.mean(axis=2))
    return found


def shelf_scene(seed: int) -> Scene:
    return random_shelf(np.random.default_rng(seed)).scene


def maze_scene(seed: int) -> Scene:
    return random_maze(np.random.default_rng(seed)).scene


@pytest.mark.parametrize(("model", "scene_of_seed"), [("shelf_gmm", shelf_scene), ("maze_gmm", maze_scene)])
def test_retrieval_is_that_of_the_definition(model: str, scene_of_seed: Callable[[int], Scene]) -> None:
    database = PrimitiveDatabase.load(SHIPPED / f"{model}.safetensors")
    for seed in range(3):
        primitives = LocalPrimitives.of(scene_of_seed(seed), database.options.reach)
        plain = plain_distances(primitives, database.primitives).min(axis=0)
        found = database.primitives_near(primitives)
        near = np.flatnonzero(plain < database.options.radius)
        assert set(found.tolist()) == set(near.tolist())
        assert len(found) > 0
        np.testing.assert_allclose(plain[found], np.sort(plain[near]), atol=1e-9)


def test_waypoints_near_both_boxes() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.3, 0.0], [-0.4, 0.0, 0.0]])
    np.testing.assert_array_equal(pair().near(points, 0.2)[0], [True, True, False])


def test_retrieval_finds_waypoints_of_similar_places_only() -> None:
    options = GmmOptions(reach=0.2, radius=0.1)
    here = (pair(), np.array([[0.0, 0.1], [0.9, 0.9]]), np.array([[0.0, 0.0, 0.0], [0.9, 0.9, 0.0]]))
    there = (pair(shift=0.5), np.array([[5.0, 5.0]]), np.array([[0.5, 0.0, 0.0]]))
    unused = (pair(shift=0.05), np.array([[7.0, 7.0]]), np.array([[-0.9, -0.9, 0.0]]))
    database = PrimitiveDatabase.of([here, there, unused], 2, options)
    assert len(database.primitives) == 2
    np.testing.assert_array_equal(database.retrieve(pair(shift=0.02)), [[0.0, 0.1]])
    np.testing.assert_array_equal(database.retrieve(pair(shift=0.52)), [[5.0, 5.0]])
    assert database.retrieve(pair(shift=-0.5)).shape == (0, 2)


def test_the_number_of_retrieved_waypoints_is_bounded_nearest_first() -> None:
    parts = [
        (pair(shift=shift), np.full((10, 2), shift), np.tile([shift, 0.0, 0.0], (10, 1))) for shift in (0.0, 0.03, 0.06)
    ]
    database = PrimitiveDatabase.of(parts, 2, GmmOptions(radius=0.1, largest=15))
    found = database.retrieve(pair(shift=0.06))
    assert len(found) == 15
    np.testing.assert_allclose(found[:10], 0.06)
    np.testing.assert_allclose(found[10:], 0.03)


def test_samples_are_equal_shares_of_isotropic_gaussians_within_limits() -> None:
    mixture = GaussianMixture(np.array([[0.2, 0.5], [0.8, 0.5]]), 0.05, np.zeros(2), np.ones(2))
    samples = mixture.sample(np.random.default_rng(0), 4000)
    left = samples[samples[:, 0] < 0.5]
    assert 0.45 < len(left) / 4000 < 0.55
    np.testing.assert_allclose(left.mean(axis=0), [0.2, 0.5], atol=0.01)
    np.testing.assert_allclose(left.std(axis=0), 0.05, atol=0.005)
    edge = GaussianMixture(np.zeros((1, 2)), 0.05, np.zeros(2), np.ones(2)).sample(np.random.default_rng(0), 100)
    assert (edge >= 0.0).all()
    with pytest.raises(InvalidOptionError):
        GaussianMixture(np.zeros((0, 2)), 0.05, np.zeros(2), np.ones(2))


def test_from_a_dataset_to_samples(tmp_path: Path) -> None:
    """`train --model gmm`, then the guide: its samples in a maze lie where paths of similar places went."""
    write_maze_experience(tmp_path / "mazes", training=60)
    assert run_train(TrainArguments(tmp_path / "mazes", "gmm", tmp_path / "models")) == 0
    robot, maze = PointRobot(), random_maze(np.random.default_rng(9))
    decomposition = decompose(maze.scene, DecompositionOptions(dimension=2))
    setting = GuideSetting(robot, maze.scene, lambda: decomposition, models=str(tmp_path / "models"))
    guide = make_guide("gmm", setting)
    guidance = guide.guide(maze.start, maze.goal[None], ExactChecker(robot, maze.scene))
    assert guidance.sampler_id == "gmm"
    assert guidance.sampler is not None
    samples = guidance.sampler.sample(np.random.default_rng(0), 200)
    assert samples.shape == (200, 2)
    assert ((samples >= 0.0) & (samples <= 1.0)).all()
    empty = GuideSetting(robot, Scene.of([], maze.scene.bounds), lambda: decomposition, models=str(tmp_path / "models"))
    with pytest.raises(KeypointsUnavailableError, match="database"):
        make_guide("gmm", empty).guide(maze.start, maze.goal[None], ExactChecker(robot, maze.scene))


def test_a_damaged_database_is_refused(tmp_path: Path) -> None:
    write_maze_experience(tmp_path / "mazes", training=10)
    run_train(TrainArguments(tmp_path / "mazes", "gmm", tmp_path))
    path = tmp_path / "maze_gmm.safetensors"
    again = PrimitiveDatabase.load(path)
    assert len(again.waypoints) == again.offsets[-1]
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(ModelError, match="cannot be read"):
        PrimitiveDatabase.load(path)
