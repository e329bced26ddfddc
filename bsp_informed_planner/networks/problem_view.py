"""What networks of whole paths see of a problem of an arm: start, goal, and distances from obstacles.

An arm whose first joint turns about the vertical through the origin may be turned together with the scene: nothing
changes. Everything is therefore given as it would be with the goal straight ahead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.robots.kinematic_chain import KinematicChain
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.encodings import FloatGrid, basis_points
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.signed_distance import SignedDistance


@dataclass(frozen=True)
class ViewOptions:
    """Where distances are taken. All of it is JSON: a part of the model's card.

    Attributes:
        lower, upper: (3,) corners of a box, with the goal straight ahead, over which points are spread [m].
        spread: number of these points.
        around: number of points around the tool at the start, and as many at the goal.
        radius: of the ball in which these are [m].
        line: number of configurations on the straight line from start to goal at which points on the links are taken.
        cap: distances are cut off here, and given in units of it [m].
        scene: False: distances are all taken for 0. A control: what is learned then is not learned from the scene.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    spread: int = 256
    around: int = 48
    radius: float = 0.3
    line: int = 9
    cap: float = 0.4
    scene: bool = True

    def to_json(self) -> dict[str, Any]:
        """As JSON values."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> ViewOptions:
        """What `to_json` wrote.

        Raises:
            InvalidOptionError: if it is none.
        """
        arguments: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        try:
            return ViewOptions(**arguments)
        except TypeError as error:
            raise InvalidOptionError("encoding", dict(values), "the options of a view of problems") from error


class ProblemView:
    """Turns problems of one robot into conditions of a network.

    Args:
        robot: an arm.
        options: see there.
    """

    def __init__(self, robot: Robot, options: ViewOptions) -> None:
        self.options = options
        self._robot = robot
        self._chain = KinematicChain.to_frame(robot.model, robot.model.getFrameId(robot.tool_frame))
        self._turns = turns_about_vertical(robot)
        lower, upper = np.array(options.lower), np.array(options.upper)
        self._spread = basis_points(lower, upper, options.spread)
        ball = basis_points(np.full(3, -1.0), np.full(3, 1.0), 2 * options.around + 8)
        self._ball = options.radius * ball[np.argsort(np.linalg.norm(ball, axis=1), kind="stable")[: options.around]]

    @property
    def size(self) -> int:
        """Length c of a condition."""
        n, options = self._robot.dof, self.options
        return 6 * n + 1 + options.spread + 2 * options.around + options.line * 2 * self._chain.dof

    def conditions(self, field: SignedDistance, starts: FloatArray, goals: FloatArray) -> FloatGrid:
        """Conditions (g, c) of problems in one scene.

        Args:
            field: of the scene.
            starts, goals: (g, n).
        """
        options, count = self.options, len(goals)
        turned = azimuths(self._robot, goals) if self._turns else np.zeros(count)
        first, last = turned_back(starts, turned), turned_back(goals, turned)
        states = np.concatenate(
            (first, last, last - first, np.sin(first), np.sin(last), np.cos(last), turned[:, None]), axis=1
        )
        if not options.scene:
            distances = np.zeros((count, self.size - states.shape[1]))
        else:
            points = self._points(turned, starts, goals)
            distances = np.clip(field.at(points.reshape(-1, 3)) / options.cap, -1.0, 1.0).reshape(count, -1)
        return np.concatenate((states, distances), axis=1).astype(np.float32)

    def _points(self, turned: FloatArray, starts: FloatArray, goals: FloatArray) -> FloatArray:
        """(g, p, 3) where distances are taken, in the root frame."""
        options, count, indices = self.options, len(goals), self._chain.indices
        cosine, sine, zero = np.cos(turned), np.sin(turned), np.zeros(count)
        # Transposed rotations: they are multiplied from the right.
        turns = np.stack((cosine, sine, zero, -sine, cosine, zero, zero, zero, zero + 1.0), axis=1).reshape(-1, 3, 3)
        share = np.linspace(0.0, 1.0, options.line)[:, None]
        line = (1.0 - share) * starts[:, None] + share * goals[:, None]
        bodies = self._chain.body_points(line.reshape(-1, self._robot.dof)[:, indices]).reshape(
            count, options.line, -1, 3
        )
        tools = bodies[:, [0, -1], -1]
        ball = self._ball @ turns
        near = (tools[:, :, None] + ball[:, None]).reshape(count, -1, 3)
        return np.concatenate((self._spread @ turns, near, bodies.reshape(count, -1, 3)), axis=1)


def turns_about_vertical(robot: Robot) -> bool:
    """Whether the first joint turns all of the robot about the vertical through the origin of its root frame."""
    chain = KinematicChain.to_frame(robot.model, robot.model.getFrameId(robot.tool_frame))
    upright = chain.rotations[0][2, 2] > 1.0 - 1e-9 and np.abs(chain.offsets[0][:2]).max() < 1e-6
    return bool(robot.workspace_dimension == 3 and chain.indices[0] == 0 and not chain.prismatic[0] and upright)


def azimuths(robot: Robot, goals: FloatArray) -> FloatArray:
    """(g,) by how much goals (g, n) are to be turned back to be straight ahead [rad]."""
    tools = robot.reference_points(goals)
    return np.asarray(np.arctan2(tools[:, 1], tools[:, 0]))


def turned_back(states: FloatArray, angles: FloatArray) -> FloatArray:
    """States (g, n), each turned back by an angle (g,) about the vertical [rad]."""
    turned = states.copy()
    turned[:, 0] -= angles
    return turned
