"""Problems check themselves."""

from __future__ import annotations

import numpy as np
import pytest

from bsp_informed_planner.errors import InvalidStateError, NoGoalError
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds

SCENE = Scene.of([], WorkspaceBounds(np.zeros(3), np.ones(3)))


def test_problem_is_read_only() -> None:
    problem = ScenarioProblem(SCENE, np.zeros(2), (np.ones(2),))
    assert not problem.start.flags.writeable
    assert not problem.goals[0].flags.writeable


def test_goals_are_needed() -> None:
    with pytest.raises(NoGoalError):
        ScenarioProblem(SCENE, np.zeros(2))


@pytest.mark.parametrize(
    ("start", "goal", "state"),
    [
        (np.array([np.nan, 0.0]), np.zeros(2), "start"),
        (np.zeros(0), np.zeros(0), "start"),
        (np.zeros((2, 2)), np.zeros(2), "start"),
        (np.zeros(2), np.array([0.0, np.inf]), "goal"),
        (np.zeros(2), np.zeros(3), "goal"),
    ],
)
def test_bad_configurations_say_which(start: np.ndarray, goal: np.ndarray, state: str) -> None:
    with pytest.raises(InvalidStateError) as caught:
        ScenarioProblem(SCENE, start, (goal,))
    assert caught.value.state == state
