"""Planning: from a problem to a verified, timed path."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bsp_informed_planner.planning.planner import Planner
    from bsp_informed_planner.planning.problem import (
        JointGoal,
        PlanningProblem,
        PlanOptions,
        PlanResult,
        PoseGoal,
        Trajectory,
    )

__all__ = ["JointGoal", "PlanOptions", "PlanResult", "Planner", "PlanningProblem", "PoseGoal", "Trajectory"]


def __getattr__(name: str) -> object:
    # Not before they are asked for: the planner loads compiled code and Pinocchio.
    if name not in __all__:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(importlib.import_module(f"{__name__}.{'planner' if name == 'Planner' else 'problem'}"), name)
