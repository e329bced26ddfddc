"""`bsp-planner nodes`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from bsp_informed_planner.cli.node_processes import NodeDiedError, NodeProcesses, robot_parameters
from bsp_informed_planner.cli.robots import load_robot


def suite_parameters(
    robot: str, urdf: Path | None, srdf: Path | None, package_dirs: Sequence[Path], tool_frame: str | None
) -> dict[str, dict[str, object]]:
    """Parameters of the three nodes for one robot.

    Raises:
        RobotError: if it cannot be loaded; better here, at once, than in the log of a node.
    """
    loaded = load_robot(robot, urdf, srdf, package_dirs, tool_frame)
    chosen = robot_parameters(robot, urdf, srdf, package_dirs, tool_frame)
    return {
        "decomposition_node": {"frame_id": loaded.root_frame, "dimension": loaded.workspace_dimension},
        "inference_node": chosen,
        "planner_node": chosen,
    }


def run_nodes(
    robot: str,
    urdf: Path | None,
    srdf: Path | None,
    package_dirs: Sequence[Path],
    tool_frame: str | None,
    namespace: str,
    params_file: Path | None,
) -> int:
    """Run the three nodes until Ctrl-C, or until one of them ends. Returns the exit status."""
    parameters = suite_parameters(robot, urdf, srdf, package_dirs, tool_frame)
    try:
        with NodeProcesses(parameters, namespace=namespace, params_file=params_file) as processes:
            typer.echo(f"started {', '.join(processes.processes)}; Ctrl-C stops them")
            processes.wait()
    except KeyboardInterrupt:
        return 0
    except NodeDiedError as error:
        typer.echo(f"error: {error}", err=True)
        return 1
    return 0
