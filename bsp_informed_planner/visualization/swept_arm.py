"""The coarse shape of a robot, for markers of where it passes."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.shape_triangles import geometry_triangles

# Corners are merged on a grid of this width before their hull is taken [m].
GRID = 0.03
# Most poses along a path.
POSES = 6


class CoarseRobot:
    """Hulls of a robot's moving geometries, of some dozen triangles each: light enough to be sent with every plan.

    They are for the eye: within a grid step of the geometry, not around it.

    Args:
        robot: geometry that cannot be drawn is left out.
    """

    def __init__(self, robot: Robot) -> None:
        self._model = robot.model
        self._data = robot.model.createData()
        self._hulls: list[tuple[int, FloatArray]] = []
        for geometry in robot.collision_model.geometryObjects:
            corners = geometry_triangles(geometry.geometry)
            if geometry.parentJoint > 0 and corners is not None:
                placed = _coarse_hull(corners.reshape(-1, 3))
                placed = placed @ geometry.placement.rotation.T + geometry.placement.translation
                self._hulls.append((int(geometry.parentJoint), placed))

    def at(self, configuration: FloatArray) -> FloatArray:
        """(t, 3, 3) triangles in a configuration (n,), in the root frame [m]."""
        pin.forwardKinematics(self._model, self._data, np.asarray(configuration, dtype=np.float64))
        placements = self._data.oMi
        parts = [hull @ placements[j].rotation.T + placements[j].translation for j, hull in self._hulls]
        return np.concatenate(parts) if parts else np.empty((0, 3, 3))

    def swept(self, path: FloatArray) -> FloatArray:
        """The triangles of at most `POSES` states of a path (m, n), evenly spread from the first to the last."""
        states = path[np.unique(np.linspace(0, len(path) - 1, POSES).round().astype(np.int64))]
        return np.concatenate([self.at(state) for state in states])


def _coarse_hull(points: FloatArray) -> FloatArray:
    """(t, 3, 3) the hull of points (k, 3), with few triangles; none for what is too small to be seen."""
    if not len(points) or float(np.ptp(points, axis=0).max()) < 0.1 * GRID:
        return np.empty((0, 3, 3))
    coarse = np.unique((points / GRID).round(), axis=0) * GRID
    try:
        return np.asarray(coarse[ConvexHull(coarse).simplices])
    except (QhullError, ValueError):
        # On the grid it has no volume.
        return np.asarray(points[ConvexHull(points).simplices])
