"""Cells, portals, keypoint candidates and graph of a decomposition in a page."""

from __future__ import annotations

from typing import Any

import numpy as np

from bsp_informed_planner.decomposition.array_types import Indices
from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.cell_edges import cell_edges
from bsp_informed_planner.visualization.palette import CANDIDATE, CELL, GRAPH, PORTAL
from bsp_informed_planner.visualization.portals import inner_portals, portal_triangles
from bsp_informed_planner.visualization.viewer.scene_layer import section_of
from bsp_informed_planner.visualization.viewer.server import Viewer, rgb
from bsp_informed_planner.visualization.viewer.switches import LegendEntry, Switch

# More lines than this make a browser slow: of larger graphs so many edges are drawn.
MOST_EDGES = 20_000
# Ends of a cell's edge that are so near the plane of a section lie in it, relative to the height of the slab.
IN_SECTION = 1e-6


class DecompositionLayer:
    """All free cells, portals, candidates and edges of the graph, with switches for each.

    Attributes:
        cells, portals, outer_portals, candidates, graph: what is shown and hidden.
    """

    def __init__(self, viewer: Viewer, decomposition: Decomposition, *, on: bool = True) -> None:
        """
        Args:
            viewer: the page.
            decomposition: what is shown.
            on: whether cells, portals and candidates are shown at first.
        """
        self._viewer = viewer
        self.cells = Switch(viewer, "Free cells", on=on, hint="Edges of all free cells.")
        self.portals = Switch(viewer, "Portals", on=on, hint="Where two free cells touch, between obstacles.")
        self.outer_portals = Switch(
            viewer, "Portals at the border", on=False, hint="The others: those that touch the border of the workspace."
        )
        self.candidates = Switch(viewer, "Keypoint candidates", on=on, hint="Points on portals.")
        self.graph = Switch(
            viewer, "Graph", on=False, hint=f"Lines between candidates that see each other; {MOST_EDGES:,} at most."
        )
        self.show(decomposition)

    @staticmethod
    def legend() -> list[LegendEntry]:
        """What its colours mean."""
        return [
            LegendEntry(CELL, "free cells: convex pieces of space without obstacles", "line"),
            LegendEntry(PORTAL, "portals: where two free cells touch"),
            LegendEntry(CANDIDATE, "keypoint candidates: points on portals", "dot"),
            LegendEntry(GRAPH, "graph: candidates of one cell see each other", "line"),
        ]

    def show(self, decomposition: Decomposition) -> None:
        """Shows another decomposition."""
        with self._viewer.lock:
            size = 0.7 * mark_size(decomposition)
            scene = self._viewer.server.scene
            self.cells.replace(lines(self._viewer, "/decomposition/cells", flat_edges(decomposition), rgb(CELL), 1.2))
            inner = inner_portals(decomposition)
            outer = np.setdiff1d(np.arange(decomposition.portal_count), inner)
            for switch, name, portals in (
                (self.portals, "portals", inner),
                (self.outer_portals, "outer_portals", outer),
            ):
                switch.replace(portal_nodes(self._viewer, f"/decomposition/{name}", decomposition, portals))
            points = decomposition.candidates
            self.candidates.replace(
                [
                    scene.add_point_cloud(
                        "/decomposition/candidates", points, rgb(CANDIDATE), point_size=size, point_shape="circle",
                        precision="float32", point_shading="flat",
                    )
                ]
                if len(points)
                else []
            )  # fmt: skip
            self.graph.replace_when_on(
                lambda: lines(self._viewer, "/decomposition/graph", points[some_edges(decomposition)], rgb(GRAPH), 0.8)
            )


def lines(
    viewer: Viewer, name: str, segments: FloatArray, colour: tuple[int, int, int] | FloatArray, thickness: float
) -> list[Any]:
    """A node of segments (s, 2, 3) [m], so many pixels thick; none without segments."""
    if not len(segments):
        return []
    return [
        viewer.server.scene.add_line_segments(name, segments, colour, thickness=thickness, thickness_units="screen")
    ]


def portal_nodes(
    viewer: Viewer, name: str, decomposition: Decomposition, portals: Indices, opacity: float = 0.18
) -> list[Any]:
    """Some portals (p,) as translucent polygons with outlines; in a section as lines."""
    if not len(portals):
        return []
    outlines = [closed_loop(decomposition.portal(int(portal))) for portal in portals]
    height = section_of(decomposition)
    if height is not None:
        flat = np.concatenate([section_of_loop(loop, height) for loop in outlines])
        return lines(viewer, f"{name}/outlines", flat, rgb(PORTAL), 4.0)
    triangles, _ = portal_triangles(decomposition, portals)
    faces = viewer.server.scene.add_mesh_simple(
        f"{name}/faces",
        triangles.reshape(-1, 3),
        np.arange(3 * len(triangles)).reshape(-1, 3),
        color=rgb(PORTAL),
        opacity=opacity,
        flat_shading=True,
        side="double",
        cast_shadow=False,
        receive_shadow=False,
    )
    return [faces, *lines(viewer, f"{name}/outlines", np.concatenate(outlines), rgb(PORTAL), 1.5)]


def closed_loop(polygon: FloatArray) -> FloatArray:
    """(k, 2, 3) edges of a polygon (k, 3)."""
    return np.stack((polygon, np.roll(polygon, -1, axis=0)), axis=1)


def section_of_loop(edges: FloatArray, height: float) -> FloatArray:
    """(1, 2, 3), the segment in which a plane at a height cuts an upright polygon of edges (k, 2, 3) [m]."""
    z = edges[:, :, 2]
    crossing = (z.min(axis=1) < height) & (z.max(axis=1) > height)
    rising = edges[crossing]
    share = (height - rising[:, 0, 2]) / (rising[:, 1, 2] - rising[:, 0, 2])
    points = rising[:, 0] + share[:, None] * (rising[:, 1] - rising[:, 0])
    return points[None] if len(points) == 2 else np.empty((0, 2, 3))


def flat_edges(decomposition: Decomposition) -> FloatArray:
    """(e, 2, 3) edges of all free cells [m]; of a section those around its polygons, at its height."""
    edges = cell_edges(decomposition)
    height = section_of(decomposition)
    if height is None or not len(edges):
        return edges
    # The cells are upright prisms: each side of a polygon is an edge on top.
    top = float(decomposition.bounds.upper[2])
    upper = edges[(np.abs(edges[:, :, 2] - top) <= IN_SECTION * (top - height)).all(axis=1)]
    upper[:, :, 2] = height
    return upper


def some_edges(decomposition: Decomposition, most: int = MOST_EDGES) -> Indices:
    """(e, 2) edges of the graph, an even choice of so many if there are more."""
    edges = decomposition.edges()
    return edges[np.linspace(0, len(edges) - 1, most).astype(np.int64)] if len(edges) > most else edges


def mark_size(decomposition: Decomposition) -> float:
    """Diameter of a keypoint candidate [m]."""
    bounds = decomposition.bounds
    return float(np.clip(0.005 * (bounds.upper - bounds.lower).max(), 0.004, 0.03))
