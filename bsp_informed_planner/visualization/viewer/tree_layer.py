"""Search trees that grow, in a page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bsp_informed_planner.planning.grown_tree import GrownTree
from bsp_informed_planner.planning.growth import Growth
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.palette import GOAL, START, Colour
from bsp_informed_planner.visualization.viewer.decomposition_layer import lines
from bsp_informed_planner.visualization.viewer.server import Viewer, rgb, set_value
from bsp_informed_planner.visualization.viewer.switches import LegendEntry, Switch

if TYPE_CHECKING:
    import viser


class TreeLayer:
    """Two trees by the way of the tool along their edges, up to a number of nodes that a slider sets.

    Attributes:
        tree: what is shown and hidden.
        slider: how many nodes of both trees are shown.
    """

    def __init__(self, viewer: Viewer, robot: Robot) -> None:
        self._viewer = viewer
        self._robot = robot
        self.tree = Switch(viewer, "Trees", hint="Of RRT-Connect, by the way of the tool along their edges.")
        self.slider: viser.GuiSliderHandle[int] = viewer.server.gui.add_slider(
            "Nodes", 0, 1, 1, 0, disabled=True, hint="Let the trees grow, and shrink again."
        )
        self.slider.on_update(lambda _: self._draw())
        self._text = viewer.server.gui.add_markdown("")
        self._edges: list[tuple[FloatArray, np.ndarray, Colour, str]] = []

    @staticmethod
    def legend() -> list[LegendEntry]:
        """What its colours mean."""
        return [
            LegendEntry(START, "tree from the start, by the way of the tool", "line"),
            LegendEntry(GOAL, "tree from the goal", "line"),
        ]

    @property
    def description(self) -> str:
        """What is said about the trees."""
        return str(self._text.content)

    @property
    def edge_count(self) -> int:
        """How many edges there are in all."""
        return sum(len(edges) for edges, *_ in self._edges)

    def show(self, growth: Growth | None) -> None:
        """Shows trees, fully grown; None: no trees."""
        with self._viewer.lock:
            self._edges = []
            total = 0
            if growth is not None:
                total = max(len(growth.start_tree.nodes), len(growth.goal_tree.nodes))
                self._edges = [
                    (*self._tool_edges(growth.start_tree), START, "start"),
                    (*self._tool_edges(growth.goal_tree), GOAL, "goal"),
                ]
                count = len(growth.start_tree.nodes) + len(growth.goal_tree.nodes)
                met = "the trees met" if growth.path is not None else "the trees did not meet"
                self._text.content = f"**{count} nodes** after {growth.samples} samples: {met}."
            else:
                self._text.content = ""
            self.slider.disabled = growth is None
            self.slider.max = max(total, 1)
            set_value(self.slider, total)
            self._draw()

    def _tool_edges(self, tree: GrownTree) -> tuple[FloatArray, np.ndarray]:
        """(e, 2, 3) edges by the tool's places [m], and the number of nodes from which on each is there (e,)."""
        if not len(tree.nodes):
            return np.empty((0, 2, 3)), np.empty(0, np.int64)
        places = tool_positions(self._robot, tree.nodes)
        child = np.flatnonzero(tree.parents >= 0)
        return np.stack((places[tree.parents[child]], places[child]), axis=1), child + 1

    def _draw(self) -> None:
        with self._viewer.lock:
            nodes: list[Any] = []
            for edges, since, colour, name in self._edges:
                grown = edges[since <= self.slider.value]
                nodes += lines(self._viewer, f"/tree/{name}", grown, rgb(colour), 1.5)
            self.tree.replace(nodes)


def tool_positions(robot: Robot, states: FloatArray) -> FloatArray:
    """(m, 3) places of the tool frame in configurations (m, n), in the root frame [m]."""
    if not len(states):
        return np.empty((0, 3))
    return np.array([robot.forward_kinematics(state).position for state in states])
