"""Planning: from a problem to a verified, timed path."""

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
