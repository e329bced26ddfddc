"""What is done once: covers of a new robot, compilation, and the start with what is kept on disk."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.collision.subjects import ROBOTS, robot_of
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.collision.body_groups import group_bodies
from bsp_informed_planner.collision.bounds import build_covers

BUILD_LIMIT, COMPILE_LIMIT, START_LIMIT = 90.0, 30.0, 0.5
# Compiles or loads the kernels that a plan takes, and tells how long.
_START = """
import time
import numpy as np
from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.bounds import CollisionBounds
from bsp_informed_planner.collision.body_groups import group_bodies
from bsp_informed_planner.collision.cover import Cover, RobotCovers
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds
robot = PointRobot()
ball = np.array([[0.0, 0.0, 0.0, 0.01]])
covers = RobotCovers((Cover(ball, np.array([1]), ball),), np.empty((0, 2), dtype=np.int64))
bounds = CollisionBounds(robot, group_bodies(robot.collision_model), covers)
scene = Scene.of([], WorkspaceBounds(np.zeros(3) - 1.0, np.ones(3)), robot.root_frame)
begin = time.perf_counter()
checker = BoundedChecker(robot, scene, bounds=bounds)
checker.is_free(np.zeros(2))
checker.is_edge_free(np.zeros(2), np.ones(2))
print(time.perf_counter() - begin)
"""


def setting_up_part(quick: bool) -> Part:
    """Covers of all robots (quick: the UR5's), and compilation."""
    cases: list[Parameters] = [{"what": "covers", "robot": robot} for robot in ROBOTS]
    cases = cases[:1] if quick else cases
    return Part("setting up", "Done once", [*cases, {"what": "kernels"}], measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Times one of them."""
    if parameters["what"] == "kernels":
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
            cold, cached = (_started(environment) for _ in range(2))
        return {"what": "kernels", "cold": cold, "cached": cached}
    robot = robot_of(str(parameters["robot"]))
    begin = time.perf_counter()
    built = build_covers(robot)
    seconds = time.perf_counter() - begin
    covers = built.covers
    return {
        "what": "covers",
        "robot": str(parameters["robot"]),
        "seconds": seconds,
        "outer": sum(int((cover.ends == np.arange(len(cover.ends)) + 1).sum()) for cover in covers),
        "nodes": sum(len(cover.outer) for cover in covers),
        "inner": sum(len(cover.inner) for cover in covers),
        "clear": len(built.clear_pairs),
        "pairs": len(group_bodies(robot.collision_model).pairs),
    }


def _started(environment: dict[str, str]) -> float:
    done = subprocess.run([sys.executable, "-c", _START], env=environment, capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table of covers, and the required times."""
    covers = [row for row in rows if row["what"] == "covers"]
    section.text(
        "Covers are built in this process with compiled kernels; kernels are compiled in a process of its own."
    )
    if covers:
        section.table(
            [
                "robot",
                "outer balls",
                "nodes of the trees",
                "inner balls",
                "pairs of groups",
                "always clear",
                "build [s]",
            ],
            [
                [*(row[name] for name in ("robot", "outer", "nodes", "inner", "pairs", "clear")), float(row["seconds"])]
                for row in covers
            ],
        )
    for row in covers:
        name = f"covers of a {row['robot']}"
        section.require(RequiredNumber(name, float(row["seconds"]), "at most", BUILD_LIMIT, "s"))
    for row in rows:
        if row["what"] == "kernels":
            section.require(RequiredNumber("cold compilation", float(row["cold"]), "at most", COMPILE_LIMIT, "s"))
            section.require(
                RequiredNumber("start with kernels on disk", float(row["cached"]), "at most", START_LIMIT, "s")
            )
