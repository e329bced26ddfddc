"""Columns of all shards of a dataset, read when first needed, as NumPy arrays on the memory of Arrow."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bsp_informed_planner.errors import DatasetError, DatasetMismatchError
from bsp_informed_planner.experience.record import Flags
from bsp_informed_planner.experience.schema import ROW_WIDTHS
from bsp_informed_planner.experience.seeds import SPLITS
from bsp_informed_planner.experience.shards import Shard, read_columns
from bsp_informed_planner.scene.pose import FloatArray

Indices = NDArray[np.int64]
_Ragged = tuple[FloatArray, NDArray[np.int32]]


class Arrays:
    """Arrays (m_i, width) of different lengths m_i, in the memory of their shards. Indexing gives a view."""

    def __init__(self, parts: Sequence[_Ragged], starts: Sequence[int], width: int, rows: Indices | None) -> None:
        """
        Args:
            parts: for each shard the values (v,) and the offsets (rows + 1,) into them.
            starts: the row at which each shard begins.
            width: of all arrays.
            rows: those that this is made of; None: all.
        """
        self._parts = parts
        self._starts = starts
        self._width = width
        self._rows = rows
        self._count = sum(len(offsets) - 1 for _, offsets in parts) if rows is None else len(rows)

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[FloatArray]:
        return (self[index] for index in range(len(self)))

    def __getitem__(self, index: int) -> FloatArray:
        if not -self._count <= index < self._count:
            raise IndexError(f"array {index} of {self._count}")
        index += self._count if index < 0 else 0
        row = index if self._rows is None else int(self._rows[index])
        shard = bisect_right(self._starts, row) - 1
        values, offsets = self._parts[shard]
        first = row - self._starts[shard]
        return values[offsets[first] : offsets[first + 1]].reshape(-1, self._width)

    def subset(self, rows: Indices) -> Arrays:
        """Those of some rows of this one, without copying a value."""
        return Arrays(self._parts, self._starts, self._width, rows if self._rows is None else self._rows[rows])

    def lengths(self) -> Indices:
        """(count,) m_i of each array."""
        every = [np.diff(offsets) for _, offsets in self._parts]
        lengths = np.concatenate([np.zeros(0, np.int64), *every]).astype(np.int64) // self._width
        return lengths if self._rows is None else lengths[self._rows]


class NestedArrays:
    """Tuples of arrays (m_ij, width), in the memory of their shards."""

    def __init__(
        self, outer: Sequence[NDArray[np.int32]], inner: Sequence[Arrays], starts: Sequence[int], rows: Indices | None
    ) -> None:
        """
        Args:
            outer: for each shard the offsets (rows + 1,) into the arrays of `inner`.
            inner: for each shard all of its arrays.
            starts, rows: as for `Arrays`.
        """
        self._outer = outer
        self._inner = inner
        self._starts = starts
        self._rows = rows
        self._count = sum(len(offsets) - 1 for offsets in outer) if rows is None else len(rows)

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[tuple[FloatArray, ...]]:
        return (self[index] for index in range(len(self)))

    def __getitem__(self, index: int) -> tuple[FloatArray, ...]:
        if not -self._count <= index < self._count:
            raise IndexError(f"tuple {index} of {self._count}")
        index += self._count if index < 0 else 0
        row = index if self._rows is None else int(self._rows[index])
        shard = bisect_right(self._starts, row) - 1
        first, last = self._outer[shard][row - self._starts[shard] :][:2].tolist()
        return tuple(self._inner[shard][part] for part in range(first, last))

    def subset(self, rows: Indices) -> NestedArrays:
        """Those of some rows of this one, without copying a value."""
        return NestedArrays(self._outer, self._inner, self._starts, rows if self._rows is None else self._rows[rows])


class ColumnStore:
    """The columns of a dataset.

    Args:
        folder: of the dataset.
        shards: its finished files.
        dof: joints n of its robot.

    Every method raises DatasetError if a shard cannot be read, or a number in it is not finite that should be.
    """

    def __init__(self, folder: Path, shards: Sequence[Shard], dof: int) -> None:
        self.folder = folder
        self._shards = tuple(shards)
        self._dof = dof
        self._starts: list[int] = np.cumsum([0, *(shard.rows for shard in shards)])[:-1].tolist()
        self.rows = sum(shard.rows for shard in shards)
        self._columns: dict[str, list[pa.Array]] = {}
        self._numbers: dict[str, NDArray[np.generic]] = {}
        self._ragged: dict[str, Arrays] = {}
        self._nested: dict[str, NestedArrays] = {}

    def splits(self) -> NDArray[np.int8]:
        """(rows,) place of each row's split in `SPLITS`."""
        codes = [np.full(shard.rows, SPLITS.index(shard.split), np.int8) for shard in self._shards]
        return np.concatenate([np.zeros(0, np.int8), *codes])

    def numbers(self, name: str) -> FloatArray:
        """(rows,) a column of numbers or flags; NaN for null."""
        if name not in self._numbers:
            parts = [column.to_numpy(zero_copy_only=False) for column in self._column(name)]
            self._numbers[name] = np.concatenate(parts) if parts else np.zeros(0)
        return self._numbers[name]  # type: ignore[return-value]

    def fixed(self, name: str) -> FloatArray:
        """(rows, n) a column of configurations."""
        if name not in self._numbers:
            parts = []
            for shard, column in zip(self._shards, self._column(name), strict=True):
                values, offsets = self._values(shard, name, column)
                if (np.diff(offsets) != self._dof).any():
                    found = sorted(set(np.diff(offsets).tolist()))
                    raise DatasetMismatchError(str(shard.path), f"values of {name}", found, self._dof)
                parts.append(values.reshape(-1, self._dof))
            array = np.concatenate(parts) if parts else np.zeros((0, self._dof))
            array.setflags(write=False)
            self._numbers[name] = array
        return self._numbers[name]  # type: ignore[return-value]

    def ragged(self, name: str) -> Arrays:
        """(rows) a column of arrays."""
        if name not in self._ragged:
            width = self._dof if ROW_WIDTHS[name] == "n" else int(ROW_WIDTHS[name])
            parts = []
            for shard, column in zip(self._shards, self._column(name), strict=True):
                parts.append(self._values(shard, name, column))
                self._require_whole_rows(shard, name, parts[-1][1], width)
            self._ragged[name] = Arrays(parts, self._starts, width, None)
        return self._ragged[name]

    def nested(self, name: str) -> NestedArrays:
        """(rows) a column of tuples of arrays of n columns."""
        if name not in self._nested:
            outer, inner = [], []
            for shard, column in zip(self._shards, self._column(name), strict=True):
                offsets = column.offsets.to_numpy()
                values = self._values(shard, name, column.values)
                self._require_whole_rows(shard, name, values[1], self._dof)
                outer.append(offsets)
                inner.append(Arrays([values], [0], self._dof, None))
            self._nested[name] = NestedArrays(outer, inner, self._starts, None)
        return self._nested[name]

    def flags(self, name: str, row: int) -> Flags:
        """The list of flags in one row."""
        shard, local = self._place(row)
        return np.array(self._column(name)[shard][local].as_py(), np.bool_)

    def text(self, name: str, row: int) -> str:
        """The string in one row."""
        shard, local = self._place(row)
        return str(self._column(name)[shard][local].as_py())

    def texts(self, name: str, rows: Indices) -> list[str]:
        """The strings in some rows."""
        every = [text for column in self._column(name) for text in column.to_pylist()]
        return [every[row] for row in rows]

    def _place(self, row: int) -> tuple[int, int]:
        shard = bisect_right(self._starts, row) - 1
        return shard, row - self._starts[shard]

    def _column(self, name: str) -> list[pa.Array]:
        if name not in self._columns:
            self._columns[name] = [read_columns(shard, [name]).column(0).combine_chunks() for shard in self._shards]
        return self._columns[name]

    def _values(self, shard: Shard, name: str, column: pa.ListArray) -> _Ragged:
        values = column.values.to_numpy()
        if not np.isfinite(values).all():
            raise DatasetError(str(shard.path), f"a value of {name} is not finite")
        return values, column.offsets.to_numpy()

    def _require_whole_rows(self, shard: Shard, name: str, offsets: NDArray[np.int32], width: int) -> None:
        if (np.diff(offsets) % width).any():
            raise DatasetError(str(shard.path), f"{name} holds no whole rows of {width} values")
