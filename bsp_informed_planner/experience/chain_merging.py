"""Merging of keypoints with paths between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.experience.record import Flags
from bsp_informed_planner.planning.path import without_repeats
from bsp_informed_planner.scene.pose import FloatArray


@dataclass(frozen=True, eq=False)
class MergedChain:
    """A chain after merging.

    Attributes:
        subpaths: k - 1 paths (m_i, n); keypoint i is the first state of path i, the last state that of the last path.
        merged: (k,) which keypoints stand for several.
    """

    subpaths: tuple[FloatArray, ...]
    merged: Flags

    @property
    def keypoints(self) -> FloatArray:
        """(k, n)"""
        return np.array([*(path[0] for path in self.subpaths), self.subpaths[-1][-1]])


def merge_chain(
    subpaths: tuple[FloatArray, ...],
    position: Callable[[FloatArray], FloatArray],
    epsilon: float,
    is_edge_free: Callable[[FloatArray, FloatArray], bool],
    keep_sight: bool,
) -> MergedChain:
    """Merges neighbouring keypoints closer than epsilon (paper, Algorithm 2, lines 17 to 22).

    Two keypoints become the state halfway along the path between them, which is free and of one branch, as their mean
    need not be; on a straight path of a point it is the paper's midpoint. Start and goal stay.

    Args:
        subpaths: free paths (m_i, n), each beginning where the one before ends.
        position: reference point (3,) of a configuration (n,) [m].
        epsilon: [m]
        is_edge_free: check of a straight edge.
        keep_sight: whether keypoints stay apart where a straight path would have to become a bent one.
    """
    kept: list[FloatArray] = []
    merged = [False]
    incoming, current_merged = subpaths[0], False
    outgoing = list(subpaths[1:])
    while len(outgoing) > 1:
        between, beyond = outgoing[0], outgoing[1]
        joined = None
        if np.linalg.norm(position(between[-1]) - position(between[0])) < epsilon:
            first, second = split_halfway(between)
            joined = (
                _joined(incoming, first, is_edge_free, keep_sight),
                _joined(second, beyond, is_edge_free, keep_sight),
            )
        if joined is None or joined[0] is None or joined[1] is None:
            kept.append(incoming)
            merged.append(current_merged)
            incoming, current_merged = between, False
            outgoing.pop(0)
        else:
            incoming, current_merged = joined[0], True
            outgoing[:2] = [joined[1]]
    kept.append(incoming)
    if outgoing:
        merged.append(current_merged)
        kept.append(outgoing[0])
    return MergedChain(tuple(kept), np.array([*merged, False], np.bool_))


def split_halfway(path: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The two halves of a path (m, n), equal in length; the second begins with the state that the first ends with."""
    lengths = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    half = 0.5 * lengths[-1]
    before = min(int(np.searchsorted(lengths, half, side="right")) - 1, len(path) - 2)
    step = lengths[before + 1] - lengths[before]
    share = (half - lengths[before]) / step if step > 0.0 else 0.5
    middle = path[before] + share * (path[before + 1] - path[before])
    return np.concatenate((path[: before + 1], middle[None])), np.concatenate((middle[None], path[before + 1 :]))


def _joined(
    first: FloatArray, second: FloatArray, is_edge_free: Callable[[FloatArray, FloatArray], bool], keep_sight: bool
) -> FloatArray | None:
    """One path of two, straight if it can be; None if it must bend although both were straight, and must not."""
    if is_edge_free(first[0], second[-1]):
        return np.array([first[0], second[-1]])
    if keep_sight and len(first) == len(second) == 2:
        return None
    return without_repeats(np.concatenate((first, second[1:])))
