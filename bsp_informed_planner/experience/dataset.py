"""Reading datasets of experience.

    experience = Experience.load("data/mazes", split="train", solved=True)
    for record in experience:                       # ProblemRecord: typed, arrays are views
        record.keypoints, record.subpaths, record.scene
    experience.starts                               # (count, n)
    experience.paths[3]                             # (m, n), a view

What the columns mean: `experience.record`; how they are stored: `experience.schema`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.errors import DatasetMismatchError, InvalidOptionError
from bsp_informed_planner.experience.column_store import Arrays, ColumnStore, NestedArrays
from bsp_informed_planner.experience.description import DatasetDescription, RobotIdentity
from bsp_informed_planner.experience.record import ProblemRecord
from bsp_informed_planner.experience.seeds import SPLITS
from bsp_informed_planner.experience.shards import list_shards
from bsp_informed_planner.scene.json_io import scene_from_json
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene


class Experience:
    """Problems of a dataset, or some of them. Immutable.

    Columns are read from disk when they are first asked for, and shared by all selections of a dataset.

    Attributes:
        description: what the dataset says of itself.
    """

    def __init__(self, description: DatasetDescription, store: ColumnStore, rows: NDArray[np.int64]) -> None:
        """Use `load`."""
        self.description = description
        self._store = store
        self._rows = rows

    @staticmethod
    def load(folder: str | Path, *, split: str | Sequence[str] | None = None, solved: bool | None = None) -> Experience:
        """The problems in a folder. One that is being collected still gives those that are finished.

        Args:
            folder: of the dataset.
            split: one or several of "train", "validation", "test"; None: all.
            solved: True or False for those that are solved or not; None: both.

        Raises:
            DatasetError: if it is no dataset, of another format, or damaged.
            InvalidOptionError: for a split that does not exist.
        """
        folder = Path(folder)
        description = DatasetDescription.read(folder)
        shards = list_shards(folder)
        for shard in shards:
            if shard.dof != description.robot.dof:
                raise DatasetMismatchError(str(shard.path), "joints of the robot", shard.dof, description.robot.dof)
        store = ColumnStore(folder, shards, description.robot.dof)
        everything = Experience(description, store, np.arange(store.rows))
        return everything.select(split=split, solved=solved)

    def select(self, *, split: str | Sequence[str] | None = None, solved: bool | None = None) -> Experience:
        """Those of a split, or that are solved or not; arguments and errors as for `load`."""
        keep = np.ones(len(self), np.bool_)
        if split is not None:
            wanted = (split,) if isinstance(split, str) else tuple(split)
            for name in wanted:
                if name not in SPLITS:
                    raise InvalidOptionError("split", name, f"one of {', '.join(SPLITS)}")
            keep &= np.isin(self._store.splits()[self._rows], [SPLITS.index(name) for name in wanted])
        if solved is not None:
            keep &= self.solved == solved
        return Experience(self.description, self._store, self._rows[keep])

    def subset(self, indices: Iterable[int] | NDArray[np.int64]) -> Experience:
        """Those at some indices, in that order."""
        chosen = np.fromiter(indices, np.int64) if not isinstance(indices, np.ndarray) else indices
        return Experience(self.description, self._store, self._rows[chosen])

    def require_robot(self, robot: RobotIdentity) -> None:
        """Check that the problems are of a robot.

        Raises:
            DatasetMismatchError: naming in which the robots differ.
        """
        mine = self.description.robot
        for what in ("workspace_dimension", "joint_names", "tool_frame", "fingerprint"):
            if getattr(mine, what) != getattr(robot, what):
                found, expected = getattr(mine, what), getattr(robot, what)
                raise DatasetMismatchError(str(self._store.folder), f"{what} of the robot", found, expected)

    @property
    def folder(self) -> Path:
        return self._store.folder

    @property
    def dof(self) -> int:
        """Joints n of the robot."""
        return self.description.robot.dof

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[ProblemRecord]:
        return (self.problem(index) for index in range(len(self)))

    def problem(self, index: int) -> ProblemRecord:
        """A problem with everything known of it; its arrays are views."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"problem {index} of {len(self)}")
        row, store = int(self._rows[index]), self._store
        return ProblemRecord(
            seed=int(store.numbers("seed")[row]),
            split=store.text("split", row),
            family=store.text("family", row),
            stratum=store.text("stratum", row),
            scene_json=store.text("scene", row),
            start=store.fixed("start")[row],
            goal=store.fixed("goal")[row],
            solved=bool(store.numbers("solved")[row]),
            failure=store.text("failure", row),
            path=store.ragged("path")[row],
            path_cost=float(store.numbers("path_cost")[row]),
            padding=float(store.numbers("padding")[row]),
            keypoints=store.ragged("keypoints")[row],
            keypoints_workspace=store.ragged("keypoints_workspace")[row],
            merged=store.flags("merged", row),
            subpaths=store.nested("subpaths")[row],
            chain_workspace=store.ragged("chain_workspace")[row],
            crossings=store.ragged("crossings")[row],
            crossings_workspace=store.ragged("crossings_workspace")[row],
            removals=int(store.numbers("removals")[row]),
            seconds=float(store.numbers("seconds")[row]),
        )

    def scene(self, index: int) -> Scene:
        """The scene of a problem."""
        return scene_from_json(self.scene_json(index), f"scene of problem {index} in {self.folder}")

    def scene_json(self, index: int) -> str:
        """The scene of a problem as it is stored; equal texts are equal scenes."""
        return self._store.text("scene", int(self._rows[index]))

    @property
    def seeds(self) -> NDArray[np.int64]:
        """(count,)"""
        return self._store.numbers("seed")[self._rows].astype(np.int64, copy=False)

    @property
    def solved(self) -> NDArray[np.bool_]:
        """(count,)"""
        return self._store.numbers("solved")[self._rows].astype(np.bool_, copy=False)

    @property
    def starts(self) -> FloatArray:
        """(count, n) [rad or m]"""
        return self._store.fixed("start")[self._rows]

    @property
    def goals(self) -> FloatArray:
        """(count, n) [rad or m]"""
        return self._store.fixed("goal")[self._rows]

    @property
    def path_costs(self) -> FloatArray:
        """(count,) [rad or m]; NaN without a path."""
        return self._store.numbers("path_cost")[self._rows]

    @property
    def paddings(self) -> FloatArray:
        """(count,) distance that paths keep from obstacles [m]."""
        return self._store.numbers("padding")[self._rows]

    @property
    def removals(self) -> NDArray[np.int64]:
        """(count,)"""
        return self._store.numbers("removals")[self._rows].astype(np.int64, copy=False)

    @property
    def seconds(self) -> FloatArray:
        """(count,) [s]"""
        return self._store.numbers("seconds")[self._rows]

    @property
    def strata(self) -> list[str]:
        """(count,)"""
        return self._store.texts("stratum", self._rows)

    @property
    def failures(self) -> list[str]:
        """(count,); empty where solved."""
        return self._store.texts("failure", self._rows)

    @property
    def splits(self) -> list[str]:
        """(count,)"""
        return [SPLITS[code] for code in self._store.splits()[self._rows]]

    @property
    def paths(self) -> Arrays:
        """(count) paths of whole problems, each (m, n)."""
        return self._store.ragged("path").subset(self._rows)

    @property
    def keypoints(self) -> Arrays:
        """(count) chains, each (k, n)."""
        return self._store.ragged("keypoints").subset(self._rows)

    @property
    def keypoints_workspace(self) -> Arrays:
        """(count) chains, each (k, 3) [m]."""
        return self._store.ragged("keypoints_workspace").subset(self._rows)

    @property
    def chains_workspace(self) -> Arrays:
        """(count) chains of the decomposition before merging, each (c, 3) [m]."""
        return self._store.ragged("chain_workspace").subset(self._rows)

    @property
    def crossings(self) -> Arrays:
        """(count) states of paths on portals, each (p, n)."""
        return self._store.ragged("crossings").subset(self._rows)

    @property
    def crossings_workspace(self) -> Arrays:
        """(count) the same in the workspace, each (p, 3) [m]."""
        return self._store.ragged("crossings_workspace").subset(self._rows)

    @property
    def subpaths(self) -> NestedArrays:
        """(count) tuples of the paths (m_i, n) between neighbouring keypoints."""
        return self._store.nested("subpaths").subset(self._rows)
