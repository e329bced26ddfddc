"""Where the problems of a dataset come from: a seed gives a problem."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.errors import DatasetError, InvalidOptionError, PlanningFailedError, ProblemError
from bsp_informed_planner.experience.seeds import SPLITS, Stage, generator, index_of, split_of
from bsp_informed_planner.planning.shelf_problem import (
    ShelfVariant,
    free_configurations,
    random_shelf_problem_with_goals,
)
from bsp_informed_planner.planning.validation import validated_state
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.layers import nearest_windings
from bsp_informed_planner.scene.maze import MazeOptions, random_maze
from bsp_informed_planner.scene.moveit_yaml import load_scene
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.scene.shelf import ShelfOptions
from bsp_informed_planner.scene.yaml_io import problem_from_yaml
from bsp_informed_planner.scene.yaml_node import parse_yaml, read_text

FAMILIES = ("maze", "shelf", "files")
GOAL_CHOICES = ("random", "any")
#: Tries for a free configuration in a scene without a problem.
_STATE_TRIES = 2000
#: Of ten scene files, by a hash of their content, so many go to each split.
_FILES_OF_TEN = {"train": 8, "validation": 1, "test": 1}


@dataclass(frozen=True, eq=False)
class GeneratedProblem:
    """A problem as a source states it.

    Attributes:
        family: of the source.
        stratum: kind of problem within the family.
        scene: the obstacles.
        start: (n,)
        goals: (g, n) configurations, any of which will do; g >= 1.
    """

    family: str
    stratum: str
    scene: Scene
    start: FloatArray
    goals: FloatArray


class ProblemSource(Protocol):
    """Makes problems from seeds. Can be pickled: workers have one each."""

    @property
    def family(self) -> str:
        """What it makes, for people and for the rows."""
        ...

    def parameters(self) -> Mapping[str, Any]:
        """All that its problems depend on beside their seeds, as JSON knows it."""
        ...

    def problem(self, seed: int) -> GeneratedProblem:
        """The problem of a seed (`experience.seeds`), always the same one."""
        ...


@dataclass(frozen=True)
class MazeSource:
    """Random mazes for a point robot. `options`: what they look like."""

    options: MazeOptions = field(default_factory=MazeOptions)
    family: str = "maze"

    def parameters(self) -> Mapping[str, Any]:
        return asdict(self.options)

    def problem(self, seed: int) -> GeneratedProblem:
        maze = random_maze(generator(seed, Stage.PROBLEM), self.options)
        count = len(maze.walls)
        stratum = "up to 9 walls" if count < 10 else "10 to 14 walls" if count < 15 else "15 walls and more"
        return GeneratedProblem(self.family, stratum, maze.scene, maze.start, maze.goal[None])


@dataclass(frozen=True, eq=False)
class ShelfSource:
    """Random shelves for an arm.

    Attributes:
        robot: the arm.
        options: of the shelves.
        shares: how many of the problems are of each variant; they need not sum to one.
        goal_choice: "random": one of the free branches of the goal pose, which need not be the best to reach; "any":
            all of them. Always in the winding next to the start.
    """

    robot: Robot
    options: ShelfOptions = field(default_factory=ShelfOptions)
    shares: tuple[tuple[ShelfVariant, float], ...] = (
        (ShelfVariant.OUTSIDE_TO_LEVEL, 0.4),
        (ShelfVariant.OUTSIDE_TO_DEEP, 0.2),
        (ShelfVariant.LEVEL_TO_LEVEL, 0.25),
        (ShelfVariant.TIGHT, 0.15),
    )
    goal_choice: str = "random"
    family: str = "shelf"

    def __post_init__(self) -> None:
        _require_goal_choice(self.goal_choice)

    def parameters(self) -> Mapping[str, Any]:
        shares = {variant.value: share for variant, share in self.shares}
        return {"shelf": asdict(self.options), "shares": shares, "goal_choice": self.goal_choice}

    def problem(self, seed: int) -> GeneratedProblem:
        rng = generator(seed, Stage.PROBLEM)
        weights = np.array([share for _, share in self.shares])
        variant = self.shares[int(rng.choice(len(weights), p=weights / weights.sum()))][0]
        scenario, branches = random_shelf_problem_with_goals(self.robot, rng, self.options, variant)
        goals = nearest_windings(self.robot, branches, scenario.start)
        if self.goal_choice == "random":
            goals = goals[rng.integers(len(goals))][None]
        return GeneratedProblem(self.family, variant.value, scenario.scene, scenario.start, goals)


class SceneFileSource:
    """Problems in scene files of a folder, of our format or MoveIt's.

    Problem i is in file i modulo their number. A file with a problem gives this one first; all others have starts and
    goals at random. Which split a file belongs to is decided by a hash of its content: no scene is in two of them.

    Args:
        folder: with *.yaml or *.yml files.
        robot: whose problems they are.
        goal_choice: as for `ShelfSource`, where a file has a goal pose.

    Raises:
        DatasetError: if the folder holds no scene files.
        SceneError: if a file is none.
    """

    def __init__(self, folder: Path, robot: Robot, goal_choice: str = "random") -> None:
        _require_goal_choice(goal_choice)
        self._robot = robot
        self._goal_choice = goal_choice
        self._folder = folder
        self._files: dict[str, list[Path]] = {split: [] for split in SPLITS}
        self._hashes: dict[str, str] = {}
        paths = sorted(path for path in folder.iterdir() if path.suffix in (".yaml", ".yml")) if folder.is_dir() else []
        if not paths:
            raise DatasetError(str(folder), "holds no scene files (*.yaml)")
        for path in paths:
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            self._hashes[path.name] = digest
            self._files[_split_of_file(digest)].append(path)

    @property
    def family(self) -> str:
        return "files"

    def parameters(self) -> Mapping[str, Any]:
        return {"files": self._hashes, "goal_choice": self._goal_choice}

    def problem(self, seed: int) -> GeneratedProblem:
        split, index = split_of(seed), index_of(seed)
        files = self._files[split]
        if not files:
            raise DatasetError(
                str(self._folder),
                f"none of its {len(self._hashes)} scene files belongs to the split '{split}': a file goes to a split "
                "by its content; add some more",
            )
        path = files[index % len(files)]
        rng = generator(seed, Stage.PROBLEM)
        scenario = _problem_in(path) if index < len(files) else None
        if scenario is not None:
            try:
                start = validated_state(self._robot, "start", scenario.start)
            except ProblemError as error:
                raise DatasetError(str(path), str(error)) from error
            scenario = ScenarioProblem(scenario.scene, start, scenario.goals, scenario.goal_poses)
            goals = _goals(self._robot, scenario, rng, self._goal_choice)
            if len(goals):
                return GeneratedProblem(self.family, path.name, scenario.scene, start, goals)
        scene = load_scene(path)
        start, goal = _random_states(self._robot, scene, rng, path)
        return GeneratedProblem(self.family, path.name, scene, start, goal[None])


def _require_goal_choice(choice: str) -> None:
    if choice not in GOAL_CHOICES:
        raise InvalidOptionError("goal_choice", choice, f"one of {', '.join(GOAL_CHOICES)}")


def _goals(robot: Robot, scenario: ScenarioProblem, rng: np.random.Generator, choice: str) -> FloatArray:
    """(g, n) the goal configurations to choose from, wound towards the start."""
    checker = BoundedChecker(robot, scenario.scene)
    branches = [branch for pose in scenario.goal_poses for branch in free_configurations(robot, checker, pose)]
    goals = list(scenario.goals)
    if branches:
        goals.extend(nearest_windings(robot, np.array(branches), scenario.start))
    if choice == "random" and len(goals) > 1:
        goals = [goals[int(rng.integers(len(goals)))]]
    return np.array(goals).reshape(-1, robot.dof)


def _split_of_file(digest: str) -> str:
    rank = int(digest, 16) % 10
    for split, count in _FILES_OF_TEN.items():
        if rank < count:
            return split
        rank -= count
    raise AssertionError("the counts sum to ten")


def _problem_in(path: Path) -> ScenarioProblem | None:
    if parse_yaml(read_text(path), str(path), path.parent).get("problem") is None:
        return None
    return problem_from_yaml(path)


def _random_states(robot: Robot, scene: Scene, rng: np.random.Generator, path: Path) -> tuple[FloatArray, FloatArray]:
    """Two free configurations at random, of joints that turn within half a turn of zero where the limits allow."""
    checker = BoundedChecker(robot, scene)
    middle = np.clip(0.0, robot.lower, robot.upper)
    lower = np.where(robot.revolute, np.maximum(robot.lower, middle - np.pi), robot.lower)
    upper = np.where(robot.revolute, np.minimum(robot.upper, middle + np.pi), robot.upper)
    states: list[FloatArray] = []
    for _ in range(_STATE_TRIES):
        state = rng.uniform(lower, upper)
        inside = bool(scene.bounds.contains(robot.forward_kinematics(state).position))
        if inside and checker.is_free(state):
            states.append(state)
        if len(states) == 2:
            return states[0], states[1]
    raise PlanningFailedError(f"{path}: robot '{robot.name}' has next to no free configurations in this scene")
