"""Groups of a robot's bodies that one joint carries and that are checked against the same others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bsp_informed_planner.collision.holding import HELD


@dataclass(frozen=True, eq=False)
class BodyGroups:
    """The groups of a robot's geometries.

    Attributes:
        members: indices of the geometries of each group.
        joints: (g,) the joint of each group, 0 for none.
        pairs: (p, 2) groups whose bodies are checked against each other.
    """

    members: tuple[tuple[int, ...], ...]
    joints: NDArray[np.int64]
    pairs: NDArray[np.int64]


def group_bodies(collision_model: pin.GeometryModel) -> BodyGroups:
    """Groups of geometries, such that two groups are checked against each other in all pairs of bodies, or in none.

    What the robot holds is apart: the covers of its links do not depend on it, and it may touch what they may not.
    Bodies that neither move nor are checked against another are in no group.
    """
    items = list(collision_model.geometryObjects)
    partners: list[set[int]] = [set() for _ in items]
    for pair in collision_model.collisionPairs:
        partners[pair.first].add(pair.second)
        partners[pair.second].add(pair.first)
    groups: dict[tuple[int, frozenset[int], str], list[int]] = {}
    for index, item in enumerate(items):
        if item.parentJoint > 0 or partners[index]:
            held = str(item.name).rsplit("/", 1)[0] if str(item.name).startswith(HELD) else ""
            groups.setdefault((int(item.parentJoint), frozenset(partners[index]), held), []).append(index)
    members = tuple(tuple(group) for group in groups.values())
    group_of = {index: number for number, group in enumerate(members) for index in group}
    pairs = sorted({tuple(sorted((group_of[i], group_of[j]))) for i in group_of for j in partners[i]})
    return BodyGroups(
        members,
        np.array([joint for joint, _, _ in groups], dtype=np.int64),
        np.array(pairs, dtype=np.int64).reshape(-1, 2),
    )
