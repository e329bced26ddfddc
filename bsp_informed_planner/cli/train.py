"""`bsp-planner train`: a model from a dataset."""

from __future__ import annotations

import os
import platform
import shlex
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import FrameType

import numpy as np
import torch
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from bsp_informed_planner import __version__
from bsp_informed_planner.errors import InvalidOptionError, TrainingError
from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.gmm_database import PROBLEMS, build_database
from bsp_informed_planner.experience.trainable_models import MODELS, Training, prepare_training, robot_of
from bsp_informed_planner.experience.training import TrainingOptions, TrainingResult, TrainingState, train
from bsp_informed_planner.networks.card import ModelCard, ModelRobot
from bsp_informed_planner.networks.registry import save_model
from bsp_informed_planner.networks.runtime import limit_threads
from bsp_informed_planner.sampling.path_library import PathLibrary

#: The models that are no networks.
DATABASE, LIBRARY = "gmm", "path_library"
#: All that can be made from a dataset.
TRAINED = (*MODELS, LIBRARY, DATABASE)
#: Paths in a library.
LIBRARY_PATHS = 8000


@dataclass(frozen=True)
class TrainArguments:
    """Options of the command; see its help. None: the default of the model.

    Attributes:
        dataset: folder.
        model: one of `MODELS`, "gmm" or "path_library".
        out: folder of checkpoint, curves, weights and card.
        name: of the model; None: family and kind.
        problems: at most so many for training.
        steps, batch_size, learning_rate, validate_every, patience, seed, device, threads: see `TrainingOptions`.
    """

    dataset: Path
    model: str
    out: Path
    name: str | None = None
    problems: int | None = None
    steps: int | None = None
    batch_size: int | None = None
    learning_rate: float | None = None
    validate_every: int | None = None
    patience: int | None = None
    seed: int = 0
    device: str = "cpu"
    threads: int = 1

    @property
    def options(self) -> TrainingOptions:
        """Those of the model, as far as nothing else is asked for."""
        names = ("steps", "batch_size", "learning_rate", "validate_every", "patience", "seed", "device", "threads")
        given = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        defaults = MODELS[self.model].options if self.model in MODELS else TrainingOptions()
        return replace(defaults, **given)


def run_train(arguments: TrainArguments) -> int:
    """Train, or go on from the checkpoint in the folder. Returns the exit status: 130 after Ctrl-C.

    Raises:
        InvalidOptionError: if there is no such model; before anything is read.
        DatasetError, TrainingError, InvalidOptionError, ModelError: see `prepare_training`, `train`, `save_model`.
    """
    if arguments.model not in TRAINED:
        raise InvalidOptionError("model", arguments.model, f"one of {', '.join(TRAINED)}")
    is_first = os.environ.get("RANK", "0") == "0"
    console = Console(highlight=False, quiet=not is_first, width=None if sys.stdout.isatty() else 160)
    experience = Experience.load(arguments.dataset)
    if arguments.model in (DATABASE, LIBRARY):
        return _run_without_training(arguments, experience, console)
    options = arguments.options
    limit_threads(options.threads)
    with _progress(console) as progress:
        reading = progress.add_task("reading problems", total=None)
        training = prepare_training(
            arguments.model,
            experience,
            arguments.seed,
            arguments.problems,
            lambda done, total: progress.update(reading, completed=done, total=total),
        )
    card = training.card if arguments.name is None else replace(training.card, name=arguments.name)
    parameters = sum(parameter.numel() for parameter in training.network.parameters())
    console.print(
        f"{card.name}: {parameters:,} parameters, {len(training.training):,} examples of {card.data['problems']:,} "
        f"problems, {len(training.validation):,} for validation"
    )
    with _progress(console) as progress, _interruption() as interrupted:
        task = progress.add_task("training", total=options.steps)

        def report(state: TrainingState) -> None:
            best = f", validation {state.best[0]:.4f} at {state.best[1]}" if state.best[1] else ""
            progress.update(task, completed=state.step, description=f"loss {state.loss:.4f}{best}")
            if state.validation and state.step % options.validate_every == 0:
                values = ", ".join(f"{name} {value:.4f}" for name, value in state.validation.items())
                progress.console.print(f"step {state.step}: {values}")

        result = _train(training, options, arguments, card, report, interrupted)
    if not result.finished:
        console.print(f"interrupted after step {result.steps}; the same command goes on from there")
        return 130
    if is_first:
        path = save_model(training.network, _finished(card, arguments, options, result), arguments.out)
        console.print(f"best after step {result.best_step} of {result.steps}, {result.seconds:.0f} s: {path}")
    return 0


def _run_without_training(arguments: TrainArguments, experience: Experience, console: Console) -> int:
    """Experience as it is: nothing is optimised, so there is nothing to resume."""
    robot, family = robot_of(experience), experience.description.family
    card = ModelCard(
        name=arguments.name or f"{family}_{arguments.model}",
        kind=arguments.model,
        architecture={},
        encoding={},
        robot=ModelRobot(robot.name, tuple(robot.joint_names), robot.workspace_dimension, robot.tool_frame),
        data={"family": family, "collection_seed": experience.description.seed},
        training={"command": command(arguments)},
        versions=_versions(),
    )
    if arguments.model == LIBRARY:
        solved = experience.select(split="train", solved=True)
        count = min(len(solved), arguments.problems or LIBRARY_PATHS)
        if not count:
            raise TrainingError(f"{experience.folder} has no solved problems in its split 'train'")
        library = PathLibrary.of(robot, list(solved.paths.subset(np.arange(count))))
        path = library.save(replace(card, data={**card.data, "paths": count}), arguments.out)
        console.print(f"{len(library):,} paths: {path}")
        return 0
    with _progress(console) as progress:
        task = progress.add_task("reading problems", total=None)
        database = build_database(
            experience,
            robot,
            problems=arguments.problems or PROBLEMS,
            report=lambda done, total: progress.update(task, completed=done, total=total),
        )
    path = database.save(replace(card, data={**card.data, "waypoints": len(database.waypoints)}), arguments.out)
    console.print(f"{len(database.primitives):,} primitives, {len(database.waypoints):,} waypoints: {path}")
    return 0


def _train(
    training: Training,
    options: TrainingOptions,
    arguments: TrainArguments,
    card: ModelCard,
    report: Callable[[TrainingState], None],
    interrupted: list[bool],
) -> TrainingResult:
    identity = {
        "kind": card.kind,
        "architecture": dict(card.architecture),
        "encoding": dict(card.encoding),
        "inputs": dict(card.inputs),
        "data": {k: v for k, v in card.data.items() if k != "parameters"},
    }
    return train(
        training.objective,
        training.training,
        training.validation,
        options,
        arguments.out,
        identity,
        report,
        lambda: bool(interrupted),
    )


def _finished(
    card: ModelCard, arguments: TrainArguments, options: TrainingOptions, result: TrainingResult
) -> ModelCard:
    """The card with what is known after the training."""
    return replace(
        card,
        training={
            "command": command(arguments),
            "options": asdict(options),
            "steps": result.steps,
            "best_step": result.best_step,
            "seconds": round(result.seconds, 1),
        },
        versions=_versions(),
        metrics={"validation": {name: round(value, 6) for name, value in result.validation.items()}},
    )


def _versions() -> dict[str, str]:
    return {
        "bsp_informed_planner": __version__,
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numpy": np.__version__,
    }


def command(arguments: TrainArguments) -> str:
    """The command line that does the same, with folders by their names."""
    words = ["bsp-planner", "train", arguments.dataset.name, "--model", arguments.model, "--out", arguments.out.name]
    for name, value in asdict(arguments).items():
        default = TrainArguments.__dataclass_fields__[name].default
        if name not in ("dataset", "model", "out") and value != default:
            words += [f"--{name.replace('_', '-')}", str(value)]
    return shlex.join(words)


@contextmanager
def _interruption() -> Iterator[list[bool]]:
    """A list that is no longer empty after Ctrl-C; after a second one, the usual happens."""
    asked: list[bool] = []
    before = signal.getsignal(signal.SIGINT)

    def note(signum: int, frame: FrameType | None) -> None:
        if asked:
            raise KeyboardInterrupt
        asked.append(True)

    signal.signal(signal.SIGINT, note)
    try:
        yield asked
    finally:
        signal.signal(signal.SIGINT, before)


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
    )
