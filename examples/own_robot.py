"""An arm of your own: look at its URDF, take the SRDF that is proposed, plan.

python examples/own_robot.py [my.urdf --lock NAME=VALUE ...]      (all of it in one command: bsp-planner robot check)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from bsp_informed_planner.planning import JointGoal, Planner, PlanningProblem, PlanOptions
from bsp_informed_planner.planning.box_problem import random_box_problem
from bsp_informed_planner.robots.arm import load_arm
from bsp_informed_planner.robots.check import CheckOptions, check_robot
from bsp_informed_planner.robots.locked import parse_locked_joints
from bsp_informed_planner.robots.self_collision import proposed_srdf

parser = argparse.ArgumentParser()
parser.add_argument("urdf", nargs="?", type=Path, default=Path(__file__).parent / "own_arm.urdf")
parser.add_argument("--lock", action="append", help="NAME=VALUE of a joint to hold; default: grip=0.02")
parser.add_argument("--tool-frame", help="frame for goal poses")
arguments = parser.parse_args()
locked = parse_locked_joints(",".join(arguments.lock or ["grip=0.02"]))

report, robot = check_robot(
    arguments.urdf, tool_frame=arguments.tool_frame, locked_joints=locked, options=CheckOptions(samples=2000)
)
for finding in report.findings:
    print(f"{finding.severity.value}: {finding.sentence}")
if robot is None or report.self_collision is None or not report.can_plan:
    raise SystemExit("mend the errors first")

# Pairs of links that never or always touch need no checks.
srdf = proposed_srdf(robot, report.self_collision)
before = len(robot.collision_model.collisionPairs)
robot = load_arm(arguments.urdf, srdf, tool_frame=robot.tool_frame, locked_joints=locked)
print(f"{robot.dof} joints, {before} -> {len(robot.collision_model.collisionPairs)} pairs of links to check")

problem = random_box_problem(robot, np.random.default_rng(1))
result = Planner(robot, problem.scene).plan(
    PlanningProblem(problem.start, [JointGoal(goal) for goal in problem.goals]),
    PlanOptions(first_solution=True, seed=1),
)
print(f"a path {problem.description}: {result}")
