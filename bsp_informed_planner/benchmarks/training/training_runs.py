"""The training runs that are compared, as their cards describe them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bsp_informed_planner.benchmarks.maze.world import MazeWorld
from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.networks.card import SHIPPED
from bsp_informed_planner.sampling.models import KEYPOINT_KINDS, find_card


@dataclass(frozen=True)
class TrainingRun:
    """A keypoint network of one training.

    Attributes:
        name: that of its folder; unique among those that are compared.
        folder: of the network.
        problems: mazes that it was trained on.
        steps: of the optimiser that were asked for; the learning rate falls over so many.
        seed: of weights, order and augmentation.
    """

    name: str
    folder: str
    problems: int
    steps: int
    seed: int

    @staticmethod
    def read(folder: Path) -> TrainingRun:
        """By the card in a folder.

        Raises:
            ModelUnavailableError: if there is no keypoint network for a point robot.
            ModelError: if a card is damaged.
            InvalidOptionError: if the card does not tell how the network was trained.
        """
        path, card = find_card(MazeWorld.robot, KEYPOINT_KINDS, folder)
        options = card.training.get("options", {})
        try:
            numbers = int(card.data["problems"]), int(options["steps"]), int(options["seed"])
        except (KeyError, TypeError, ValueError) as error:
            needed = "a card with problems, steps and seed of the training"
            raise InvalidOptionError("folder", str(path), needed) from error
        name = "shipped" if folder.resolve() == SHIPPED.resolve() else folder.resolve().name
        return TrainingRun(name, str(folder), *numbers)


def read_runs(folders: Sequence[Path]) -> tuple[TrainingRun, ...]:
    """The network of the package, and those of some folders.

    Raises:
        InvalidOptionError: if two folders have one name.
        ModelUnavailableError, ModelError: see `TrainingRun.read`.
    """
    runs = tuple(TrainingRun.read(folder) for folder in (SHIPPED, *folders))
    names = [run.name for run in runs]
    if len(set(names)) < len(names):
        raise InvalidOptionError("folder", ", ".join(names[1:]), "folders of different names")
    return runs


def by_data(runs: Sequence[TrainingRun]) -> Mapping[tuple[int, int], list[TrainingRun]]:
    """Those that differ in the number of mazes alone, the fewest first; by steps and seed."""
    groups: dict[tuple[int, int], list[TrainingRun]] = {}
    for run in sorted(runs, key=lambda run: run.problems):
        groups.setdefault((run.steps, run.seed), []).append(run)
    return {key: group for key, group in groups.items() if len({run.problems for run in group}) > 1}


def by_seed(runs: Sequence[TrainingRun]) -> Mapping[tuple[int, int], list[TrainingRun]]:
    """Those that differ in the seed alone; by problems and steps."""
    groups: dict[tuple[int, int], list[TrainingRun]] = {}
    for run in sorted(runs, key=lambda run: run.seed):
        groups.setdefault((run.problems, run.steps), []).append(run)
    return {key: group for key, group in groups.items() if len({run.seed for run in group}) > 1}
