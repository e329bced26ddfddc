"""The database of local primitives of the GMM baseline, from a dataset."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bsp_informed_planner.errors import TrainingError
from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.provenance import robot_identity
from bsp_informed_planner.experience.sampler_examples import POINTS
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.gmm import GmmOptions, PrimitiveDatabase
from bsp_informed_planner.sampling.local_primitives import LocalPrimitives
from bsp_informed_planner.sampling.path_shapes import resampled

#: Problems in the database, as in the paper.
PROBLEMS = 500
#: For robots that only slide: gaps are narrower, and a place is similar only if it is where it was.
PLANAR_OPTIONS = GmmOptions(reach=0.2, radius=0.1, sigma=0.03)


def build_database(
    experience: Experience,
    robot: Robot,
    options: GmmOptions | None = None,
    problems: int = PROBLEMS,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> PrimitiveDatabase:
    """The waypoints of solved problems, with the primitives that they are close to.

    Args:
        experience: the solved problems of its split "train" are used, the paths of whole problems.
        robot: of the problems: tells where its reference point is at a waypoint.
        options: None: what suits the robot.
        problems: at most so many.
        report: told how many problems have been read.

    Raises:
        DatasetMismatchError: if the problems are of another robot.
        TrainingError: if there are none.
    """
    experience.require_robot(robot_identity(robot))
    solved = experience.select(split="train", solved=True)
    count = min(problems, len(solved))
    if not count:
        raise TrainingError(f"{experience.folder} has no solved problems in its split 'train'")
    options = options or (GmmOptions() if robot.revolute.any() else PLANAR_OPTIONS)
    parts = []
    for number in range(count):
        states = resampled(solved.paths[number], POINTS)
        points = np.array([robot.forward_kinematics(state).position for state in states])
        parts.append((LocalPrimitives.of(solved.scene(number), options.reach), states, points))
        report(number + 1, count)
    return PrimitiveDatabase.of(parts, robot.dof, options)
