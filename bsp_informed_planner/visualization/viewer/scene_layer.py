"""Obstacles of a scene in a page."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.scene.polytopes import cross_section, polytopes_of_obstacle, prism
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import HalfSpace
from bsp_informed_planner.visualization.obstacle_layers import ObstacleBody, obstacle_bodies
from bsp_informed_planner.visualization.palette import CELL, FURNITURE, ITEM, WALL
from bsp_informed_planner.visualization.shape_triangles import polytope_triangles
from bsp_informed_planner.visualization.triangle_mesh import TriangleMesh
from bsp_informed_planner.visualization.viewer.server import Viewer, rgb
from bsp_informed_planner.visualization.viewer.switches import LegendEntry, Switch

# Height of the plates that stand for obstacles in a section, relative to the longest edge of the workspace.
PLATE = 0.015


class SceneLayer:
    """The obstacles and the box of the workspace, with switches for them.

    Attributes:
        obstacles, workspace: what is shown and hidden.
        bodies: the shapes of all obstacles.
    """

    def __init__(self, viewer: Viewer, scene: Scene, *, section: float | None = None, opacity: float = 1.0) -> None:
        """
        Args:
            viewer: the page.
            scene: the obstacles.
            section: height of a horizontal plane of which obstacles are shown as plates below it [m]; None for space.
            opacity: of the obstacles.
        """
        self._viewer = viewer
        self.section = section
        self._bounds = scene.bounds
        self.bodies: list[ObstacleBody] = []
        self.obstacles = Switch(viewer, "Obstacles")
        self.opacity = viewer.server.gui.add_slider(
            "Opacity", 0.05, 1.0, 0.05, opacity, hint="Of the obstacles: less lets you look inside."
        )
        self.opacity.on_update(lambda _: self._set_opacity())
        self.workspace = Switch(viewer, "Workspace")
        self.show(scene)

    @staticmethod
    def legend(section: bool = False) -> list[LegendEntry]:
        """What its colours mean."""
        if section:
            return [LegendEntry(WALL, "obstacles, cut at the height of the section")]
        return [LegendEntry(FURNITURE, "obstacles: large"), LegendEntry(ITEM, "obstacles: small things")]

    def show(self, scene: Scene) -> None:
        """Shows another scene."""
        with self._viewer.lock:
            self._bounds = scene.bounds
            plates = None if self.section is None else section_plates(scene, self.section)
            self.bodies = obstacle_bodies(scene) if plates is None else plates
            nodes = []
            for number, body in enumerate(self.bodies):
                points = body.mesh.points
                nodes.append(
                    self._viewer.server.scene.add_mesh_simple(
                        f"/scene/obstacles/{number}",
                        points,
                        np.arange(len(points)).reshape(-1, 3),
                        color=rgb(body.colour if self.section is None else WALL),
                        opacity=_opacity(self.opacity.value),
                        flat_shading=True,
                        side="double",
                    )
                )
            self.obstacles.replace(nodes)
            box = self._viewer.server.scene.add_line_segments(
                "/scene/workspace", box_edges(scene.bounds, self.section), rgb(CELL), thickness=2.0,
                thickness_units="screen",
            )  # fmt: skip
            self.workspace.replace([box])

    def extent(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper corner (3,), (3,) of a box around the obstacles, or the workspace without any [m]."""
        points = [body.mesh.points for body in self.bodies if body.bounded]
        if not points or self.section is not None:
            return self._bounds.lower, self._bounds.upper
        corners = np.concatenate(points)
        return (
            np.maximum(corners.min(axis=0), self._bounds.lower),
            np.minimum(corners.max(axis=0), self._bounds.upper),
        )

    def _set_opacity(self) -> None:
        with self._viewer.lock:
            for node in self.obstacles.nodes:
                node.opacity = _opacity(self.opacity.value)


def _opacity(value: float) -> float | None:
    """What is opaque is drawn in another way than what is nearly so."""
    return None if value >= 1.0 else value


def box_edges(bounds: WorkspaceBounds, section: float | None = None) -> FloatArray:
    """(e, 2, 3) edges of a box, or of its section at a height [m]."""
    low, high = (bounds.lower[2], bounds.upper[2]) if section is None else (section, section)
    x, y = (bounds.lower[0], bounds.upper[0]), (bounds.lower[1], bounds.upper[1])
    ring = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
    edges = [((*a, z), (*b, z)) for z in (low, high) for a, b in zip(ring, ring[1:] + ring[:1], strict=True)]
    if section is None:
        edges += [((*corner, low), (*corner, high)) for corner in ring]
    return np.array(edges)


def section_plates(scene: Scene, height: float) -> list[ObstacleBody]:
    """The cross-sections of all obstacles, as plates whose tops are at a height [m]."""
    thickness = PLATE * float((scene.bounds.upper - scene.bounds.lower)[:2].max())
    bodies = []
    for obstacle in scene.obstacles.values():
        for part in polytopes_of_obstacle(obstacle, scene.bounds):
            polygon = cross_section(part, height)
            if polygon is not None:
                mesh = TriangleMesh.of(polytope_triangles(prism(polygon, height - thickness, height)))
                bounded = not any(isinstance(shape, HalfSpace) for shape, _ in obstacle.shapes)
                bodies.append(ObstacleBody(obstacle.id, mesh, bounded))
    return bodies


def section_of(decomposition: Decomposition) -> float | None:
    """Height of the plane that a decomposition is of, None in space [m]."""
    return decomposition.section_height if decomposition.dimension == 2 else None
