"""Networks, their encodings and cards."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from maze_experience import maze_record

from bsp_informed_planner.errors import InvalidOptionError, ModelError, ModelMismatchError
from bsp_informed_planner.experience.symmetries import COUNT, turned_grids, turned_points
from bsp_informed_planner.networks.card import ModelCard, ModelRobot
from bsp_informed_planner.networks.cvae import Cvae
from bsp_informed_planner.networks.encoding import (
    BasisDistances,
    PlanarDistances,
    PlanarOccupancy,
    SceneEncoding,
    encoding_from_json,
    encoding_to_json,
)
from bsp_informed_planner.networks.keypoint_heatmap import KeypointHeatmap
from bsp_informed_planner.networks.keypoint_regression import KeypointRegression
from bsp_informed_planner.networks.registry import build_network, load_model, save_model
from bsp_informed_planner.networks.runtime import limit_threads
from bsp_informed_planner.networks.segment_frame import CONDITION_SIZE, SegmentFrames, reflected
from bsp_informed_planner.scene.encodings import GridFrame
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box
from bsp_informed_planner.scene.signed_distance import SignedDistance

ENCODINGS: list[SceneEncoding] = [
    PlanarDistances(12),
    PlanarOccupancy(8),
    BasisDistances((0.0, 0.0, -0.05), (1.0, 1.0, 0.05), 20, 0.3, (0.0, -1.0), (2.0, 1.0)),
]
SMALL = {"cells": 8, "channels": [8, 8, 16], "embedding": 8, "attention": 1}


def card_of(kind: str, architecture: dict[str, object], encoding: SceneEncoding, name: str = "small") -> ModelCard:
    return ModelCard(name, kind, architecture, encoding_to_json(encoding), ModelRobot("point", ("x", "y"), 2, "point"))


@pytest.mark.parametrize("encoding", ENCODINGS, ids=lambda encoding: encoding.kind)
def test_encodings_survive_json_and_have_the_shape_they_say(encoding: SceneEncoding) -> None:
    again = encoding_from_json(json.loads(json.dumps(encoding_to_json(encoding))))
    assert again == encoding
    scene = maze_record("train", 1).scene
    values = again.encode(scene)
    assert values.shape == encoding.shape
    assert values.dtype == np.float32
    np.testing.assert_array_equal(values, encoding.encode(scene))
    frame = again.state_frame(scene)
    states = np.random.default_rng(0).uniform(0.0, 1.0, (5, 2))
    np.testing.assert_allclose(frame.to_metres(frame.to_unit(states)), states)


def test_an_unknown_encoding_is_refused() -> None:
    with pytest.raises(InvalidOptionError, match="planar_distances"):
        encoding_from_json({"kind": "voxels"})
    with pytest.raises(InvalidOptionError, match="parameters"):
        encoding_from_json({"kind": "planar_distances", "size": 3})


def test_states_are_tiled_to_the_size_of_the_scene() -> None:
    network = KeypointRegression(scene_size=7, state_size=2, hidden=16, layers=2)
    tiled = network.tiled(torch.tensor([[1.0, 2.0], [3.0, 4.0]]))
    np.testing.assert_array_equal(tiled.numpy(), [[1, 2, 1, 2, 1, 2, 1], [3, 4, 3, 4, 3, 4, 3]])
    assert network(torch.zeros(2, 7), torch.zeros(2, 2), torch.zeros(2, 2)).shape == (2, 2)
    assert network.layers[0].in_features == 21


@pytest.mark.parametrize("symmetry", range(COUNT))
def test_symmetries_turn_grids_as_they_turn_points(symmetry: int) -> None:
    """The cell of a turned point in the turned grid holds what the cell of the point held."""
    rng = np.random.default_rng(symmetry)
    grid = torch.from_numpy(rng.normal(size=(1, 6, 6)).astype(np.float32))
    points = torch.from_numpy(rng.uniform(0.0, 1.0, (50, 2)).astype(np.float32))
    turned_grid, turned = turned_grids(symmetry, grid)[0], turned_points(symmetry, points)
    before, after = (6 * points).long(), (6 * turned).long()
    np.testing.assert_array_equal(turned_grid[after[:, 0], after[:, 1]], grid[0][before[:, 0], before[:, 1]])


def test_the_symmetries_are_eight_different_ones() -> None:
    corner = torch.tensor([[0.1, 0.3]])
    assert len({tuple(turned_points(k, corner)[0].round(decimals=3).tolist()) for k in range(COUNT)}) == COUNT


def test_heatmap_cells_and_places_agree() -> None:
    network = KeypointHeatmap(**{k: tuple(v) if isinstance(v, list) else v for k, v in SMALL.items()})  # type: ignore[arg-type]
    fields = network(torch.rand(3, 16, 16), torch.rand(3, 2))
    places = network.keypoints(fields)
    assert places.shape == (3, 64, 2)
    cells = torch.arange(64).expand(3, 64)
    # Offsets reach over the border of a cell by a quarter, so each place is in its cell or next to it.
    centres = network.centres.flatten(1).T
    assert ((places - centres).abs() <= 0.75 / 8 + 1e-6).all()
    np.testing.assert_array_equal(network.cells_of(centres), cells[0])
    assert network.logits(fields, torch.rand(3, 5, 2)).shape == (3, 5, 64)
    np.testing.assert_array_equal(network.cells_of(torch.tensor([[-0.1, 0.5], [1.0, 1.0]])), [4, 63])


def test_heatmap_queries_are_read_at_the_current_keypoint() -> None:
    """A change of the features of one cell changes the logits of current keypoints in it, and of those far off not."""
    network = KeypointHeatmap(8, (8, 8, 16), 8, 1)
    fields = network(torch.rand(1, 16, 16), torch.rand(1, 2))
    currents = torch.tensor([[[2.5 / 8, 6.5 / 8], [6.5 / 8, 1.5 / 8]]])
    before = network.logits(fields, currents)
    fields.fine[0, :, 2, 6] += 1.0
    after = network.logits(fields, currents)
    assert not torch.allclose(before[0, 0], after[0, 0])
    assert torch.allclose(before[0, 1], after[0, 1])


def test_a_cvae_learns_a_conditional_distribution() -> None:
    """Two conditions, two clusters: after a short training its samples lie where they should, and are spread."""
    limit_threads()
    torch.manual_seed(0)
    network = Cvae(2, 1, latent_size=2, hidden=32)
    optimiser = torch.optim.Adam(network.parameters(), lr=3e-3)
    for _ in range(600):
        conditions = torch.randint(0, 2, (128, 1)).float()
        states = torch.cat((conditions, 1.0 - conditions), dim=1) + 0.1 * torch.randn(128, 2)
        terms = network(states, conditions, torch.randn(128, 2))
        loss = terms.reconstruction + 2e-3 * terms.divergence
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    for value in (0.0, 1.0):
        samples = network.decode(torch.randn(500, 2), torch.full((500, 1), value)).detach().numpy()
        np.testing.assert_allclose(samples.mean(axis=0), [value, 1.0 - value], atol=0.1)
        assert 0.05 < samples.std(axis=0).max() < 0.2


def test_segment_frames_are_invariant() -> None:
    """Coordinates and conditions of a segment stay when scene and segment are moved and turned together."""
    rng = np.random.default_rng(0)
    starts, ends = rng.uniform(0.2, 0.8, (4, 2)), rng.uniform(0.2, 0.8, (4, 2))
    frames = SegmentFrames.of(starts, ends)
    segments = np.arange(4)
    np.testing.assert_allclose(frames.to_local(starts, segments), 0.0, atol=1e-12)
    np.testing.assert_allclose(frames.to_local(ends, segments), np.tile([1.0, 0.0], (4, 1)), atol=1e-12)
    points = rng.uniform(0.0, 1.0, (4, 2))
    np.testing.assert_allclose(frames.to_unit(frames.to_local(points, segments), segments), points)

    bounds = WorkspaceBounds(np.array([-5.0, -5.0, -1.0]), np.array([5.0, 5.0, 1.0]))
    unit = GridFrame(np.zeros(2), 1.0)
    turn = Pose.from_xyz_rpy([0.3, -0.2, 0.0], [0.0, 0.0, 0.7])
    box = Pose.from_xyz_rpy([0.5, 0.55, 0.0], [0.0, 0.0, 0.2])
    shape = Box(np.array([0.2, 0.1, 0.5]))

    def conditions(pose: Pose, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        field = SignedDistance(Scene.of([Obstacle.of("box", shape, pose)], bounds), 0.0)
        return SegmentFrames.of(first, last).conditions(field, unit)

    def turned(array: np.ndarray) -> np.ndarray:
        return turn.apply(np.column_stack((array, np.zeros(len(array)))))[:, :2]

    plain = conditions(box, starts, ends)
    assert plain.shape == (4, CONDITION_SIZE)
    assert plain[:, 1:].min() < 0.5  # the box is seen
    np.testing.assert_allclose(conditions(turn * box, turned(starts), turned(ends)), plain, atol=1e-6)
    mirrored_box = Pose.from_xyz_rpy([0.5, -0.55, 0.0], [0.0, 0.0, -0.2])
    flip = np.array([1.0, -1.0])
    np.testing.assert_allclose(conditions(mirrored_box, starts * flip, ends * flip), reflected(plain), atol=1e-6)


def test_a_segment_of_no_length_has_a_frame() -> None:
    frames = SegmentFrames.of(np.full((1, 2), 0.4), np.full((1, 2), 0.4))
    local = frames.to_local(np.array([[0.41, 0.4]]), np.zeros(1, np.int64))
    assert np.isfinite(local).all()
    np.testing.assert_allclose(frames.to_unit(local, np.zeros(1, np.int64)), [[0.41, 0.4]])


@pytest.mark.parametrize(
    ("kind", "architecture"),
    [
        ("heatmap", SMALL),
        ("sequential_regression", {"scene_size": 64, "state_size": 2, "hidden": 8, "layers": 1}),
        ("cvae", {"state_size": 2, "condition_size": 68, "hidden": 8}),
    ],
)
def test_models_survive_saving(kind: str, architecture: dict[str, object], tmp_path: Path) -> None:
    torch.manual_seed(1)
    card = card_of(kind, architecture, PlanarDistances(16))
    network = build_network(card)
    path = save_model(network, card, tmp_path)
    model = load_model(path)
    assert model.card == dataclasses.replace(card, parameters=sum(p.numel() for p in network.parameters()))
    assert model.encoding == PlanarDistances(16)
    assert not model.network.training
    for name, tensor in network.state_dict().items():
        torch.testing.assert_close(model.network.state_dict()[name], tensor.half().float())


def test_damaged_models_are_refused(tmp_path: Path) -> None:
    card = card_of("heatmap", SMALL, PlanarDistances(16))
    path = save_model(build_network(card), card, tmp_path)
    with pytest.raises(ModelError, match="cannot be read"):
        load_model(tmp_path / "other.safetensors")
    wider = dict(SMALL, embedding=16)
    dataclasses.replace(card, architecture=wider).write(path.with_suffix(".json"))
    with pytest.raises(ModelError, match="does not fit its card"):
        load_model(path)
    dataclasses.replace(card, architecture={"colour": 3}).write(path.with_suffix(".json"))
    with pytest.raises(ModelError, match="architecture"):
        load_model(path)
    dataclasses.replace(card, kind="oracle").write(path.with_suffix(".json"))
    with pytest.raises(ModelError, match="kind 'oracle'"):
        load_model(path)
    card.write(path.with_suffix(".json"))
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ModelError, match="cannot be read"):
        load_model(path)
    path.with_suffix(".json").write_text("{}")
    with pytest.raises(ModelError, match="format"):
        load_model(path)


def test_a_network_with_nan_is_refused(tmp_path: Path) -> None:
    card = card_of("heatmap", SMALL, PlanarDistances(16))
    network = build_network(card)
    with torch.no_grad():
        next(network.parameters())[0] = torch.nan
    with pytest.raises(ModelError, match="not finite"):
        load_model(save_model(network, card, tmp_path))


def test_a_card_is_of_one_robot() -> None:
    card = card_of("heatmap", SMALL, PlanarDistances(16))
    card.require_robot(("x", "y"), 2, "point")
    with pytest.raises(ModelMismatchError, match="joints"):
        card.require_robot(("x", "y", "z"), 2, "point")
    with pytest.raises(ModelMismatchError, match="dimension"):
        card.require_robot(("x", "y"), 3, "point")
