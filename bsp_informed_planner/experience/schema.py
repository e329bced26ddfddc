"""The columns of a dataset, and how records become rows of them.

A dataset is a folder with

    dataset.json              what the problems are and what made them (`experience.description`)
    train-00000000.parquet    problems of the split "train" from index 0; validation-... and test-... likewise
    train-00000256.parquet    ... and from index 256

Every parquet file (a shard; zstd) has the columns of `columns()`, one row a problem, in the order of their index.
Arrays are flat lists, row by row: configuration 2 of a robot with 6 joints is values 12 to 17. Any parquet reader can
read them:

    seed                  int64                   dataset.json's seed, split and index in one number
    split                 string                  train, validation, test
    family, stratum       string
    scene                 string                  JSON of a scene file (`scene.json_io`)
    start, goal           list<double>            n values [rad or m]
    solved                bool
    failure               string                  empty if solved
    path                  list<double>            m x n
    path_cost             double                  [rad or m]; null without a path
    padding               double                  [m]
    keypoints             list<double>            k x n, with start and goal
    keypoints_workspace   list<double>            k x 3 [m]
    merged                list<bool>              k
    subpaths              list<list<double>>      k - 1 paths, each m_i x n
    chain_workspace       list<double>            c x 3 [m]
    crossings             list<double>            p x n
    crossings_workspace   list<double>            p x 3 [m]
    removals              int32
    seconds               double                  [s]

What each of them means is told by `experience.record.ProblemRecord`, whose fields have the same names.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from bsp_informed_planner.experience.record import ProblemRecord
from bsp_informed_planner.scene.pose import FloatArray

FORMAT = "bsp_informed_planner/experience/1"

#: Columns of flat lists; "n" stands for the number of joints.
ROW_WIDTHS: dict[str, int | str] = {
    "path": "n",
    "keypoints": "n",
    "keypoints_workspace": 3,
    "chain_workspace": 3,
    "crossings": "n",
    "crossings_workspace": 3,
}

_DOUBLES = pa.list_(pa.float64())
_SCHEMA = pa.schema(
    [
        pa.field("seed", pa.int64(), nullable=False),
        *(pa.field(name, pa.string(), nullable=False) for name in ("split", "family", "stratum", "scene")),
        *(pa.field(name, _DOUBLES, nullable=False) for name in ("start", "goal")),
        pa.field("solved", pa.bool_(), nullable=False),
        pa.field("failure", pa.string(), nullable=False),
        pa.field("path", _DOUBLES, nullable=False),
        pa.field("path_cost", pa.float64()),
        pa.field("padding", pa.float64(), nullable=False),
        *(pa.field(name, _DOUBLES, nullable=False) for name in ("keypoints", "keypoints_workspace")),
        pa.field("merged", pa.list_(pa.bool_()), nullable=False),
        pa.field("subpaths", pa.list_(_DOUBLES), nullable=False),
        *(pa.field(name, _DOUBLES, nullable=False) for name in ("chain_workspace", "crossings", "crossings_workspace")),
        pa.field("removals", pa.int32(), nullable=False),
        pa.field("seconds", pa.float64(), nullable=False),
    ]
)


def columns() -> pa.Schema:
    """The schema of a shard, without metadata."""
    return _SCHEMA


def table_of(records: Sequence[ProblemRecord], dof: int) -> pa.Table:
    """Records as rows.

    Args:
        records: of one robot.
        dof: its number of joints.

    Raises:
        ValueError: if a record is of another number of joints, its arrays do not fit together, or a value is not
            finite.
    """
    for record in records:
        _check(record, dof)
    arrays: list[pa.Array] = []
    for field in _SCHEMA:
        name = "scene_json" if field.name == "scene" else field.name
        values = [getattr(record, name) for record in records]
        if field.name == "path_cost":
            arrays.append(pa.array([None if np.isnan(value) else value for value in values], pa.float64()))
        elif field.name == "merged":
            arrays.append(pa.array([value.tolist() for value in values], field.type))
        elif field.name == "subpaths":
            inner = _lists([path for paths in values for path in paths])
            arrays.append(pa.ListArray.from_arrays(_offsets([len(paths) for paths in values]), inner))
        elif field.type == _DOUBLES:
            arrays.append(_lists(values))
        else:
            arrays.append(pa.array(values, field.type))
    return pa.Table.from_arrays(arrays, schema=_SCHEMA.with_metadata({"format": FORMAT, "dof": str(dof)}))


def _lists(arrays: Sequence[FloatArray]) -> pa.ListArray:
    flat = np.concatenate([np.zeros(0), *(np.ravel(array) for array in arrays)])
    return pa.ListArray.from_arrays(_offsets([np.size(array) for array in arrays]), pa.array(flat))


def _offsets(lengths: Sequence[int]) -> pa.Array:
    return pa.array(np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))).astype(np.int32))


def _check(record: ProblemRecord, dof: int) -> None:
    count = len(record.keypoints)
    shapes = {
        "start": (dof,),
        "goal": (dof,),
        "path": (len(record.path), dof),
        "keypoints": (count, dof if count else record.keypoints.shape[1]),
        "keypoints_workspace": (count, 3),
        "merged": (count,),
        "chain_workspace": (len(record.chain_workspace), 3),
        "crossings": (len(record.crossings), dof if len(record.crossings) else record.crossings.shape[1]),
        "crossings_workspace": (len(record.crossings), 3),
    }
    for name, shape in shapes.items():
        array = getattr(record, name)
        if array.shape != shape:
            raise ValueError(f"problem {record.seed}: {name} has the shape {array.shape}, expected {shape}")
        if not np.isfinite(array).all():
            raise ValueError(f"problem {record.seed}: a value of {name} is not finite")
    if len(record.subpaths) != max(count - 1, 0):
        raise ValueError(f"problem {record.seed}: {len(record.subpaths)} subpaths between {count} keypoints")
    for path in record.subpaths:
        if path.ndim != 2 or path.shape[1] != dof or not np.isfinite(path).all():
            raise ValueError(f"problem {record.seed}: a subpath is no array of {dof} columns of finite numbers")
    if record.solved != (not record.failure) or (record.solved and not (count and len(record.path))):
        raise ValueError(f"problem {record.seed}: solved, failure, keypoints and path contradict each other")
