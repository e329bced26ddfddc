"""Which bodies of a robot may touch which obstacles, as the verdict kernels read it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.body_groups import BodyGroups
from bsp_informed_planner.collision.check_arrays_kernels import ALL_MAY_TOUCH, SOME_MAY_TOUCH
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class AllowedContacts:
    """What groups of bodies may touch.

    Attributes:
        classes: of obstacles that some body may touch, by id; all others are of class 0.
        table: (g, c) sum of SOME_MAY_TOUCH and ALL_MAY_TOUCH, for each group and class.
    """

    classes: dict[str, int]
    table: NDArray[np.int64]


def allowed_contacts(robot: Robot, groups: BodyGroups, scene: Scene) -> AllowedContacts:
    """What a scene allows the groups of a robot's bodies to touch. Obstacles that the same bodies may touch are alike.

    Args:
        robot: with what it holds in the scene.
        groups: of its bodies.
        scene: its `allowed_collisions` between bodies of the robot and obstacles count.
    """
    visitors: dict[str, set[str]] = {}
    for pair in scene.allowed_collisions:
        for obstacle in pair & scene.obstacles.keys():
            visitors.setdefault(obstacle, set()).update(pair - {obstacle})
    kinds = sorted({*map(frozenset, visitors.values())}, key=sorted)
    numbers = {names: number for number, names in enumerate(kinds, 1)}
    table = np.zeros((len(groups.members), len(numbers) + 1), dtype=np.int64)
    items = robot.collision_model.geometryObjects
    for group, members in enumerate(groups.members):
        own = {str(robot.model.frames[items[index].parentFrame].name) for index in members}
        for names, number in numbers.items():
            if own & names:
                table[group, number] = SOME_MAY_TOUCH + (ALL_MAY_TOUCH if own <= names else 0)
    return AllowedContacts({obstacle: numbers[frozenset(names)] for obstacle, names in visitors.items()}, table)
