"""A chain of keypoints between a start and a goal that are moved in a page."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.decomposition.graph import CLEARANCE_WEIGHT, KeypointChain, shortest_chain
from bsp_informed_planner.errors import KeypointsUnavailableError
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.palette import GOAL, KEYPOINT, MIDDLE, START, Colour, progress_colours
from bsp_informed_planner.visualization.portals import inner_portals
from bsp_informed_planner.visualization.viewer.decomposition_layer import mark_size
from bsp_informed_planner.visualization.viewer.scene_layer import section_of
from bsp_informed_planner.visualization.viewer.server import Viewer, rgb, set_value
from bsp_informed_planner.visualization.viewer.switches import LegendEntry, Switch

if TYPE_CHECKING:
    import viser

# Ends of chains that are tried for one that shows something.
TRIED_ENDS = 40
# Intensity of a display is its input to this power, about.
DISPLAY_GAMMA = 2.2


class ChainLayer:
    """The shortest chain of keypoints from a start to a goal, which can be typed or dragged.

    Attributes:
        keypoints: the chain, shown and hidden.
        start, goal: inputs [m].
        clearance_weight: input, see `shortest_chain` [m].
        chain: None if there is none.
    """

    chain: KeypointChain | None

    def __init__(
        self,
        viewer: Viewer,
        decomposition: Decomposition,
        start: FloatArray | None = None,
        goal: FloatArray | None = None,
    ) -> None:
        """
        Args:
            viewer: the page.
            decomposition: that the chain goes through.
            start, goal: (3,) where the ends are at first [m]; None for ends of a chain of many keypoints.
        """
        self._viewer = viewer
        self._decomposition = decomposition
        gui, bounds = viewer.server.gui, decomposition.bounds
        suggested = suggested_ends(decomposition)
        first = np.clip(suggested[0] if start is None else start, bounds.lower, bounds.upper)
        last = np.clip(suggested[1] if goal is None else goal, bounds.lower, bounds.upper)
        with gui.add_folder("Chain of keypoints"):
            self.keypoints = Switch(viewer, "Show the chain")
            self.start = self._input("Start [m]", first)
            self.goal = self._input("Goal [m]", last)
            weight = CLEARANCE_WEIGHT if decomposition.dimension == 3 else 0.0
            self.clearance_weight = gui.add_slider(
                "Clearance", 0.0, 2.0, 0.05, weight,
                hint="Cost of a keypoint that touches an obstacle [m]: more keeps the chain away from them.",
            )  # fmt: skip
            self._text = gui.add_markdown("")
            handles = Switch(viewer, "Arrows", hint="To drag start and goal by.")
        self.chain = None
        size = 6.0 * mark_size(decomposition)
        handles.replace([self._handle("start", self.start, size, START), self._handle("goal", self.goal, size, GOAL)])
        self.clearance_weight.on_update(lambda _: self._search())
        self._search()

    @staticmethod
    def legend() -> list[LegendEntry]:
        """What its colours mean."""
        return [
            LegendEntry(START, "start", "dot"),
            LegendEntry(GOAL, "goal", "dot"),
            LegendEntry(KEYPOINT, "keypoints of the chain", "dot"),
            LegendEntry(MIDDLE, "the chain, from the start's blue to the goal's red", "line"),
        ]

    @property
    def description(self) -> str:
        """What is said about the chain."""
        return str(self._text.content)

    def _input(self, label: str, value: FloatArray) -> viser.GuiVector3Handle:
        bounds = self._decomposition.bounds
        return self._viewer.server.gui.add_vector3(
            label, tuple(value), min=tuple(bounds.lower), max=tuple(bounds.upper), step=0.01
        )

    def _handle(self, name: str, value: viser.GuiVector3Handle, size: float, colour: Colour) -> Any:
        """Arrows that move an end, and an input that moves the arrows."""
        scene = self._viewer.server.scene
        flat = section_of(self._decomposition) is not None
        controls = scene.add_transform_controls(
            f"/chain/{name}", scale=max(size, 0.1), disable_rotations=True, depth_test=False, position=value.value,
            active_axes=(True, True, not flat), disable_sliders=flat,
        )  # fmt: skip
        scene.add_icosphere(f"/chain/{name}/ball", 0.25 * size, rgb(colour))

        def typed() -> None:
            controls.position = value.value
            self._search()

        def dragged() -> None:
            bounds = self._decomposition.bounds
            set_value(value, tuple(np.clip(controls.position, bounds.lower, bounds.upper).tolist()))

        controls.on_update(lambda _: dragged())
        value.on_update(lambda _: typed())
        return controls

    def _search(self) -> None:
        with self._viewer.lock:
            begin = time.perf_counter()
            try:
                chain = shortest_chain(
                    self._decomposition,
                    np.array(self.start.value),
                    np.array(self.goal.value),
                    clearance_weight=self.clearance_weight.value,
                )
            except KeypointsUnavailableError as error:
                self.chain = None
                self.keypoints.replace([])
                self._text.content = f"**No chain**: {error}"
                return
            milliseconds = 1e3 * (time.perf_counter() - begin)
            self.chain = chain
            count = len(chain.points) - 2
            self._text.content = (
                f"**{count} keypoint{'' if count == 1 else 's'}**, {chain.length:.3f} m long, found in "
                f"{milliseconds:.2f} ms"
            )
            nodes = polyline_nodes(self._viewer, "/chain/line", chain.points)
            keypoints = chain.points[1:-1]
            if len(keypoints):
                nodes.append(
                    self._viewer.server.scene.add_point_cloud(
                        "/chain/keypoints", keypoints, rgb(KEYPOINT), point_size=3.5 * mark_size(self._decomposition),
                        point_shape="circle", precision="float32", point_shading="gradient",
                    )
                )  # fmt: skip
            self.keypoints.replace(nodes)


def polyline_nodes(viewer: Viewer, name: str, points: FloatArray, thickness: float = 5.0) -> list[Any]:
    """A polyline (m, 3) [m] in colours from the start's to the goal's."""
    if len(points) < 2:
        return []
    travelled = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    # Colours of corners are taken for linear intensities by the browser, so they would look pale.
    linear = progress_colours(travelled / max(travelled[-1], 1e-12)) ** DISPLAY_GAMMA
    colours = np.round(255.0 * linear).astype(np.uint8)
    return [
        viewer.server.scene.add_line_segments(
            name,
            np.stack((points[:-1], points[1:]), axis=1),
            np.stack((colours[:-1], colours[1:]), axis=1),
            thickness=thickness,
            thickness_units="screen",
        )
    ]


def suggested_ends(decomposition: Decomposition) -> tuple[FloatArray, FloatArray]:
    """Two free points (3,) that a chain of many keypoints connects, in mm; the middle of the workspace if none does.

    One is the middle of the largest cell. The other is one of some candidates between obstacles: the one that most
    keypoints lie before, the farthest of equals.
    """
    largest, start = 0.0, 0.5 * (decomposition.bounds.lower + decomposition.bounds.upper)
    for cell in decomposition.free_cells.tolist():
        polytope = decomposition.cell_polytope(cell)
        if polytope is not None and polytope.volume > largest:
            largest, start = polytope.volume, polytope.vertices.mean(axis=0)
    start = np.round(start, 3)
    inside = np.flatnonzero(np.isin(decomposition.candidate_portals, inner_portals(decomposition)))
    if not len(inside):
        inside = np.arange(decomposition.candidate_count)
    if not len(inside):
        return start, start
    tried = inside[np.unique(np.linspace(0, len(inside) - 1, min(len(inside), TRIED_ENDS)).astype(np.int64))]
    best: tuple[tuple[int, float], FloatArray] = ((0, 0.0), start)
    for end in np.round(decomposition.candidates[tried], 3):
        try:
            chain = shortest_chain(decomposition, start, end)
        except KeypointsUnavailableError:
            continue
        rank = (len(chain.points), chain.length)
        if rank > best[0]:
            best = rank, end
    return start, best[1]
