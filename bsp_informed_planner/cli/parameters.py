"""`bsp-planner parameters`."""

from __future__ import annotations

from pathlib import Path

import typer


def run_parameters(write: Path | None) -> int:
    """Print the table of parameters, or write it into a file. Returns the exit status."""
    # Loads the nodes, and rclpy with them.
    from bsp_informed_planner.nodes.parameter_table import parameter_table

    if write is None:
        typer.echo(parameter_table(), nl=False)
    else:
        write.write_text(parameter_table(), encoding="utf-8")
    return 0
