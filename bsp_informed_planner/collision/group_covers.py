"""Covers of one group of a robot's bodies; of what it holds, in a hurry."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import coal
import numpy as np
import pinocchio as pin

from bsp_informed_planner.collision.cover import CoverBuilder, CoverOptions
from bsp_informed_planner.collision.holding import HELD
from bsp_informed_planner.collision.solids import body_of
from bsp_informed_planner.errors import RobotDescriptionError
from bsp_informed_planner.robots.robot import Robot

#: Of bodies held, which somebody waits for: balls stand out as little as those of links, found among fewer cells and
#: candidates. It takes less than half the time, and decides as many configurations.
HELD_OPTIONS = CoverOptions(cells_per_protrusion=0.35, medial_samples=300)


def builder_of(robot: Robot, members: Sequence[int], options: CoverOptions | None = None) -> CoverBuilder:
    """The builder of the cover of a group.

    Args:
        robot: a robot.
        members: indices of the geometries of the group.
        options: None: the default for links, or for bodies held.

    Raises:
        RobotDescriptionError: if a geometry is of a kind that cannot be covered.
    """
    items = [robot.collision_model.geometryObjects[i] for i in members]
    if options is None:
        options = HELD_OPTIONS if str(items[0].name).startswith(HELD) else CoverOptions()
    bodies = []
    for item in items:
        try:
            bodies.append(body_of(item, 2.0 * options.protrusions[-1]))
        except ValueError as error:
            raise RobotDescriptionError(f"collision geometry '{item.name}' of '{robot.name}': {error}") from error
    return CoverBuilder(bodies, options)


@cache
def load_cover_kernels() -> None:
    """Load the kernels that covers are built with, once in a process: it takes longer than the cover of a body held."""
    box = pin.GeometryObject("box", 0, pin.SE3.Identity(), coal.Box(*np.full(3, 0.1).tolist()))
    builder = CoverBuilder([body_of(box, 0.05)], CoverOptions(protrusions=(0.03, 0.01), medial_samples=50))
    builder.build()
    builder.cover()
