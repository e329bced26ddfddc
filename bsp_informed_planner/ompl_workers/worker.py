"""The worker process that runs OMPL's planners: `python -m bsp_informed_planner.ompl_workers.worker FD`.

It reads a robot and a way to make checkers from the socket that it inherits, then scenes and requests, and ends when
the other end of the socket is closed: no worker outlives its parent.
"""

from __future__ import annotations

import contextlib
import logging
import sys
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.ompl_workers.planners import OmplSearch, silence
from bsp_informed_planner.ompl_workers.request import (
    CheckerFactory,
    Failed,
    Finished,
    FoundPath,
    OmplRequest,
    Ready,
    Stop,
    UseScene,
)
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds

logger = logging.getLogger(__name__)

#: Checkers of different paddings and resolutions that are kept.
MAX_CHECKERS = 8
#: Of the edge that is checked before the worker is ready [m].
WARM_UP_RESOLUTION = 1e-3


class Worker:
    """Serves one parent.

    Args:
        connection: to the parent.
        robot: the robot.
        make_checker: makes the checkers.
    """

    def __init__(self, connection: Connection, robot: Robot, make_checker: CheckerFactory) -> None:
        self._connection = connection
        self._robot = robot
        self._make_checker = make_checker
        self._scene: Scene | None = None
        self._checkers: dict[tuple[float, float], CollisionChecker] = {}

    def serve(self) -> None:
        """Answer requests until the parent hangs up.

        Raises:
            EOFError, OSError: when it does.
        """
        # What fails here is told by the first search.
        with contextlib.suppress(Exception):
            self._get_ready()
        self._connection.send(Ready())
        while True:
            message = self._connection.recv()
            if isinstance(message, UseScene):
                self._scene, self._checkers = message.scene, {}
            elif isinstance(message, OmplRequest):
                self._answer(message)
            # A request to stop that came too late stops nothing.

    def _get_ready(self) -> None:
        """Load what the first check of an edge would load."""
        nothing = Scene.of([], WorkspaceBounds(-np.ones(3), np.ones(3)), self._robot.root_frame)
        lower, upper = np.asarray(self._robot.lower), np.asarray(self._robot.upper)
        checker = self._make_checker(self._robot, nothing, WARM_UP_RESOLUTION, 0.0)
        checker.is_edge_free(0.5 * (lower + upper), 0.51 * lower + 0.49 * upper)

    def _answer(self, request: OmplRequest) -> None:
        try:
            search = OmplSearch(request, self._checker(request), self._should_stop, self._send_path)
            search.run()
            self._connection.send(Finished(search.counts))
        except (EOFError, OSError):
            raise
        except Exception as error:
            logger.exception("a search failed")
            self._connection.send(Failed(f"raised {type(error).__name__}: {error}"))

    def _checker(self, request: OmplRequest) -> CollisionChecker:
        assert self._scene is not None, "a request came before its scene"
        key = (request.padding, request.resolution)
        if key not in self._checkers:
            if len(self._checkers) >= MAX_CHECKERS:
                self._checkers = {}
            self._checkers[key] = self._make_checker(self._robot, self._scene, request.resolution, request.padding)
        return self._checkers[key]

    def _should_stop(self) -> bool:
        if not self._connection.poll():
            return False
        message = self._connection.recv()
        assert isinstance(message, Stop), f"{type(message).__name__} came during a search"
        return True

    def _send_path(self, path: Any) -> None:
        self._connection.send(FoundPath(path))


def main() -> None:
    """Serve the process at the other end of the socket whose file descriptor is the first argument."""
    logging.basicConfig(level=logging.WARNING)
    silence()
    connection = Connection(int(sys.argv[1]))
    # When the parent has ended, or wants no more.
    with contextlib.suppress(EOFError, OSError):
        robot, make_checker = connection.recv()
        Worker(connection, robot, make_checker).serve()


if __name__ == "__main__":
    main()
