"""`bsp-planner view`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import typer

from bsp_informed_planner.cli.pages import open_viewer, serve
from bsp_informed_planner.cli.robots import RobotChoice, describe_robot, load_robot
from bsp_informed_planner.cli.scene_files import LoadedProblem, load_problem
from bsp_informed_planner.errors import BspPlannerError, UnknownFrameError
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import JointGoal, PlanningProblem, PoseGoal
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem
from bsp_informed_planner.robots.reference import load_reference
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.pose import FloatArray


def run_view(path: Path | None, choice: RobotChoice | None, seed: int, host: str, port: int) -> int:
    """Serve a page with a robot in a scene until Ctrl-C. Returns the exit status."""
    from bsp_informed_planner.visualization.viewer.plan_answer import library_plan
    from bsp_informed_planner.visualization.viewer.plan_page import PlanPage

    loaded = None if path is None else load_problem(path)
    if choice is None and loaded is not None and loaded.robot is not None:
        robot = load_reference(loaded.robot)
    else:
        robot = load_robot(choice or RobotChoice("ur5"))
    typer.echo(describe_robot(robot), err=True)
    if loaded is None:
        loaded = example_problem(robot, seed)
    if loaded.scene.frame != robot.root_frame:
        raise UnknownFrameError(
            loaded.scene.frame, [robot.root_frame], f"{path}: `frame` must be the root link of the robot"
        )
    planner = Planner(robot, loaded.scene)
    start, goal = first_ends(planner, loaded)
    title = f"{robot.name}: {'example' if path is None else path.name}"
    with open_viewer(title, host, port) as viewer:
        page = PlanPage(viewer, planner, {"library": library_plan(planner)}, start, goal, options=loaded.options)
        serve(viewer)
        page.close()
    return 0


def example_problem(robot: Robot, seed: int) -> LoadedProblem:
    """A shelf for an arm, a maze for a point robot."""
    rng = np.random.default_rng(seed)
    problem = random_maze(rng).problem if robot.workspace_dimension == 2 else random_shelf_problem(robot, rng)
    goals = [JointGoal(goal) for goal in problem.goals] + [PoseGoal(pose) for pose in problem.goal_poses]
    return LoadedProblem(problem.scene, problem.start, tuple(goals))


def first_ends(planner: Planner, loaded: LoadedProblem) -> tuple[FloatArray, FloatArray]:
    """Start and goal (n,) at which the sliders begin [rad or m].

    A goal pose becomes the configuration nearest to the start. What a file does not say is the middle of the limits, or
    zero where that is within them.
    """
    robot = planner.robot
    neutral = np.clip(np.zeros(robot.dof), robot.lower, robot.upper)
    start = neutral if loaded.start is None else loaded.start
    for goal in loaded.goals:
        if isinstance(goal, JointGoal):
            return start, goal.configuration
    if loaded.goals:
        try:
            return start, planner.prepare(PlanningProblem(start, loaded.goals)).goals[0]
        except BspPlannerError as error:
            typer.echo(f"the goal of the file cannot be used, so the page begins without: {error}", err=True)
    return start, start
