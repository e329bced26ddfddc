"""What a dataset says of itself: robot, problems, parameters and versions (`dataset.json`)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from bsp_informed_planner.errors import DatasetError, DatasetMismatchError
from bsp_informed_planner.experience.schema import FORMAT
from bsp_informed_planner.experience.shards import write_atomically

FILE_NAME = "dataset.json"


@dataclass(frozen=True)
class RobotIdentity:
    """Which robot the problems are of.

    Attributes:
        name: from its description.
        joint_names: (n,).
        lower, upper: (n,) limits [rad or m].
        workspace_dimension: 2 or 3.
        root_frame, tool_frame: of scenes and of keypoints.
        fingerprint: hash of all that decides where its bodies are and what they touch.
    """

    name: str
    joint_names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    workspace_dimension: int
    root_frame: str
    tool_frame: str
    fingerprint: str

    @property
    def dof(self) -> int:
        """Number of joints n."""
        return len(self.joint_names)


@dataclass(frozen=True)
class DatasetDescription:
    """Everything that the rows of a dataset depend on. The same description gives the same rows.

    Attributes:
        robot: of all problems.
        family: where scenes and problems come from.
        seed: of the collection.
        shard_size: problems in a file.
        parameters: of the generator and of Algorithm 2, by group.
        versions: of this package, of its sources and of the libraries that decide results.
        format: of the files.
    """

    robot: RobotIdentity
    family: str
    seed: int
    shard_size: int
    parameters: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    format: str = FORMAT

    def to_json(self) -> str:
        """As text, for people too."""
        return json.dumps(asdict(self), indent=2, ensure_ascii=False) + "\n"

    def write(self, folder: Path) -> None:
        """Write `dataset.json` into a folder.

        Raises:
            DatasetError: if it cannot be written.
        """
        text = self.to_json()
        write_atomically(folder / FILE_NAME, lambda path: path.write_text(text, encoding="utf-8"))

    @staticmethod
    def read(folder: Path) -> DatasetDescription:
        """The description of a dataset.

        Raises:
            DatasetError: if the folder has none, or it is of another format.
        """
        path = folder / FILE_NAME
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError as error:
            raise DatasetError(str(folder), f"is no dataset: it has no {FILE_NAME}") from error
        except (OSError, ValueError) as error:
            raise DatasetError(str(path), f"cannot be read: {error}") from error
        version = content.get("format") if isinstance(content, dict) else None
        if version != FORMAT:
            raise DatasetError(str(path), f"its format is {version}, expected {FORMAT}")
        try:
            robot: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in content.pop("robot").items()}
            return DatasetDescription(RobotIdentity(**robot), **content)
        except (KeyError, TypeError, AttributeError) as error:
            raise DatasetError(str(path), f"is no description of a dataset: {error}") from error

    def require_same(self, other: DatasetDescription, folder: Path) -> None:
        """Check that a collection described by `other` may go on in the dataset described by this.

        Raises:
            DatasetMismatchError: naming the first value that differs.
        """
        mine, theirs = _leaves(json.loads(self.to_json())), _leaves(json.loads(other.to_json()))
        for name in sorted(mine.keys() | theirs.keys()):
            if mine.get(name) != theirs.get(name):
                raise DatasetMismatchError(str(folder), name, mine.get(name), theirs.get(name))


def _leaves(content: Any, name: str = "") -> dict[str, Any]:
    """Every value of nested mappings, by its dotted name."""
    if not isinstance(content, dict):
        return {name: content}
    leaves: dict[str, Any] = {}
    for key, value in content.items():
        leaves.update(_leaves(value, f"{name}.{key}" if name else key))
    return leaves
