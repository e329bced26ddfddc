"""Options of commands that load an arm from a URDF."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

SrdfOption = Annotated[
    Path | None,
    typer.Option(help="SRDF that goes with the URDF: disabled collision pairs.", exists=True, dir_okay=False),
]
PackageOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--package-dir",
        help="Folder that holds the packages named in package:// addresses of meshes, e.g. the src of a workspace.",
    ),
]
ToolOption = Annotated[
    str | None,
    typer.Option("--tool-frame", "--tool", help="Frame of the arm that goal poses are for and keypoints guide."),
]
LockOption = Annotated[
    list[str] | None,
    typer.Option(
        "--lock",
        help="NAME=VALUE: hold this joint of the URDF still, e.g. a finger [rad or m]; 'finger_*=0' holds several. "
        "May be repeated.",
    ),
]
