"""Finds the model that suits a robot; each file is read once in a process."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from bsp_informed_planner.errors import ModelMismatchError, ModelUnavailableError
from bsp_informed_planner.networks.card import ModelCard
from bsp_informed_planner.networks.registry import SHIPPED, Model, load_model
from bsp_informed_planner.robots.robot import Robot


def find_model(robot: Robot, kinds: Sequence[str], folder: str | Path | None = None) -> Model:
    """The network that `find_card` finds.

    Raises:
        ModelUnavailableError: if there is none.
        ModelError: if a file is damaged.
    """
    path, _ = find_card(robot, kinds, folder)
    return _load(path, path.stat().st_mtime_ns)


def find_card(robot: Robot, kinds: Sequence[str], folder: str | Path | None = None) -> tuple[Path, ModelCard]:
    """A model for a robot: of the first of several kinds that there is one of, and of these the first by name.

    Args:
        robot: whose joints and tool frame the card must name.
        kinds: best first.
        folder: of models; None: those that come with the package.

    Returns:
        the file of the card, and the card.

    Raises:
        ModelUnavailableError: if there is none.
        ModelError: if a card is damaged.
    """
    place = SHIPPED if folder is None else Path(folder)
    cards = [(path, ModelCard.read(path)) for path in sorted(place.glob("*.json"))]
    for kind in kinds:
        for path, card in cards:
            if card.kind == kind and _suits(card, robot):
                return path, card
    raise ModelUnavailableError(kinds, str(place), robot.name)


def _suits(card: ModelCard, robot: Robot) -> bool:
    try:
        card.require_robot(tuple(robot.joint_names), robot.workspace_dimension, robot.tool_frame)
    except ModelMismatchError:
        return False
    return True


@lru_cache(maxsize=32)
def _load(path: Path, changed: int) -> Model:
    return load_model(path)
