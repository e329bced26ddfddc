"""Plan with an arm in a scene file, without ROS.

python examples/plan_from_python.py
"""

from __future__ import annotations

from pathlib import Path

from bsp_informed_planner.planning import Planner, PlanningProblem, PlanOptions, PoseGoal
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.scene import problem_from_yaml

problem = problem_from_yaml(Path(__file__).parent / "shelf.yaml")
planner = Planner(ur5(), problem.scene)
goals = [PoseGoal(pose) for pose in problem.goal_poses]  # of the tool; JointGoal for joint positions

# The first path comes within moments; until the time is over it gets shorter.
result = planner.plan(PlanningProblem(problem.start, goals), PlanOptions(allowed_seconds=2.0, seed=1))
for seconds, cost in zip(result.cost_history.seconds, result.cost_history.costs, strict=True):
    print(f"after {1e3 * seconds:5.0f} ms: a path of length {cost:.3f} rad")
trajectory = result.trajectory
print(f"{len(trajectory.times)} points in {trajectory.duration:.2f} s; certified free of collision: {result.certified}")
print("the first one:", trajectory.positions[0].round(3).tolist())
