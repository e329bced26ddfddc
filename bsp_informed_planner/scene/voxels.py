"""Voxels of a point cloud: merged into boxes, and sorted into pieces that hang together."""

from __future__ import annotations

from functools import lru_cache
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.shapes import PointCloud

IndexArray = NDArray[np.int64]


def merged_boxes(cloud: PointCloud) -> tuple[FloatArray, FloatArray]:
    """Boxes whose union is the body of a point cloud, as `merge_voxels` finds them.

    The boxes are kept in memory by the voxels, so that a cloud of other points in the same voxels costs nothing.

    Returns:
        sizes (b, 3) and centres (b, 3) [m], in the frame of the cloud.
    """
    lower, upper = (corner.astype(np.float64) for corner in _merged(cloud.voxels.tobytes()))
    return (upper - lower) * cloud.resolution, (upper + lower) * (0.5 * cloud.resolution)


@lru_cache(maxsize=64)
def _merged(voxel_bytes: bytes) -> tuple[IndexArray, IndexArray]:
    return merge_voxels(np.frombuffer(voxel_bytes, dtype=np.int64).reshape(-1, 3))


def merge_voxels(voxels: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Disjoint boxes that cover the given voxels, all of them and nothing else.

    Neighbours along one axis become rods, equal rods side by side plates, and equal plates boxes. Of the six orders
    of the axes the one with the fewest boxes is taken. On depth images of shelves that is within a few percent of
    growing one largest box after the other, in a tenth of the time.

    Args:
        voxels: (n, 3) indices, each once.

    Returns:
        lower and upper corners (b, 3), in indices: a box holds the voxels i with lower <= i < upper.
    """
    best = voxels, voxels + 1
    for order in permutations(range(3)):
        boxes = voxels, voxels + 1
        for axis in order:
            boxes = _merged_along(axis, *boxes)
        if len(boxes[0]) < len(best[0]):
            best = boxes
    return best


def _merged_along(axis: int, lower: IndexArray, upper: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Boxes of the same cross-section that follow each other without a gap become one."""
    across = [other for other in range(3) if other != axis]
    section = [corner[:, other] for other in across for corner in (lower, upper)]
    order = np.lexsort((lower[:, axis], *section))
    lower, upper = lower[order], upper[order]
    begins = np.ones(len(lower), dtype=np.bool_)
    begins[1:] = lower[1:, axis] != upper[:-1, axis]
    for other in across:
        begins[1:] |= (lower[1:, other] != lower[:-1, other]) | (upper[1:, other] != upper[:-1, other])
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(lower)) - 1
    merged = upper[first]
    merged[:, axis] = upper[last, axis]
    return lower[first], merged


def connected_pieces(voxels: IndexArray) -> IndexArray:
    """Which voxels hang together: those that share a face, an edge or a corner.

    Args:
        voxels: (n, 3) indices, each once.

    Returns:
        (n,) the number of each voxel's piece, from 0.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    # A border of one voxel keeps the keys of neighbours across the edge apart.
    extents = tuple((np.ptp(voxels, axis=0) + 3).tolist())
    keys = np.ravel_multi_index(tuple((voxels - voxels.min(axis=0) + 1).T), extents)
    order = np.argsort(keys)
    ordered = keys[order]
    strides = np.array([extents[1] * extents[2], extents[2], 1])
    pairs = []
    # Half of the 26 neighbours; the others have this voxel among their half.
    for step in ((np.indices((3, 3, 3)).reshape(3, -1).T - 1) @ strides)[14:].tolist():
        place = np.searchsorted(ordered, ordered + step)
        found = np.flatnonzero(ordered[np.minimum(place, len(ordered) - 1)] == ordered + step)
        pairs.append((order[found], order[place[found]]))
    rows, columns = (np.concatenate(side) for side in zip(*pairs, strict=True))
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(voxels), len(voxels)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
