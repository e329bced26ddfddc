"""Pages for a browser that commands open."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from bsp_informed_planner.visualization.viewer.server import Viewer


def open_viewer(title: str, host: str, port: int) -> Viewer:
    """An empty page.

    Raises:
        MissingPackageError: if viser is not installed.
    """
    from bsp_informed_planner.visualization.viewer.server import Viewer

    viewer = Viewer(title, host=host, port=port)
    if port not in (0, viewer.port):
        typer.echo(f"port {port} is taken, so the page is at {viewer.port}", err=True)
    return viewer


def serve(viewer: Viewer) -> None:
    """Says where the page is, and serves it until Ctrl-C."""
    with contextlib.suppress(KeyboardInterrupt):
        typer.echo(f"open {viewer.address} in a browser; Ctrl-C ends", err=True)
        viewer.wait()
