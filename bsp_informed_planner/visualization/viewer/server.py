"""The server of a page: where it is, how it begins and how it ends."""

from __future__ import annotations

import contextlib
import importlib
import io
import threading
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from bsp_informed_planner.errors import MissingPackageError
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.palette import Colour

if TYPE_CHECKING:
    import viser

DEFAULT_PORT = 8080
# Who may look: this computer.
DEFAULT_HOST = "localhost"
# Direction of the first look, from the middle of things to the eye, and how far away it is in diagonals of their box.
FIRST_LOOK = np.array([-0.75, -0.45, 0.5])
FROM_ABOVE = np.array([0.0, -1e-3, 1.0])
DISTANCE, FLAT_DISTANCE = 1.1, 0.85


class Viewer:
    """A page with a space to look around in and a panel of controls beside it.

    Attributes:
        server: viser's. Its scene and panel take what layers add.
        lock: for callbacks that change more than one thing: viser calls them from several threads.
    """

    server: viser.ViserServer

    def __init__(self, title: str, *, host: str = DEFAULT_HOST, port: int = DEFAULT_PORT) -> None:
        """
        Args:
            title: above the panel.
            host: address to listen at; "0.0.0.0" lets other computers look too.
            port: the first of which it takes one that is free.

        Raises:
            MissingPackageError: if viser is not installed.
        """
        try:
            module: Any = importlib.import_module("viser")
        except ImportError as error:
            raise MissingPackageError("the viewer", "viser", "view") from error
        self.host = host
        with _silence():
            self.server = module.ViserServer(host=host, port=port, label=title, verbose=False)
        self.lock = threading.RLock()
        self.server.scene.set_up_direction("+z")
        self.server.gui.configure_theme(control_width="large", show_share_button=False, show_logo=False)

    @property
    def address(self) -> str:
        """What to type into a browser on this computer."""
        host = "localhost" if self.host in ("0.0.0.0", "::", "") else self.host
        return f"http://{host}:{self.port}"

    @property
    def port(self) -> int:
        return self.server.get_port()

    def look_at(self, lower: FloatArray, upper: FloatArray, *, from_above: bool = False) -> None:
        """Sets where new pages look from, so that a box (3,), (3,) [m] is in view."""
        centre = 0.5 * (lower + upper)
        direction = FROM_ABOVE if from_above else FIRST_LOOK
        direction = direction / np.linalg.norm(direction)
        extent = np.linalg.norm((upper - lower)[:2] if from_above else upper - lower)
        camera = self.server.initial_camera
        distance = (FLAT_DISTANCE if from_above else DISTANCE) * float(extent)
        camera.position = tuple(centre + distance * direction)
        camera.look_at = tuple(centre)

    def wait(self) -> None:
        """Serves the page until the process is interrupted (Ctrl-C)."""
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()

    def close(self) -> None:
        """Ends the server; open pages say that they have lost it."""
        with _silence():
            self.server.stop()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


def set_value(handle: Any, value: object) -> None:
    """Gives a control another value, as if it had been entered. (Type checkers take the attribute for read-only.)"""
    handle.value = value


def _silence() -> contextlib.AbstractContextManager[object]:
    """Keeps what viser prints out of the output of commands."""
    return contextlib.redirect_stdout(io.StringIO())


def rgb(colour: Colour) -> tuple[int, int, int]:
    """A colour as viser takes it."""
    red, green, blue = (round(255.0 * part) for part in colour)
    return red, green, blue
