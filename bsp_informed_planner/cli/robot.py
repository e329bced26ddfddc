"""`bsp-planner robot`: what concerns a robot alone. The work is done in modules of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bsp_informed_planner.cli.robot_options import LockOption, PackageOption, SrdfOption, ToolOption

app = typer.Typer(help="Look at a robot before planning for it.", no_args_is_help=True)


@app.callback()
def about() -> None:
    """Look at a robot before planning for it."""


@app.command()
def check(
    urdf: Annotated[Path, typer.Argument(help="URDF of the arm.", exists=True, dir_okay=False)],
    srdf: SrdfOption = None,
    package_dir: PackageOption = None,
    tool_frame: ToolOption = None,
    lock: LockOption = None,
    write_srdf: Annotated[
        Path | None,
        typer.Option(help="Write an SRDF into this file that exempts the pairs that always or never collide."),
    ] = None,
    samples: Annotated[int, typer.Option(help="Configurations that self-collision is looked for in.", min=100)] = 10000,
    seed: Annotated[int, typer.Option(help="Of all that is random.", min=0)] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Say what of a robot description works, what does not, and what to do about it.

    Ends with status 1 if something prevents planning.
    """
    from bsp_informed_planner.cli.robot_check import CheckArguments, run_check

    raise typer.Exit(
        run_check(
            CheckArguments(
                urdf, srdf, tuple(package_dir or ()), tool_frame, tuple(lock or ()), write_srdf, samples, seed, json
            )
        )
    )
