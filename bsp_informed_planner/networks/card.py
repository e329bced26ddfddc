"""Model cards: what a file of weights is, and how it was made."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from bsp_informed_planner.errors import ModelError, ModelMismatchError

FORMAT = "bsp_informed_planner/model/1"
#: Where the models that come with the package are.
SHIPPED = Path(__file__).parent / "weights"


@dataclass(frozen=True)
class ModelRobot:
    """The robot that a model was trained for.

    Attributes:
        name: from its description.
        joint_names: (n,).
        workspace_dimension: 2 or 3.
        tool_frame: of its keypoints.
    """

    name: str
    joint_names: tuple[str, ...]
    workspace_dimension: int
    tool_frame: str

    @property
    def dof(self) -> int:
        """Number of joints n."""
        return len(self.joint_names)


@dataclass(frozen=True)
class ModelCard:
    """Describes a model, in a JSON file beside its weights.

    Attributes:
        name: of the model.
        kind: of the network, one of `networks.registry.KINDS`.
        architecture: arguments of its class.
        encoding: of scenes, see `networks.encoding`.
        robot: that it is for.
        parameters: number of its weights.
        inputs: options of how its inputs and outputs are made, by name.
        data: datasets and problems that it was trained on.
        training: options, seed, steps, time and command of its training.
        versions: of this package and of the libraries.
        metrics: results on the validation split, and on unseen problems where they were measured.
        limits: sentences on what it is not good for.
        format: of the card.
    """

    name: str
    kind: str
    architecture: Mapping[str, Any]
    encoding: Mapping[str, Any]
    robot: ModelRobot
    parameters: int = 0
    inputs: Mapping[str, Any] = field(default_factory=dict)
    data: Mapping[str, Any] = field(default_factory=dict)
    training: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    metrics: Mapping[str, Any] = field(default_factory=dict)
    limits: tuple[str, ...] = ()
    format: str = FORMAT

    def require_robot(self, joint_names: tuple[str, ...], workspace_dimension: int, tool_frame: str) -> None:
        """Check that the model is for a robot.

        Raises:
            ModelMismatchError: naming in which they differ.
        """
        found = (self.robot.workspace_dimension, self.robot.joint_names, self.robot.tool_frame)
        expected = (workspace_dimension, joint_names, tool_frame)
        for what, mine, theirs in zip(("workspace dimension", "joints", "tool frame"), found, expected, strict=True):
            if mine != theirs:
                raise ModelMismatchError(self.name, f"{what} of the robot", mine, theirs)

    def write(self, path: Path) -> None:
        """Write the card.

        Raises:
            ModelError: if that fails.
        """
        try:
            path.write_text(json.dumps(asdict(self), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        except OSError as error:
            raise ModelError(str(path), f"cannot be written: {error.strerror or error}") from error

    @staticmethod
    def read(path: Path) -> ModelCard:
        """Read a card.

        Raises:
            ModelError: if it cannot be read, or is none.
        """
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ModelError(str(path), f"cannot be read: {error}") from error
        found = content.get("format") if isinstance(content, dict) else None
        if found != FORMAT:
            raise ModelError(str(path), f"its format is {found}, expected {FORMAT}")
        try:
            robot: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in content.pop("robot").items()}
            limits = tuple(content.pop("limits", ()))
            return ModelCard(robot=ModelRobot(**robot), limits=limits, **content)
        except (KeyError, TypeError, AttributeError) as error:
            raise ModelError(str(path), f"is no model card: {error}") from error
