"""Finds the model that suits a robot; each file is read once in a process.

torch is loaded with the first network, not before: databases do without it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file

from bsp_informed_planner.errors import ModelError, ModelMismatchError, ModelUnavailableError
from bsp_informed_planner.networks.card import SHIPPED, ModelCard
from bsp_informed_planner.robots.robot import Robot

if TYPE_CHECKING:
    from bsp_informed_planner.networks.registry import Model

T = TypeVar("T")

#: Kinds of models of keypoints, the best first.
KEYPOINT_KINDS = ("heatmap", "sequential_regression")


def find_model(robot: Robot, kinds: Sequence[str], folder: str | Path | None = None) -> Model:
    """The network that `find_card` finds.

    Raises:
        ModelUnavailableError: if there is none.
        ModelError: if a file is damaged.
    """
    from bsp_informed_planner.networks.registry import load_model

    path, _ = find_card(robot, kinds, folder)
    return read_once(load_model, path)


def read_once(read: Callable[..., T], path: Path, *arguments: Any) -> T:
    """What a function reads from a file, with these arguments; read again only after the file has changed."""
    content: T = _read(read, path, path.stat().st_mtime_ns, *arguments)
    return content


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
    cards = _cards(place)
    for kind in kinds:
        for path, card in cards:
            if card.kind == kind and _suits(card, robot):
                return path, card
    raise ModelUnavailableError(kinds, str(place), robot.name)


def require_sound_models(folder: str | Path | None = None) -> tuple[str, ...]:
    """Read every model of a folder, without making networks of them.

    Args:
        folder: None: the models that come with the package.

    Returns:
        their names.

    Raises:
        ModelError: if the folder or a file is missing or damaged, or a number is not finite.
    """
    place = SHIPPED if folder is None else Path(folder)
    if not place.is_dir():
        raise ModelError(str(place), "is no folder of models")
    for path, _ in _cards(place):
        weights = path.with_suffix(".safetensors")
        try:
            arrays = load_file(weights)
        except (OSError, SafetensorError) as error:
            raise ModelError(str(weights), f"cannot be read: {error}") from error
        if not all(np.isfinite(array).all() for array in arrays.values()):
            raise ModelError(str(weights), "a weight is not finite")
    return tuple(card.name for _, card in _cards(place))


def _cards(place: Path) -> list[tuple[Path, ModelCard]]:
    return [(path, ModelCard.read(path)) for path in sorted(place.glob("*.json"))]


def _suits(card: ModelCard, robot: Robot) -> bool:
    try:
        card.require_robot(tuple(robot.joint_names), robot.workspace_dimension, robot.tool_frame)
    except ModelMismatchError:
        return False
    return True


@lru_cache(maxsize=32)
def _read(read: Callable[..., Any], path: Path, changed: int, *arguments: Any) -> Any:
    return read(path, *arguments)
