"""Pictures of plans and decompositions, as PNG files.

They are drawn by matplotlib's Agg without pyplot, so they need no display, change no global state and may be drawn in
any thread.
"""

from __future__ import annotations

from bsp_informed_planner.visualization.arm_figure import draw_arm_plan
from bsp_informed_planner.visualization.decomposition_figure import draw_decomposition
from bsp_informed_planner.visualization.plane_figure import draw_point_plan

__all__ = ["draw_arm_plan", "draw_decomposition", "draw_point_plan"]
