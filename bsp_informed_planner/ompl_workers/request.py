"""What is sent to a worker process that runs OMPL's planners, and what comes back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene


class CheckerFactory(Protocol):
    """Makes the collision checker of a search. A class, or a function of a module, so that other processes find it."""

    def __call__(self, robot: Robot, scene: Scene, resolution: float, padding: float) -> CollisionChecker:
        """
        Args:
            robot, scene: as usual.
            resolution: no point of the robot moves further between two states of an edge that are checked, where it is
                not proved free as a whole [m].
            padding: distance to keep from obstacles [m].
        """
        ...


@dataclass(frozen=True, eq=False)
class OmplRequest:
    """One search.

    Attributes:
        planner_id: one of `OMPL_PLANNER_IDS`.
        start: (n,) free.
        goals: (k, n) free, the nearest first.
        lower, upper: (n,) the box that is searched [rad or m].
        padding, resolution: of the checker, as its factory takes them [m].
        deadline: when to stop, by `time.monotonic`, which all processes of a machine share [s].
        seed: of OMPL's random numbers.
        max_step: longest edge of a tree [rad or m]; None: OMPL's own choice.
        simplify: whether OMPL's simplification follows RRT-Connect.
        first_solution: stop at the first path.
        discrete_fraction: None: edges are checked by the checker; else by OMPL's own motion validator, at states this
            fraction of the diagonal of the box apart (OMPL's default is 0.01).
    """

    planner_id: str
    start: FloatArray
    goals: FloatArray
    lower: FloatArray
    upper: FloatArray
    padding: float
    resolution: float
    deadline: float
    seed: int
    max_step: float | None = None
    simplify: bool = True
    first_solution: bool = False
    discrete_fraction: float | None = None


@dataclass(frozen=True)
class OmplCounts:
    """What a search did.

    Attributes:
        edges: straight edges that were checked.
        states: single configurations that were.
        exact_checks: configurations given to the exact check.
    """

    edges: int = 0
    states: int = 0
    exact_checks: int = 0


# --- to the worker ---


@dataclass(frozen=True, eq=False)
class UseScene:
    """Check against this scene from now on."""

    scene: Scene


@dataclass(frozen=True)
class Stop:
    """End the search; the worker stays."""


# --- from the worker ---


@dataclass(frozen=True)
class Ready:
    """The worker has loaded all it needs."""


@dataclass(frozen=True, eq=False)
class FoundPath:
    """A path (m, n), better than those before."""

    path: FloatArray


@dataclass(frozen=True)
class Finished:
    """The search has ended; the worker waits for the next one."""

    counts: OmplCounts


@dataclass(frozen=True)
class Failed:
    """The search has ended with an exception; the worker waits for the next one."""

    reason: str
