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
_COMPILE = "from bsp_informed_planner.compile_kernels import main; main()"
# The package is imported; then it tells how long it takes to a planner that is ready.
_START = """
import time
import numpy as np
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.scene.shelf import random_shelf
begin = time.perf_counter()
robot = ur5()
Planner(robot, random_shelf(np.random.default_rng(0), frame=robot.root_frame).scene)
print(time.perf_counter() - begin)
"""
STARTS = 3


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
            begin = time.perf_counter()
            _run(_COMPILE, environment)
            cold = time.perf_counter() - begin
            starts = [float(_run(_START, environment)) for _ in range(STARTS)]
        return {"what": "kernels", "cold": cold, "cached": float(np.median(starts))}
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


def _run(code: str, environment: dict[str, str]) -> str:
    """The last word that a process of its own prints."""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.split()[-1] if done.stdout else ""


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table of covers, and the required times."""
    covers = [row for row in rows if row["what"] == "covers"]
    section.text(
        "Covers of new robots are built in this process, with compiled kernels. All kernels of this package are "
        "compiled as at installation, into an empty cache, by two processes where there are two processors. Then a "
        "fresh process imports this package, and the time is taken that it needs to a planner of the UR5 in a shelf, "
        f"ready to plan, whose kernels and covers are on disk: the median of {STARTS}."
    )
    if covers:
        section.table(
            ["robot", "outer balls", "nodes of trees", "inner balls", "pairs of groups", "never touch", "build [s]"],
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
                RequiredNumber("cached start of a planner", float(row["cached"]), "at most", START_LIMIT, "s")
            )
