"""The training loop, and what each model is trained on."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from maze_experience import write_maze_experience

from bsp_informed_planner.cli.train import TrainArguments, command, run_train
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.graph import has_line_of_sight
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import DatasetMismatchError, InvalidOptionError, TrainingError
from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.keypoint_examples import HeatmapExamples, HeatmapTargets, RegressionExamples
from bsp_informed_planner.experience.sampler_examples import (
    SceneSamplerExamples,
    SegmentSamplerExamples,
    noisy_states,
)
from bsp_informed_planner.experience.trainable_models import MODELS, Training, prepare_training
from bsp_informed_planner.experience.training import TrainingOptions, TrainingResult, TrainingState, train
from bsp_informed_planner.networks.encoding import PlanarDistances, PlanarOccupancy
from bsp_informed_planner.networks.registry import load_model
from bsp_informed_planner.sampling.path_shapes import resampled
from bsp_informed_planner.scene.signed_distance import SignedDistance

QUICK = TrainingOptions(steps=8, batch_size=8, validate_every=4, warmup=2)


@pytest.fixture(scope="module")
def experience(tmp_path_factory: pytest.TempPathFactory) -> Experience:
    return write_maze_experience(tmp_path_factory.mktemp("mazes"))


@pytest.fixture(scope="module")
def training_split(experience: Experience) -> Experience:
    return experience.select(split="train")


def run(
    training: Training, out: Path, options: TrainingOptions = QUICK, stop_after: int | None = None
) -> TrainingResult:
    steps: list[int] = []

    def report(state: TrainingState) -> None:
        steps.append(state.step)

    return train(
        training.objective,
        training.training,
        training.validation,
        options,
        out,
        {"kind": training.card.kind},
        report,
        lambda: stop_after is not None and len(steps) + 1 == stop_after,
    )


def weights(training: Training) -> dict[str, torch.Tensor]:
    return training.network.state_dict()


@pytest.mark.parametrize("kind", ["segment_cvae", "sequential_regression"])
def test_a_training_that_was_interrupted_ends_the_same(kind: str, experience: Experience, tmp_path: Path) -> None:
    whole = prepare_training(kind, experience, seed=3)
    result = run(whole, tmp_path / "whole")
    assert result.finished
    assert result.steps == 8
    first = prepare_training(kind, experience, seed=3)
    stopped = run(first, tmp_path / "parts", stop_after=5)
    assert not stopped.finished
    assert stopped.steps == 5
    second = prepare_training(kind, experience, seed=3)
    resumed = run(second, tmp_path / "parts")
    assert resumed.best_step == result.best_step
    assert resumed.validation == result.validation
    for name, tensor in weights(whole).items():
        torch.testing.assert_close(weights(second)[name], tensor, rtol=0.0, atol=0.0)


def test_a_killed_training_goes_on_from_its_last_checkpoint(experience: Experience, tmp_path: Path) -> None:
    """As after a kill: the steps since the last validation are lost, and made again."""
    whole = prepare_training("segment_cvae", experience, seed=0)
    result = run(whole, tmp_path / "whole")
    killed = prepare_training("segment_cvae", experience, seed=0)
    calls = iter(range(100))

    def die(state: TrainingState) -> None:
        if next(calls) == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(
            killed.objective, killed.training, killed.validation, QUICK, tmp_path / "k", {"kind": "segment_cvae"}, die
        )
    again = prepare_training("segment_cvae", experience, seed=0)
    assert run(again, tmp_path / "k").validation == result.validation


def test_a_finished_training_is_not_begun_again(experience: Experience, tmp_path: Path) -> None:
    first = prepare_training("segment_cvae", experience, seed=0)
    result = run(first, tmp_path)
    again = prepare_training("segment_cvae", experience, seed=0)
    steps: list[TrainingState] = []
    repeated = train(
        again.objective, again.training, again.validation, QUICK, tmp_path, {"kind": "segment_cvae"}, steps.append
    )
    assert not steps
    assert repeated.validation == result.validation
    torch.testing.assert_close(weights(again), weights(first))


def test_a_checkpoint_of_another_training_is_refused(experience: Experience, tmp_path: Path) -> None:
    run(prepare_training("segment_cvae", experience, seed=0), tmp_path)
    with pytest.raises(TrainingError, match=r"its options\.seed is 0, not 1"):
        run(
            prepare_training("segment_cvae", experience, seed=1),
            tmp_path,
            TrainingOptions(**{**vars(QUICK), "seed": 1}),
        )
    with pytest.raises(TrainingError, match="its kind is segment_cvae, not cvae"):
        run(prepare_training("cvae", experience, seed=0), tmp_path)
    (tmp_path / "checkpoint.pt").write_bytes(b"nothing")
    with pytest.raises(TrainingError, match="cannot be read"):
        run(prepare_training("segment_cvae", experience, seed=0), tmp_path)


def test_early_stopping_keeps_the_best_weights(experience: Experience, tmp_path: Path) -> None:
    """A learning rate that ruins the network: validation gets worse, the training ends, and the best comes back."""
    training = prepare_training("segment_cvae", experience, seed=0)
    options = TrainingOptions(
        steps=400, batch_size=8, validate_every=2, warmup=0, learning_rate=0.05, gradient_norm=1e3, patience=3
    )
    losses: dict[int, float] = {}

    def note(state: TrainingState) -> None:
        if state.step % 2 == 0:
            losses[state.step] = state.validation["loss"]

    result = train(training.objective, training.training, training.validation, options, tmp_path, {}, note)
    assert result.steps < 400
    assert result.steps == result.best_step + 6
    assert min(losses, key=losses.__getitem__) == result.best_step
    assert result.validation["loss"] == losses[result.best_step]


def test_a_loss_that_is_not_finite_ends_the_training(experience: Experience, tmp_path: Path) -> None:
    training = prepare_training("segment_cvae", experience, seed=0)
    with torch.no_grad():
        next(training.network.parameters()).fill_(torch.nan)
    with pytest.raises(TrainingError, match="the loss of step 1 is nan"):
        run(training, tmp_path)


def test_a_full_disk_keeps_the_checkpoint_before(
    experience: Experience, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(prepare_training("segment_cvae", experience, seed=0), tmp_path, stop_after=4)
    before = (tmp_path / "checkpoint.pt").read_bytes()

    def full(content: object, path: Path) -> None:
        Path(path).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(torch, "save", full)
    with pytest.raises(TrainingError, match="No space left"):
        run(prepare_training("segment_cvae", experience, seed=0), tmp_path)
    assert (tmp_path / "checkpoint.pt").read_bytes() == before


def test_every_example_once_an_epoch(experience: Experience, tmp_path: Path) -> None:
    training = prepare_training("segment_cvae", experience, seed=0)
    seen: list[int] = []
    batch = training.training.batch

    class Recorder:
        def __len__(self) -> int:
            return len(training.training)

        def batch(self, indices: np.ndarray, rng: np.random.Generator | None) -> dict[str, torch.Tensor]:
            seen.extend(indices.tolist())
            return batch(indices, rng)

    count = len(training.training)
    options = TrainingOptions(steps=-(-2 * count // 8), batch_size=8, validate_every=10**6)
    train(training.objective, Recorder(), training.validation, options, tmp_path, {})
    assert sorted(seen[:count]) == list(range(count))
    assert sorted(seen[count : 2 * count]) == list(range(count))
    assert seen[:count] != seen[count : 2 * count]


def test_two_processes_share_the_work(experience: Experience, tmp_path: Path) -> None:
    """By torchrun, as a user would; both see the same weights, and one writes."""
    command_line = [
        sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2", "--master-port", "29517",
        "-m", "bsp_informed_planner.cli.app", "train", str(experience.folder), "--model", "segment_cvae",
        "--out", str(tmp_path), "--steps", "4", "--batch-size", "8", "--validate-every", "2",
    ]  # fmt: skip
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command_line, capture_output=True, text=True, timeout=120, check=False, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    assert load_model(tmp_path / "maze_segment_cvae.safetensors").card.training["steps"] == 4
    assert done.stdout.count("best after step") == 1


# --- examples ---


def test_heatmap_targets_are_what_the_chain_has_next(training_split: Experience) -> None:
    """From each current keypoint the next is in sight, and nearer to the goal by the way between them."""
    targets = HeatmapTargets(currents=40, drawn=40, clearance_weight=0.0)
    examples = HeatmapExamples(training_split, PlanarDistances(16), targets, seed=0)
    assert len(examples) == 2 * len(training_split)
    batch = examples.batch(np.arange(len(examples)), None)
    assert batch["distances"].shape == (48, 16, 16)
    unseen = 0
    for example in range(len(examples)):
        decomposition = decompose(training_split.scene(example // 2), DecompositionOptions(dimension=2))
        for current, following in zip(batch["currents"][example], batch["nexts"][example], strict=True):
            a, b = ([*point.double().tolist(), 0.0] for point in (current, following))
            unseen += not has_line_of_sight(decomposition, a, b)
            assert not torch.equal(current, following)
    # Candidates that are passed over, since they are too near, may hide the next one from some places.
    assert unseen < 0.02 * 40 * len(examples)
    goal, start = batch["goals"][0], batch["goals"][1]
    np.testing.assert_allclose(goal, training_split.goals[0], atol=1e-6)
    np.testing.assert_allclose(start, training_split.starts[0], atol=1e-6)
    # The cost to go is the distance where the goal is in sight, and nothing is known inside of walls.
    occupied = batch["distances"][0, 1::2, 1::2] < -0.04
    assert torch.isnan(batch["costs"][0].view(8, 8)[occupied]).all()


def test_augmentation_turns_everything_alike(training_split: Experience) -> None:
    """Current keypoints stay outside of walls, whatever the symmetry: grid and points turn together."""
    examples = HeatmapExamples(training_split, PlanarDistances(64), HeatmapTargets(noise=0.0), seed=0)
    seen = set()
    for seed in range(12):
        batch = examples.batch(np.array([0, 5, 9]), np.random.default_rng(seed))
        cells = (64 * batch["currents"]).long().clamp(0, 63)
        distances = torch.stack([grid[c[:, 0], c[:, 1]] for grid, c in zip(batch["distances"], cells, strict=True)])
        assert (distances > -0.012).all()  # half a cell
        goal = (64 * batch["goals"][0]).long()
        assert batch["distances"][0, goal[0], goal[1]] > -0.012
        seen.add(tuple(goal.tolist()))
    assert len(seen) > 3


def test_regression_examples_are_neighbours_of_chains(training_split: Experience) -> None:
    examples = RegressionExamples(training_split, PlanarOccupancy(8), planar=True, noise=0.0)
    chains = [training_split.keypoints[k] for k in range(len(training_split))]
    assert len(examples) == sum(len(chain) - 1 for chain in chains)
    batch = examples.batch(np.arange(len(chains[0]) - 1), None)
    np.testing.assert_allclose(batch["currents"], chains[0][:-1], atol=1e-6)
    np.testing.assert_allclose(batch["nexts"], chains[0][1:], atol=1e-6)
    np.testing.assert_allclose(batch["targets"], np.repeat(chains[0][-1:], len(chains[0]) - 1, axis=0), atol=1e-6)
    assert batch["scenes"].shape == (len(chains[0]) - 1, 64)


def test_paths_are_resampled_evenly(training_split: Experience) -> None:
    path = training_split.paths[0]
    points = resampled(path, 32)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_allclose(points[[0, -1]], path[[0, -1]])
    assert steps.max() < 1.01 * training_split.path_costs[0] / 31


def test_states_of_samplers_lie_around_paths_and_never_in_walls(training_split: Experience) -> None:
    field = SignedDistance(training_split.scene(0), 0.0)
    path = training_split.paths[0]
    states = noisy_states(path, 300, 0.05, np.random.default_rng(0), lambda points: field.at(points) > 0.0)
    assert (field.at(states) > 0.0).all()
    assert not (field.at(noisy_states(path, 300, 0.05, np.random.default_rng(0), None)) > 0.0).all()
    stuck = noisy_states(path, 50, 0.05, np.random.default_rng(0), lambda points: np.zeros(len(points), np.bool_))
    nearest = np.linalg.norm(stuck[:, None] - resampled(path, 2000)[None], axis=2).min(axis=1)
    assert nearest.max() < 1e-3


def test_examples_of_samplers(training_split: Experience) -> None:
    rng = np.random.default_rng(0)
    whole = SceneSamplerExamples(training_split, PlanarOccupancy(4), True, 0.0, True, 3, seed=0)
    assert len(whole) == len(training_split)
    batch = whole.batch(np.arange(3), rng)
    assert batch["conditions"].shape == (3, 4 + 16)
    assert batch["noise"].shape == (3, 3)
    plain = whole.batch(np.arange(3), None)["conditions"]
    np.testing.assert_allclose(plain[:, :2], training_split.starts[:3], atol=1e-6)
    np.testing.assert_allclose(plain[:, 2:4], training_split.goals[:3], atol=1e-6)
    local = SegmentSamplerExamples(training_split, PlanarDistances(11), 0.0, 3, seed=0)
    states = local.batch(np.arange(len(local)), rng)["states"].numpy()
    # Straight subpaths are the unit interval of their own frame.
    np.testing.assert_allclose(states[:, 1], 0.0, atol=1e-5)
    assert states[:, 0].min() >= 0.0
    assert states[:, 0].max() <= 1.0 + 1e-6


# --- the command ---


# Networks of whole paths are for arms: test_path_guides.
@pytest.mark.parametrize("kind", sorted(kind for kind in MODELS if not kind.startswith("path_chains")))
def test_every_model_can_be_trained_and_loaded(kind: str, experience: Experience, tmp_path: Path) -> None:
    arguments = TrainArguments(experience.folder, kind, tmp_path, steps=2, batch_size=4, validate_every=1, problems=4)
    assert run_train(arguments) == 0
    model = load_model(tmp_path / f"maze_{kind}.safetensors")
    assert model.card.kind == kind
    assert model.card.data["problems"] == 4
    assert model.card.training["options"]["batch_size"] == 4
    assert np.isfinite(model.card.metrics["validation"]["loss"])
    assert f"--model {kind}" in model.card.training["command"]
    assert "--problems 4" in command(arguments)
    assert list((tmp_path / "tensorboard").iterdir())


def test_a_model_that_does_not_exist_is_said_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(InvalidOptionError, match=r"heatmap, .*path_chains, .*path_library, gmm"):
        run_train(TrainArguments(tmp_path / "no dataset", "nope", tmp_path))


def test_models_of_planar_robots_name_the_one_for_arms(experience: Experience, tmp_path: Path) -> None:
    folder = tmp_path / "arm"
    shutil.copytree(experience.folder, folder)
    robot = replace(experience.description.robot, name="ur5", workspace_dimension=3)
    replace(experience.description, robot=robot).write(folder)
    of_an_arm = Experience.load(folder)
    for kind in ("heatmap", "segment_cvae"):
        with pytest.raises(DatasetMismatchError, match=f"'ur5' .* planar robot, which '{kind}' .* 'path_chains'"):
            prepare_training(kind, of_an_arm, seed=0)


def test_what_cannot_be_trained(experience: Experience, tmp_path: Path) -> None:
    with pytest.raises(InvalidOptionError, match="model"):
        prepare_training("oracle", experience, seed=0)
    with pytest.raises(TrainingError, match="split 'validation'"):
        prepare_training("heatmap", experience.select(split="train"), seed=0)
    with pytest.raises(InvalidOptionError, match="device"):
        TrainingOptions(device="abacus")
    with pytest.raises(InvalidOptionError, match="steps"):
        TrainingOptions(steps=0)
