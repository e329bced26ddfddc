"""How the cost of a path fell while it was planned."""

from __future__ import annotations

from typing import Any

import numpy as np

from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.palette import MIDDLE
from bsp_informed_planner.visualization.viewer.server import Viewer, rgb


class CostCurve:
    """A chart of cost against planning time, in steps."""

    def __init__(self, viewer: Viewer) -> None:
        self._chart: Any = viewer.server.gui.add_uplot(
            (np.array([0.0, 1.0]), np.array([0.0, 0.0])),
            (
                {"label": "time [s]"},
                {"label": "cost", "stroke": f"rgb{rgb(MIDDLE)}", "width": 2},
            ),
            title="Cost of the best path over planning time [s]",
            scales={"x": {"time": False}, "y": {"auto": True}},
            height=160,
            visible=False,
        )

    @property
    def data(self) -> tuple[FloatArray, FloatArray]:
        """Times [s] and costs that are drawn."""
        times, costs = self._chart.data
        return times, costs

    @property
    def is_visible(self) -> bool:
        """Whether there is a curve."""
        return bool(self._chart.visible)

    def show(self, seconds: FloatArray, costs: FloatArray, end: float) -> None:
        """Draws a curve.

        Args:
            seconds: (k,) when each cost was reached [s].
            costs: (k,).
            end: of the plan [s].
        """
        self._chart.visible = len(costs) > 0
        if len(costs):
            times = np.append(seconds, max(end, float(seconds[-1]) + 1e-3))
            self._chart.data = steps(times, np.append(costs, costs[-1]))


def steps(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times and values (2 k - 1,) of a line that holds each of k values until the next time."""
    return np.repeat(times, 2)[1:], np.repeat(values, 2)[:-1]
