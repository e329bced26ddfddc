"""The way of a robot's reference point through the cells of a decomposition."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.decomposition.graph import visits_along
from bsp_informed_planner.planning.path import interpolate
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray

#: Visits to a cell shorter than this are no crossing of two portals, but of a corner where they meet [m].
SHORTEST_CROSSED = 1e-3


@dataclass(frozen=True, eq=False)
class ToolPath:
    """A path, and the reference point along it.

    Attributes:
        states: (s, n) along the path, all waypoints among them.
        points: (s, 3) the reference point there, in the plane of a 2D decomposition [m].
    """

    states: FloatArray
    points: FloatArray

    @staticmethod
    def of(robot: Robot, decomposition: Decomposition, path: FloatArray, step: float) -> ToolPath:
        """Follow a path (m, n) in steps [rad or m]; where joints only slide, the point moves straight anyway."""
        states = interpolate(path, step) if robot.revolute.any() else path
        return ToolPath(states, reference_points(robot, decomposition, states))

    def state_at(self, position: float) -> FloatArray:
        """The state (n,) at a position as of `visits_along`."""
        before = min(int(position), len(self.states) - 2)
        return np.asarray(self.states[before] + (position - before) * (self.states[before + 1] - self.states[before]))


def reference_points(robot: Robot, decomposition: Decomposition, configurations: FloatArray) -> FloatArray:
    """(s, 3) reference point of the robot in configurations (s, n), in the plane of a 2D decomposition [m]."""
    points = robot.reference_points(configurations)
    if decomposition.dimension == 2:
        points[:, 2] = decomposition.section_height
    return points


def reentry(decomposition: Decomposition, subpaths: Sequence[ToolPath], tolerance: float, detours: bool) -> int | None:
    """Where a path enters a cell that it has left (paper, ExaminePath, criterion 1).

    Args:
        decomposition: of the workspace.
        subpaths: the path in its parts, each beginning where the one before ends.
        tolerance: visits shorter than this do not count [m].
        detours: whether a part may leave a cell and come back to it before it ends. An arm that goes from one opening
            to the next swings out of the cell between them more often than not.

    Returns:
        index of the part in which it enters the cell again, or None if it never does.
    """
    points = np.concatenate([subpaths[0].points, *(path.points[1:] for path in subpaths[1:])])
    cells, begins = visits_along(decomposition, points, tolerance)
    ends = np.cumsum([len(path.points) - 1 for path in subpaths])
    part_of = np.minimum(np.searchsorted(ends, begins, side="right"), len(subpaths) - 1)
    left_in: dict[int, int] = {}
    for visit, (cell, part) in enumerate(zip(cells.tolist(), part_of.tolist(), strict=True)):
        if visit > 0:
            left_in[int(cells[visit - 1])] = part
        if cell in left_in and not (detours and left_in[cell] == part):
            return int(part)
    return None


def portal_crossings(decomposition: Decomposition, path: ToolPath) -> tuple[FloatArray, FloatArray]:
    """Where a path crosses portals, i.e. goes from one free cell to another.

    Returns:
        states (p, n) and points (p, 3) [m], in order.
    """
    cells, begins = visits_along(decomposition, path.points, SHORTEST_CROSSED)
    free: NDArray[np.bool_] = (cells >= 0) & ~decomposition.node_solid[cells]
    positions = begins[1:][free[1:] & free[:-1]]
    states = np.array([path.state_at(position) for position in positions]).reshape(-1, path.states.shape[1])
    points = np.array([ToolPath(path.points, path.points).state_at(p) for p in positions]).reshape(-1, 3)
    return states, points
