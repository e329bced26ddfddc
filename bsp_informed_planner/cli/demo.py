"""`bsp-planner demo`: the whole suite, once, seen from outside."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rclpy
import typer
from bsp_informed_planner_msgs.msg import PlanResponse
from rich.console import Console
from rich.table import Table

from bsp_informed_planner.cli.bounds_progress import build_bounds
from bsp_informed_planner.cli.node_processes import NodeProcesses
from bsp_informed_planner.cli.nodes import suite_parameters
from bsp_informed_planner.cli.output_files import prepare_output
from bsp_informed_planner.cli.robots import RobotChoice, load_robot
from bsp_informed_planner.collision.certifier import Verdict
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.compile_kernels import ensure_compiled
from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.nodes.client import SuiteClient, request_for
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.graph_conversions import decomposition_from_msg
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem
from bsp_informed_planner.planning.verification import CertifyingChecker
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.visualization.figures import draw_arm_plan, draw_point_plan

START_SECONDS = 60.0


@contextmanager
def ros() -> Iterator[None]:
    """rclpy, initialised and shut down again."""
    rclpy.init()
    try:
        yield
    finally:
        rclpy.try_shutdown()


def demo_problem(robot_name: str, robot: Robot, seed: int) -> ScenarioProblem:
    """The problem of a seed: a shelf for an arm, a maze for the point robot."""
    rng = np.random.default_rng(seed)
    return random_maze(rng).problem if robot_name == "point" else random_shelf_problem(robot, rng)


def run_demo(seed: int, robot_name: str, seconds: float, out: Path) -> int:
    """Run it. Returns the exit status: 0 if a verified path came back."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=160)
    picture = out / f"demo-{robot_name}-{seed}.png"
    prepare_output("--out", picture)
    with console.status("loading the kernels (after a change of them: compiling, about a minute) ..."):
        # Once here, and not three times at once in the nodes.
        ensure_compiled()
    choice = RobotChoice(robot_name)
    robot = load_robot(choice)
    build_bounds(robot)
    problem = demo_problem(robot_name, robot, seed)
    # A domain and a namespace of its own keep the demo apart from whatever else runs ROS on this machine.
    domain = os.environ.get("ROS_DOMAIN_ID") or str(1 + os.getpid() % 100)
    namespace = f"demo_{os.getpid()}"
    environment = {"ROS_DOMAIN_ID": domain, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    os.environ.update(environment)
    with tempfile.TemporaryDirectory(prefix="bsp-planner-demo-") as logs:
        parameters = suite_parameters(choice, robot)
        try:
            with (
                NodeProcesses(
                    parameters, namespace=namespace, environment=environment, log_dir=Path(logs)
                ) as processes,
                ros(),
                console.status("starting decomposition_node, inference_node and planner_node ..."),
            ):
                client = SuiteClient(rclpy.create_node("client", namespace=namespace))
                client.wait_for_nodes(START_SECONDS, processes.check_alive)
                console.print(
                    f"three nodes are up (ROS domain {domain}, namespace /{namespace}); "
                    f"problem {seed}: {problem.description}"
                )
                revision = client.publish_scene(problem.scene)
                console.print(
                    f"published {len(problem.scene.obstacles)} obstacles on obstacle_scene: revision {revision}"
                )
                begin = time.monotonic()
                request = request_for(problem, robot, seconds, seed, client.epoch, revision)
                response = client.plan(request, seconds=10.0)
                answered = time.monotonic() - begin
                graph = client.keypoint_graph
                assert graph is not None
                decomposition = decomposition_from_msg(graph)
                client.close()
        except Exception:
            for log in sorted(Path(logs).glob("*.log")):
                if text := log.read_text(errors="replace").strip():
                    typer.echo(f"--- {log.name}\n{text[-3000:]}", err=True)
            raise
    console.print(_table(response, decomposition, answered))
    if response.error_code != ErrorCode.SUCCESS:
        console.print(f"[red]no path:[/red] {response.message}")
        return 1
    path = np.array(response.waypoints).reshape(-1, robot.dof)
    if not _is_verified(robot, problem, path, response):
        console.print("[red]the path that came back does not pass the check of this client[/red]")
        return 1
    with console.status("drawing ..."):
        _draw(picture, robot, problem, path, response, decomposition)
    console.print(f"[green]verified path[/green]; picture: {picture}")
    return 0


def _is_verified(robot: Robot, problem: ScenarioProblem, path: np.ndarray, response: PlanResponse) -> bool:
    """Check what came back once more, in this process: trust is good."""
    checker = CertifyingChecker(ExactChecker(robot, problem.scene), response.verification_resolution)
    timed = np.array([point.positions for point in response.trajectory.points])
    ends = np.allclose(path[0], problem.start, atol=1e-3) and np.allclose(timed[-1], path[-1], atol=1e-6)
    verdict = max(checker.verdict(path), checker.verdict(timed))
    return bool(ends) and verdict is not Verdict.COLLIDING


def _table(response: PlanResponse, decomposition: Decomposition, answered: float) -> Table:
    statistics = response.statistics
    table = Table(show_header=False, box=None, padding=(0, 2))
    found = response.error_code == ErrorCode.SUCCESS
    rows: list[tuple[str, str]] = [
        ("error code", f"{response.error_code} ({ErrorCode(response.error_code).name})"),
        ("scene revision", str(response.scene_revision)),
        (
            "decomposition",
            (
                f"{decomposition.cell_count} free cells, {decomposition.portal_count} portals, "
                f"{decomposition.candidate_count} keypoint candidates, {decomposition.edge_count} edges in "
                f"{1e3 * decomposition.timings.total_seconds:.1f} ms"
            ),
        ),
    ]
    if found:
        trajectory = response.trajectory.points[-1].time_from_start
        fallback = f" ({response.fallback_reason})" if response.fallback_reason else ""
        rows += [
            ("sampler", f"{response.sampler_id}{fallback}"),
            ("keypoints", f"{len(response.keypoints)}, found in {1e3 * statistics.inference_seconds:.0f} ms"),
            ("first solution", f"{1e3 * statistics.first_solution_seconds:.0f} ms"),
            ("cost", " -> ".join(f"{cost:.3f}" for cost in response.cost_history) + " (joint-space length)"),
            ("waypoints", str(len(response.waypoints) // len(response.trajectory.joint_names))),
            (
                "trajectory",
                f"{trajectory.sec + 1e-9 * trajectory.nanosec:.2f} s, {len(response.trajectory.points)} points",
            ),
            (
                "search",
                (
                    f"{statistics.samples} samples, {statistics.nodes} nodes, {statistics.edges_checked} edges, "
                    f"{statistics.exact_checks} exact checks"
                ),
            ),
            (
                "verified",
                "collision-free, certified between all points of the trajectory"
                if response.certified
                else f"every {1e3 * response.verification_resolution:.2f} mm of motion",
            ),
        ]
    rows.append(("answered in", f"{answered:.2f} s"))
    for name, value in rows:
        table.add_row(name, value)
    return table


def _draw(
    picture: Path,
    robot: Robot,
    problem: ScenarioProblem,
    path: np.ndarray,
    response: PlanResponse,
    decomposition: Decomposition,
) -> None:
    keypoints = np.array([(point.x, point.y, point.z) for point in response.keypoints]).reshape(-1, 3)
    proof = "certified collision-free" if response.certified else "checked collision-free"
    name = "UR5" if robot.name == "ur5" else "Point robot in a"
    title = f"{name} {problem.description}: {proof}"
    draw = draw_point_plan if robot.workspace_dimension == 2 else draw_arm_plan
    draw(picture, robot, problem.scene, path, keypoints, decomposition=decomposition, title=title)
