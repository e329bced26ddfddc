"""Verdicts on configurations: right, or none, and how often there is one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.collision.subjects import (
    FAMILIES,
    ROBOTS,
    configurations_inside,
    configurations_of,
    robot_of,
    scene_of,
    shelf_for,
)
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, share, upper_bound_of_none
from bsp_informed_planner.collision.bounds import bounds_of
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.verdict_calls_kernels import COLLIDING, FREE
from bsp_informed_planner.collision.verdicts import Verdicts
from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

QUICK_STATES, FULL_STATES = 30_000, 1_000_000
STATES_OF_A_CASE = 2000
OPEN_LIMIT, INSIDE_LIMIT = 95.0, 85.0
PADDINGS = (0.0, 0.0, 0.005, 0.03)
# Of a case inside a shelf, where few configurations are free.
INSIDE_STATES = 4000


def states_part(quick: bool) -> Part:
    """Random configurations of all robots in scenes of all kinds."""
    count = (QUICK_STATES if quick else FULL_STATES) // STATES_OF_A_CASE
    kinds = [(robot, family) for family in FAMILIES for robot in ROBOTS]
    cases: list[Parameters] = []
    for index in range(max(count, len(kinds))):
        robot, family = kinds[index % len(kinds)]
        padding = PADDINGS[(index // len(kinds)) % len(PADDINGS)]
        size = STATES_OF_A_CASE if count >= len(kinds) else QUICK_STATES // len(kinds)
        cases.append({"robot": robot, "family": family, "padding": padding, "states": size})
    title = "Configurations against the exact judge"
    return Part("states", title, cases, measure, summarise, Mode.PARALLEL)


def inside_part(quick: bool) -> Part:
    """Configurations whose tool is inside a shelf."""
    cases: list[Parameters] = [{"robot": robot} for robot in ROBOTS for _ in range(2 if quick else 12)]
    return Part("inside", "Inside shelves", cases, measure_inside, summarise_inside, Mode.PARALLEL)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Configurations in one scene."""
    robot = robot_of(str(parameters["robot"]))
    scene = scene_of(str(parameters["family"]), str(parameters["robot"]), rng)
    states = configurations_of(robot, int(parameters["states"]), rng)
    return {**parameters, **_counts(robot, scene, float(parameters["padding"]), states)}


def measure_inside(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Configurations whose tool is in a level of one shelf."""
    name = str(parameters["robot"])
    shelf = shelf_for(name, rng)
    states = configurations_inside(robot_of(name), shelf, INSIDE_STATES, rng)
    return {**parameters, **_counts(robot_of(name), shelf.scene, 0.0, states)}


def _counts(robot: ArmRobot, scene: Scene, padding: float, states: FloatArray) -> dict[str, int]:
    verdicts = Verdicts(bounds_of(robot).checks(scene, padding)).of_states(states)
    judge = ExactChecker(robot, scene, padding=padding)
    free = np.array([judge.is_free(state) for state in states])
    return {
        "free": int(free.sum()),
        "colliding": int((~free).sum()),
        "decided_free": int((free & (verdicts == FREE)).sum()),
        "decided_colliding": int((~free & (verdicts == COLLIDING)).sum()),
        "false_free": int((~free & (verdicts == FREE)).sum()),
        "false_hits": int((free & (verdicts == COLLIDING)).sum()),
    }


def _table(rows: Sequence[Row], section: Section, name: str, keys: Sequence[str]) -> None:
    table = []
    for key in keys:
        own = [row for row in rows if row[name] == key]
        if own:
            free, hit = int(column(own, "free").sum()), int(column(own, "colliding").sum())
            table.append(
                [
                    key,
                    free + hit,
                    int(column(own, "false_free").sum()),
                    int(column(own, "false_hits").sum()),
                    share(int(column(own, "decided_free").sum()), free).scaled(100.0) if free else "",
                    share(int(column(own, "decided_colliding").sum()), hit).scaled(100.0) if hit else "",
                ]
            )
    section.table([name, "states", "false free", "false hits", "free decided [%]", "colliding decided [%]"], table)


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """Counts of wrong verdicts, and shares of decided configurations."""
    section.text(
        "Uniform configurations among random obstacles; all pairs of links are checked. Each verdict of the kernels is "
        "compared with that of the exact judge (Pinocchio and coal). Paddings: none in half of the scenes, 5 or 30 mm "
        "in the others."
    )
    _table(rows, section, "family", FAMILIES)
    _table(rows, section, "robot", list(ROBOTS))
    total = int(column(rows, "free").sum() + column(rows, "colliding").sum())
    for name, text in (("false_free", "free by the kernels, colliding by the judge"), ("false_hits", "the reverse")):
        wrong = int(column(rows, name).sum())
        remark = f"of {total:,} (95 %: below {upper_bound_of_none(total):.1g})" if wrong == 0 else f"of {total:,}"
        section.require(RequiredNumber(f"configurations {text}", wrong, "exactly", 0, remark=remark))
    for robot in ROBOTS:
        own = [row for row in rows if row["robot"] == robot]
        if own:
            decided = share(int(column(own, "decided_free").sum()), int(column(own, "free").sum())).scaled(100.0)
            name = f"free configurations decided in the open, {robot}"
            section.require(RequiredNumber(name, decided, "at least", OPEN_LIMIT, "%"))


def summarise_inside(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """Shares of decided configurations inside shelves."""
    section.text("Uniform configurations whose tool point is inside one of the three levels of a random shelf.")
    _table(rows, section, "robot", list(ROBOTS))
    wrong = int(column(rows, "false_free").sum() + column(rows, "false_hits").sum())
    section.require(RequiredNumber("wrong verdicts inside shelves", wrong, "exactly", 0))
    for robot in ROBOTS:
        own = [row for row in rows if row["robot"] == robot and row["free"]]
        if own:
            decided = share(int(column(own, "decided_free").sum()), int(column(own, "free").sum())).scaled(100.0)
            name = f"free configurations decided inside shelves, {robot}"
            section.require(RequiredNumber(name, decided, "at least", INSIDE_LIMIT, "%"))
