"""What a robot needs before it can be planned for at once: its collision bounds, and one go through what plans do."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

import numpy as np

from bsp_informed_planner.collision.bounds import bounds_at_hand, bounds_of
from bsp_informed_planner.collision.group_covers import load_cover_kernels
from bsp_informed_planner.errors import BspPlannerError, RobotDescriptionError
from bsp_informed_planner.nodes.world import WorldTracker
from bsp_informed_planner.planning.box_problem import random_box_problem
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds

logger = logging.getLogger(__name__)

#: So long it is waited for bounds that are built [s]: those of a simple robot are ready by then.
BRIEFLY = 5.0

#: Makes use of a planner and of a problem that it can be tried on.
WarmUp = Callable[[Planner, ScenarioProblem], None]


class _SupersededError(Exception):
    """Another robot has come meanwhile, or the node is cleaned up."""


class RobotPreparation:
    """Hands robots over to a world when they are ready; the newest wins.

    Bounds that are known, or in a file, are read at once. Those that must be built, which takes up to a minute, are
    built in a thread, with progress in the log; unless that is soon over, the world says so to whoever wants to plan.

    Args:
        world: of the node.
        warm_up: done once with each robot, so that no request pays for what is made when it is first used.
        on_error: told why a robot cannot be used; the one before stays.
    """

    def __init__(self, world: WorldTracker, warm_up: WarmUp, on_error: Callable[[str], None]) -> None:
        self._world = world
        self._warm_up = warm_up
        self._on_error = on_error
        self._lock = threading.Lock()
        self._newest: Robot | None = None

    def submit(self, robot: Robot) -> None:
        """Prepare a robot, now or in a thread.

        Raises:
            RobotError: if it cannot be planned for, as far as that is found out at once.
        """
        with self._lock:
            self._newest = robot
        if bounds_at_hand(robot) is not None:
            try:
                self._finish(robot)
            except Exception:
                # A robot before it, which was being prepared, is not waited for any more.
                self._world.expect_no_robot()
                raise
            return
        self._world.expect_robot(robot.name, 0.0)
        thread = threading.Thread(target=self._build, args=(robot,), name="bounds", daemon=True)
        thread.start()
        thread.join(BRIEFLY)

    def close(self) -> None:
        """Give up what is being prepared; its thread ends at the next step."""
        with self._lock:
            self._newest = None

    def _build(self, robot: Robot) -> None:
        def progress(done: int, total: int) -> None:
            with self._lock:
                if self._newest is not robot:
                    raise _SupersededError
                self._world.expect_robot(robot.name, done / total)
            logger.info("bounds of %s: %.0f %%", robot.name, 100.0 * done / total)

        try:
            bounds_of(robot, progress)
            self._finish(robot)
        except _SupersededError:
            logger.info("the bounds of %s are no longer needed", robot.name)
        except Exception as error:
            logger.debug("while preparing a robot", exc_info=error)
            with self._lock:
                is_newest = self._newest is robot
            if is_newest:
                self._world.expect_no_robot()
                self._on_error(f"robot {robot.name} cannot be used: {error}")

    def _finish(self, robot: Robot) -> None:
        warm_up(robot, self._warm_up)
        with self._lock:
            if self._newest is robot:
                self._world.set_robot(robot)


def warm_up(robot: Robot, use: WarmUp) -> None:
    """Have a robot used once, among boxes.

    Raises:
        RobotDescriptionError: if it has no collision geometry.
    """
    # Says what is wrong with a robot that cannot be planned for at all.
    Planner(robot, Scene.of([], WorkspaceBounds(-np.ones(3), np.ones(3)), robot.root_frame))
    # For what it is given to hold.
    load_cover_kernels()
    try:
        problem = random_box_problem(robot, np.random.default_rng(0), boxes=4)
        use(Planner(robot, problem.scene), problem)
    except RobotDescriptionError:
        raise
    except BspPlannerError as error:
        # Some problems have no solution; the first plan takes longer then.
        logger.info("robot %s was not warmed up: %s", robot.name, error)
