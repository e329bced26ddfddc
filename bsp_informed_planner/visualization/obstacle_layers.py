"""Obstacles in pictures: which of them must be seen through, and from where to look."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import HalfSpace
from bsp_informed_planner.visualization.camera import Camera, looking
from bsp_informed_planner.visualization.palette import FURNITURE, ITEM, Colour
from bsp_informed_planner.visualization.rasterizer import nearness_of
from bsp_informed_planner.visualization.renderer import Layer, is_hidden
from bsp_informed_planner.visualization.shape_triangles import shape_triangles
from bsp_informed_planner.visualization.triangle_mesh import TriangleMesh

# A body that is at least so large belongs to the surroundings; smaller ones are things in it [m].
FURNITURE_EXTENT = 0.35
# An obstacle that hides more than this share of what is to be seen is drawn as if of glass.
HIDDEN_SHARE = 0.02
GLASS_ALPHA, GLASS_EDGE_ALPHA = 0.10, 0.40
# Size of the pictures that such questions are decided on, relative to the real one.
PREVIEW = 0.25


@dataclass(frozen=True, eq=False)
class ObstacleBody:
    """One shape of an obstacle.

    Attributes:
        id: of the obstacle.
        mesh: in the frame of the scene [m].
        bounded: False for a half-space.
    """

    id: str
    mesh: TriangleMesh
    bounded: bool = True

    @property
    def colour(self) -> Colour:
        extent = float(np.ptp(self.mesh.points, axis=0).max())
        return FURNITURE if extent >= FURNITURE_EXTENT else ITEM


def obstacle_bodies(scene: Scene) -> list[ObstacleBody]:
    """All shapes of all obstacles that have a surface within the bounds of the scene."""
    bodies = []
    for obstacle in scene.obstacles.values():
        for shape, pose in obstacle.placed_shapes():
            mesh = TriangleMesh.of(shape_triangles(shape, pose, scene.bounds))
            if len(mesh):
                bodies.append(ObstacleBody(obstacle.id, mesh, not isinstance(shape, HalfSpace)))
    return bodies


def obstacle_layers(
    bodies: Sequence[ObstacleBody], camera: Camera, targets: FloatArray
) -> tuple[list[Layer], list[bool]]:
    """Layers of obstacles, those made of glass that would hide too much of what is to be seen.

    Args:
        bodies: the obstacles.
        camera: from where they are seen.
        targets: (m, 3) points that are to be seen [m].

    Returns:
        the layers, and for each whether it is of glass.
    """
    preview = camera.resized(PREVIEW)
    glass = [
        len(targets) > 0 and bool(is_hidden(preview, nearness_of(preview, body.mesh), targets).mean() > HIDDEN_SHARE)
        for body in bodies
    ]
    layers = [
        Layer(
            body.mesh,
            np.array(body.colour),
            np.zeros(len(body.mesh), dtype=np.int64),
            GLASS_ALPHA if clear else 1.0,
            GLASS_EDGE_ALPHA if clear else 0.35,
        )
        for body, clear in zip(bodies, glass, strict=True)
    ]
    return layers, glass


def points_to_fit(
    bodies: Sequence[ObstacleBody], focus: FloatArray, bounds: WorkspaceBounds, reach: float = 0.8
) -> FloatArray:
    """Points that a picture has to hold: those of interest, and what of the obstacles is near them.

    Args:
        bodies: the obstacles.
        focus: (m, 3) points of interest; none: all obstacles, or the bounds without any [m].
        bounds: of the workspace.
        reach: how far around the box of the points of interest obstacles are in the picture [m].
    """
    solids = [body.mesh.points for body in bodies if body.bounded]
    if len(focus):
        low, high = focus.min(axis=0) - reach, focus.max(axis=0) + reach
        return np.concatenate([focus, *(np.clip(points, low, high) for points in solids)])
    return np.concatenate(solids) if solids else np.stack((bounds.lower, bounds.upper))


def aligned_azimuth(obstacles: TriangleMesh, azimuth: float) -> float:
    """The direction nearest to an azimuth in which most of the upright surfaces are faced or seen edge-on [rad].

    Upright surfaces count by their area, modulo quarter turns. Without any, it is the azimuth itself.
    """
    areas = np.cross(
        obstacles.corners[:, 1] - obstacles.corners[:, 0], obstacles.corners[:, 2] - obstacles.corners[:, 0]
    )
    lengths = np.linalg.norm(areas, axis=1)
    upright = (np.abs(areas[:, 2]) < 0.02 * lengths) & (lengths > 0.0)
    if not upright.any():
        return azimuth
    # Four times the angle is the same for all quarter turns; directions in degrees, the areas of each added up.
    angles = np.arctan2(areas[upright, 1], areas[upright, 0])
    bins = np.round(np.degrees(angles)).astype(int) % 90
    heaviest = np.bincount(bins, lengths[upright], minlength=90).argmax()
    inside = bins == heaviest
    turn = 0.25 * float(np.angle((lengths[upright][inside] * np.exp(4j * angles[inside])).sum()))
    return turn + 0.5 * math.pi * round((azimuth - turn) / (0.5 * math.pi))


def best_view(
    obstacles: TriangleMesh,
    fit: FloatArray,
    targets: FloatArray,
    azimuths: Sequence[float],
    elevations: Sequence[float],
    width: int,
    height: int,
    field_of_view: float | None = math.radians(32.0),
) -> Camera:
    """Of several views the one in which most of the targets are seen, and far apart.

    Args:
        obstacles: what hides them.
        fit: (k, 3) points that the picture has to hold [m].
        targets: (m, 3) points that are to be seen [m].
        azimuths, elevations: of the eye, all combinations of which are tried, the preferred ones first [rad].
        width, height: of the image in pixels.
        field_of_view: see `Camera.fitted`.
    """
    best: tuple[float, Camera] | None = None
    for elevation in elevations:
        for azimuth in azimuths:
            camera = Camera.fitted(fit, looking(azimuth, elevation), width, height, field_of_view=field_of_view)
            score = 0.0
            if len(targets):
                preview = camera.resized(0.5 * PREVIEW)
                spread = np.ptp(preview.project(targets)[:, :2], axis=0)
                score = float(np.hypot(*spread)) / math.hypot(preview.width, preview.height)
                if len(obstacles):
                    score -= float(is_hidden(preview, nearness_of(preview, obstacles), targets).mean())
            if best is None or score > best[0] + 0.02:
                best = score, camera
    if best is None:
        raise ValueError("no azimuth or no elevation to look from")
    return best[1]
