"""Portals in pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.palette import PORTAL
from bsp_informed_planner.visualization.renderer import Layer
from bsp_informed_planner.visualization.shape_triangles import polygon_triangles
from bsp_informed_planner.visualization.triangle_mesh import TriangleMesh

# A keypoint belongs to the portal of a candidate that is at most so far away [m]: merging moves keypoints a little.
SAME_KEYPOINT = 0.02
# Corners nearer than this to the border of the workspace touch it [m].
BORDER = 1e-6


def keypoint_portals(decomposition: Decomposition, keypoints: FloatArray) -> NDArray[np.int64]:
    """The portals (p,), ascending, of the candidates that keypoints (k, 3) [m] are; none for those from elsewhere."""
    if not len(keypoints) or not decomposition.candidate_count:
        return np.empty(0, dtype=np.int64)
    distances = np.linalg.norm(decomposition.candidates[None] - keypoints[:, None], axis=2)
    nearest = distances.argmin(axis=1)
    close = distances[np.arange(len(keypoints)), nearest] <= SAME_KEYPOINT
    return np.unique(decomposition.candidate_portals[nearest[close]])


def inner_portals(decomposition: Decomposition) -> NDArray[np.int64]:
    """The portals (p,) that do not touch the border of the workspace; in 2D of the section."""
    axes = decomposition.dimension
    corners, bounds = decomposition.portal_corners[:, :axes], decomposition.bounds
    touches = ((corners < bounds.lower[:axes] + BORDER) | (corners > bounds.upper[:axes] - BORDER)).any(axis=1)
    owners = np.arange(decomposition.portal_count).repeat(np.diff(decomposition.portal_offsets))
    return np.setdiff1d(np.arange(decomposition.portal_count), owners[touches])


def portal_triangles(decomposition: Decomposition, portals: NDArray[np.int64]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Triangles (t, 3, 3) [m] of some portals (p,), and the portal of each triangle (t,)."""
    parts = [polygon_triangles(decomposition.portal(int(portal))) for portal in portals]
    if not parts:
        return np.empty((0, 3, 3)), np.empty(0, dtype=np.int64)
    return np.concatenate(parts), np.asarray(portals).repeat([len(part) for part in parts])


def portal_layer(decomposition: Decomposition, portals: NDArray[np.int64], alpha: float = 0.22) -> Layer:
    """Some portals (p,) as translucent polygons with outlines."""
    triangles, owners = portal_triangles(decomposition, portals)
    mesh = TriangleMesh(triangles, np.zeros_like(triangles))
    return Layer(mesh, np.array(PORTAL), owners, alpha, 0.8, shaded=False)
