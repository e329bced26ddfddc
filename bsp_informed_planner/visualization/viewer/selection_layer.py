"""One cell, or one portal, of a decomposition in a page."""

from __future__ import annotations

from typing import Any

import numpy as np

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.scene.convex_polytope import ConvexPolytope
from bsp_informed_planner.visualization.palette import GRAPH, KEYPOINT, START, Colour
from bsp_informed_planner.visualization.shape_triangles import polytope_triangles
from bsp_informed_planner.visualization.viewer.decomposition_layer import (
    closed_loop,
    lines,
    mark_size,
    portal_nodes,
    section_of_loop,
)
from bsp_informed_planner.visualization.viewer.scene_layer import section_of
from bsp_informed_planner.visualization.viewer.server import Viewer, rgb
from bsp_informed_planner.visualization.viewer.switches import LegendEntry, Switch

CHOSEN: Colour = START


class SelectionLayer:
    """A cell that is chosen by its number, with its portals, candidates and edges; and a portal with its two cells.

    Attributes:
        cell, portal: what is shown and hidden.
        cell_number, portal_number: sliders; the cell's is a position in `Decomposition.free_cells`.
    """

    def __init__(self, viewer: Viewer, decomposition: Decomposition) -> None:
        self._viewer = viewer
        self._decomposition = decomposition
        gui = viewer.server.gui
        self._cells = decomposition.free_cells
        self._portals_of_cells = decomposition.portal_cells
        with gui.add_folder("One cell, one portal"):
            self.cell = Switch(viewer, "Show one cell", on=False, hint="Blue, with its portals, candidates and edges.")
            self.cell_number = gui.add_slider("Cell", 0, max(len(self._cells) - 1, 0), 1, 0)
            self.portal = Switch(viewer, "Show one portal", on=False, hint="Green, with the two cells that it joins.")
            self.portal_number = gui.add_slider("Portal", 0, max(decomposition.portal_count - 1, 0), 1, 0)
            self._text = gui.add_markdown("")
        for handle in (self.cell_number, self.cell.box, self.portal_number, self.portal.box):
            handle.on_update(lambda _: self._choose())
        self._choose()

    @staticmethod
    def legend() -> list[LegendEntry]:
        """What its colours mean."""
        return [LegendEntry(CHOSEN, "the chosen cell, or the cells of the chosen portal")]

    @property
    def description(self) -> str:
        """What is said about the choice."""
        return str(self._text.content)

    def _choose(self) -> None:
        with self._viewer.lock:
            said = []
            if self.cell.is_on and len(self._cells):
                cell = int(self._cells[self.cell_number.value])
                self.cell.replace(self._cell_nodes("/chosen/cell", cell, with_portals=True))
                said.append(self._about_cell(cell))
            else:
                self.cell.replace([])
            if self.portal.is_on and self._decomposition.portal_count:
                portal = self.portal_number.value
                nodes = portal_nodes(
                    self._viewer, "/chosen/portal", self._decomposition, np.array([portal]), opacity=0.6
                )
                nodes += self._candidate_nodes("/chosen/portal", self._decomposition.candidate_portals == portal)
                for side, cell in enumerate(self._decomposition.portal_cells[portal].tolist()):
                    nodes += self._cell_nodes(f"/chosen/portal/cell_{side}", cell, with_portals=False)
                self.portal.replace(nodes)
                said.append(self._about_portal(portal))
            else:
                self.portal.replace([])
            self._text.content = "\n\n".join(said)

    def _about_cell(self, cell: int) -> str:
        own = (self._portals_of_cells == cell).any(axis=1)
        count = int(own[self._decomposition.candidate_portals].sum())
        polytope = self._decomposition.cell_polytope(cell)
        if polytope is None:
            size = "a sliver"
        elif section_of(self._decomposition) is None:
            size = f"{1e3 * polytope.volume:.3g} litres"
        else:
            low, high = self._decomposition.bounds.lower[2], self._decomposition.bounds.upper[2]
            size = f"{polytope.volume / (high - low):.3g} m²"
        return f"**Cell {cell}**: {size}, {int(own.sum())} portals, {count} candidates that all see each other"

    def _about_portal(self, portal: int) -> str:
        first, second = self._decomposition.portal_cells[portal].tolist()
        of_portal = self._decomposition.candidate_portals == portal
        clearances = self._decomposition.candidate_clearances[of_portal]
        if not len(clearances):
            return f"**Portal {portal}** joins cells {first} and {second}; it is too narrow for a candidate"
        cap = self._decomposition.clearance_cap
        most = float(clearances.max())
        clear = f"at least {1e3 * cap:.0f}" if most >= cap else f"up to {1e3 * most:.0f}"
        return (
            f"**Portal {portal}** joins cells {first} and {second}; {len(clearances)} candidates, {clear} mm from the "
            "nearest obstacle"
        )

    def _cell_nodes(self, name: str, cell: int, *, with_portals: bool) -> list[Any]:
        polytope = self._decomposition.cell_polytope(cell)
        nodes: list[Any] = []
        height = section_of(self._decomposition)
        if polytope is not None and height is None:
            triangles = polytope_triangles(polytope)
            nodes.append(
                self._viewer.server.scene.add_mesh_simple(
                    f"{name}/faces",
                    triangles.reshape(-1, 3),
                    np.arange(3 * len(triangles)).reshape(-1, 3),
                    color=rgb(CHOSEN),
                    opacity=0.25,
                    flat_shading=True,
                    side="double",
                    cast_shadow=False,
                    receive_shadow=False,
                )
            )
            nodes += lines(self._viewer, f"{name}/edges", polytope.vertices[polytope.edges], rgb(CHOSEN), 3.0)
        elif polytope is not None:
            nodes += lines(self._viewer, f"{name}/edges", _outline(polytope, float(height or 0.0)), rgb(CHOSEN), 5.0)
        if with_portals:
            own = np.flatnonzero((self._portals_of_cells == cell).any(axis=1))
            nodes += portal_nodes(self._viewer, f"{name}/portals", self._decomposition, own, opacity=0.4)
            of_cell = np.isin(self._decomposition.candidate_portals, own)
            nodes += self._candidate_nodes(name, of_cell)
            points = self._decomposition.candidates[of_cell]
            first, second = np.triu_indices(len(points), 1)
            nodes += lines(
                self._viewer, f"{name}/graph", np.stack((points[first], points[second]), axis=1), rgb(GRAPH), 0.8
            )
        return nodes

    def _candidate_nodes(self, name: str, chosen: np.ndarray) -> list[Any]:
        points = self._decomposition.candidates[chosen]
        if not len(points):
            return []
        return [
            self._viewer.server.scene.add_point_cloud(
                f"{name}/candidates", points, rgb(KEYPOINT), point_size=2.0 * mark_size(self._decomposition),
                point_shape="circle", precision="float32", point_shading="flat",
            )
        ]  # fmt: skip


def _outline(polytope: ConvexPolytope, height: float) -> np.ndarray:
    """(e, 2, 3) where the sides of an upright prism meet a plane at a height [m]."""
    upright = [face for face in range(len(polytope.faces)) if abs(polytope.planes[face, 2]) < 0.5]
    return np.concatenate([section_of_loop(closed_loop(polytope.polygon(face)), height) for face in upright])
