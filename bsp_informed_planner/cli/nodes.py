"""`bsp-planner nodes`."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import typer

from bsp_informed_planner.cli.bounds_progress import build_bounds
from bsp_informed_planner.cli.node_processes import NODE_NAMES, NodeDiedError, NodeProcesses
from bsp_informed_planner.cli.parameter_files import require_known_nodes
from bsp_informed_planner.cli.robots import RobotChoice, describe_robot, load_robot
from bsp_informed_planner.compile_kernels import ensure_compiled
from bsp_informed_planner.robots.robot import Robot


def _say_restart(name: str) -> None:
    typer.echo(f"{name} has ended by itself; it is started again", err=True)


def suite_parameters(choice: RobotChoice, robot: Robot) -> dict[str, dict[str, object]]:
    """Parameters of the three nodes for one robot."""
    return {
        "decomposition_node": {"frame_id": robot.root_frame, "dimension": robot.workspace_dimension},
        "inference_node": choice.parameters(),
        "planner_node": choice.parameters(),
    }


def run_nodes(choice: RobotChoice, namespace: str, params_file: Path | None, restart: bool) -> int:
    """Run the three nodes until Ctrl-C, or until one of them ends for good. Returns the exit status.

    Raises:
        UnknownNodeError: the parameter file has a section for none of them.
    """
    if params_file is not None:
        # A file may serve the bridge, too, which is started apart.
        require_known_nodes(params_file, (*NODE_NAMES, "moveit_bridge"), namespace)
    # Loaded here too: a description that cannot be used is better said at once than in the log of a node.
    robot = load_robot(choice)
    typer.echo(describe_robot(robot))
    # Once here, and not three times at once in the nodes.
    ensure_compiled()
    build_bounds(robot)
    parameters = suite_parameters(choice, robot)
    # Whatever ends this process ends the nodes: SIGTERM too, and Ctrl-C where a shell has it ignored in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    try:
        with NodeProcesses(parameters, namespace=namespace, params_file=params_file) as processes:
            typer.echo(f"started {', '.join(processes.processes)} in ROS domain {domain}; Ctrl-C stops them")
            processes.wait(_say_restart if restart else None)
    except KeyboardInterrupt:
        return 0
    except NodeDiedError as error:
        typer.echo(f"error: {error}", err=True)
        return 1
    return 0
