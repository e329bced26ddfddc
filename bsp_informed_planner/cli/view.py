"""`bsp-planner view`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import typer

from bsp_informed_planner.cli.bounds_progress import build_bounds
from bsp_informed_planner.cli.pages import open_viewer, serve
from bsp_informed_planner.cli.robots import RobotChoice, describe_robot, load_robot
from bsp_informed_planner.cli.scene_files import LoadedProblem, load_problem
from bsp_informed_planner.errors import BspPlannerError, InvalidOptionError, UnknownFrameError
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import Goal, JointGoal, PlanningProblem, PoseGoal
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem
from bsp_informed_planner.robots.reference import load_reference
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.pose import FloatArray

if TYPE_CHECKING:
    from bsp_informed_planner.visualization.viewer.plan_answer import PlanFunction

# How long running nodes are waited for [s].
NODES_SECONDS = 10.0


@dataclass(frozen=True)
class ViewArguments:
    """The command line; see the options of `bsp-planner view`."""

    scene: Path | None
    choice: RobotChoice | None
    nodes: bool
    namespace: str
    seed: int
    host: str
    port: int


def run_view(arguments: ViewArguments) -> int:
    """Serve a page with a robot in a scene until Ctrl-C. Returns the exit status."""
    if arguments.nodes:
        if arguments.scene is not None:
            raise InvalidOptionError("--nodes", str(arguments.scene), "no file: the nodes have a scene")
        return _view_nodes(arguments)
    loaded = None if arguments.scene is None else load_problem(arguments.scene)
    if arguments.choice is None and loaded is not None and loaded.robot is not None:
        robot = load_reference(loaded.robot)
    else:
        robot = load_robot(arguments.choice or RobotChoice("ur5"))
    typer.echo(describe_robot(robot), err=True)
    name = "example" if arguments.scene is None else arguments.scene.name
    _serve(arguments, robot, loaded or example_problem(robot, arguments.seed), name, {})
    return 0


def _view_nodes(arguments: ViewArguments) -> int:
    """The same with the scene of running nodes, which plan."""
    import rclpy

    from bsp_informed_planner.nodes.client import SuiteClient
    from bsp_informed_planner.nodes.plan_function import plan_through

    robot = load_robot(arguments.choice or RobotChoice("ur5"))
    typer.echo(describe_robot(robot), err=True)
    rclpy.init()
    try:
        client = SuiteClient(rclpy.create_node("viewer", namespace=arguments.namespace))
        typer.echo("waiting for the nodes and their scene ...", err=True)
        client.wait_for_nodes(NODES_SECONDS)
        scene = client.wait_for_scene(NODES_SECONDS)
        ways = {"nodes": plan_through(client, robot, scene.revision)}
        _serve(arguments, robot, LoadedProblem(scene), f"scene {scene.revision} of the nodes", ways)
        client.close()
    finally:
        rclpy.try_shutdown()
    return 0


def _serve(
    arguments: ViewArguments, robot: Robot, loaded: LoadedProblem, name: str, ways: dict[str, PlanFunction]
) -> None:
    from bsp_informed_planner.visualization.viewer.plan_answer import library_plan
    from bsp_informed_planner.visualization.viewer.plan_page import PlanPage

    if loaded.scene.frame != robot.root_frame:
        raise UnknownFrameError(
            loaded.scene.frame, [robot.root_frame], f"{name}: its frame must be the root link of the robot"
        )
    build_bounds(robot)
    planner = Planner(robot, loaded.scene)
    start, goal, goals = first_ends(planner, loaded)
    ways = {**ways, "library": library_plan(planner)}
    with open_viewer(f"{robot.name}: {name}", arguments.host, arguments.port) as viewer:
        page = PlanPage(viewer, planner, ways, start, goal, goals=goals, options=loaded.options)
        serve(viewer)
        page.close()


def example_problem(robot: Robot, seed: int) -> LoadedProblem:
    """A shelf for an arm, a maze for a point robot."""
    rng = np.random.default_rng(seed)
    problem = random_maze(rng).problem if robot.workspace_dimension == 2 else random_shelf_problem(robot, rng)
    goals: list[Goal] = [JointGoal(goal) for goal in problem.goals]
    goals += [PoseGoal(pose) for pose in problem.goal_poses]
    return LoadedProblem(problem.scene, problem.start, tuple(goals))


def first_ends(planner: Planner, loaded: LoadedProblem) -> tuple[FloatArray, FloatArray, tuple[Goal, ...]]:
    """Start and goal (n,) at which the sliders begin [rad or m], and the goals of plans between them.

    The goal is the configuration nearest to the start, of those of all goals. What a file does not say is zero, or as
    near to it as the limits allow.
    """
    robot = planner.robot
    neutral = np.clip(np.zeros(robot.dof), robot.lower, robot.upper)
    start = neutral if loaded.start is None else loaded.start
    if loaded.goals:
        try:
            return start, planner.prepare(PlanningProblem(start, loaded.goals)).goals[0], loaded.goals
        except BspPlannerError as error:
            typer.echo(f"the problem of the file cannot be planned as it is: {error}", err=True)
        for goal in loaded.goals:
            if isinstance(goal, JointGoal):
                return start, goal.configuration, ()
    return start, start, ()
