"""A scene with a start and goals."""

from __future__ import annotations

from dataclasses import dataclass

from bsp_informed_planner.errors import InvalidStateError, NoGoalError
from bsp_informed_planner.scene.pose import FloatArray, Pose, frozen_array
from bsp_informed_planner.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class ScenarioProblem:
    """A planning problem as a generator or a file states it.

    Attributes:
        scene: the obstacles.
        start: (n,) configuration [rad or m].
        goals: configurations (n,) [rad or m], any of which will do.
        goal_poses: poses of the tool in the frame of the scene, any of which will do.
        description: a sentence for people.

    Raises:
        InvalidStateError: if a configuration is not finite, empty or of another length than the start.
        NoGoalError: without goals and goal poses.
    """

    scene: Scene
    start: FloatArray
    goals: tuple[FloatArray, ...] = ()
    goal_poses: tuple[Pose, ...] = ()
    description: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", _configuration("start", self.start, -1))
        object.__setattr__(self, "goals", tuple(_configuration("goal", goal, len(self.start)) for goal in self.goals))
        object.__setattr__(self, "goal_poses", tuple(self.goal_poses))
        if not self.goals and not self.goal_poses:
            raise NoGoalError


def _configuration(state: str, values: FloatArray, length: int) -> FloatArray:
    try:
        array = frozen_array(values, (length,))
    except (ValueError, TypeError) as error:
        raise InvalidStateError(state, str(error)) from error
    if not len(array):
        raise InvalidStateError(state, "it is empty")
    return array
