"""Verdicts on edges: what is proved free is free at all states that the exact judge looks at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.collision.subjects import (
    FAMILIES,
    ROBOTS,
    configurations_of,
    robot_of,
    scene_of,
)
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, share, upper_bound_of_none
from bsp_informed_planner.collision.bounds import bounds_of
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.verdict_calls_kernels import COLLIDING, FREE, UNDECIDED
from bsp_informed_planner.collision.verdicts import Verdicts

QUICK_EDGES, FULL_EDGES = 1500, 100_000
EDGES_OF_A_CASE = 100
# No point of the robot moves further between states that the judge looks at; finer for some, and finest where the
# kernels say that an edge collides and the judge has found nothing [m].
SPACING, FINE_SPACING, FINEST_SPACING = 0.02, 0.002, 5e-5
FINE_SHARE = 0.03


def edges_part(quick: bool) -> Part:
    """Random edges of all robots in scenes of all kinds."""
    count = (QUICK_EDGES if quick else FULL_EDGES) // EDGES_OF_A_CASE
    kinds = [(robot, family) for family in FAMILIES for robot in ROBOTS]
    cases: list[Parameters] = []
    for index in range(max(count, len(kinds))):
        robot, family = kinds[index % len(kinds)]
        size = EDGES_OF_A_CASE if count >= len(kinds) else QUICK_EDGES // len(kinds)
        cases.append({"robot": robot, "family": family, "edges": size})
    return Part("edges", "Edges against the exact judge", cases, measure, summarise, Mode.PARALLEL)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Edges in one scene, from free configurations, up to 1.5 rad or m long."""
    robot = robot_of(str(parameters["robot"]))
    scene = scene_of(str(parameters["family"]), str(parameters["robot"]), rng)
    verdicts, judge = Verdicts(bounds_of(robot).checks(scene)), ExactChecker(robot, scene)
    row = dict.fromkeys(
        ("free", "colliding", "certified", "decided_colliding", "undecided", "false_free", "false_hits", "fine"), 0
    )
    tried = 0
    while sum(row[name] for name in ("free", "colliding")) < int(parameters["edges"]) and tried < 20_000:
        tried += 1
        start = configurations_of(robot, 1, rng)[0]
        if not judge.is_free(start):
            continue
        step = rng.normal(size=robot.dof)
        end = np.clip(start + rng.uniform(0.05, 1.5) * step / np.linalg.norm(step), robot.lower, robot.upper)
        verdict = int(verdicts.of_edges(start[None], end[None])[0])
        fine = verdict == FREE and rng.random() < FINE_SHARE
        free = judge.is_edge_free(start, end, FINE_SPACING if fine else SPACING)
        if free and verdict == COLLIDING:
            # The collision that the kernels have found may hide between the states.
            free = judge.is_edge_free(start, end, FINEST_SPACING)
        row["fine"] += fine
        row["free" if free else "colliding"] += 1
        row["undecided"] += verdict == UNDECIDED
        row["certified"] += verdict == FREE and free
        row["decided_colliding"] += verdict == COLLIDING and not free
        row["false_free"] += verdict == FREE and not free
        row["false_hits"] += verdict == COLLIDING and free
    return {**parameters, **row}


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """Counts of wrong verdicts, and shares of decided edges."""
    section.text(
        "Straight edges from free configurations, 0.05 to 1.5 rad (or m) long. The judge looks at states so dense that "
        f"no point of the robot moves further than {1e3 * SPACING:g} mm between two, for {100 * FINE_SHARE:g} % of the "
        f"certified edges {1e3 * FINE_SPACING:g} mm. Free is what it finds no collision on."
    )
    table = []
    for name, keys in (("family", FAMILIES), ("robot", tuple(ROBOTS))):
        for key in keys:
            own = [row for row in rows if row[name] == key]
            free, hit = int(column(own, "free").sum()) if own else 0, int(column(own, "colliding").sum()) if own else 0
            if free + hit:
                table.append(
                    [
                        key,
                        free + hit,
                        int(column(own, "false_free").sum()),
                        int(column(own, "false_hits").sum()),
                        share(int(column(own, "certified").sum()), free).scaled(100.0) if free else "",
                        share(int(column(own, "decided_colliding").sum()), hit).scaled(100.0) if hit else "",
                    ]
                )
    section.table(
        ["edges of", "edges", "false free", "false hits", "free certified [%]", "colliding decided [%]"], table
    )
    total = int(column(rows, "free").sum() + column(rows, "colliding").sum())
    for name, text in (
        ("false_free", "certified that the judge finds in collision"),
        ("false_hits", "called colliding that the judge finds free"),
    ):
        wrong = int(column(rows, name).sum())
        remark = f"of {total:,} (95 %: below {upper_bound_of_none(total):.1g})" if wrong == 0 else f"of {total:,}"
        section.require(RequiredNumber(f"edges {text}", wrong, "exactly", 0, remark=remark))
    certified = share(int(column(rows, "certified").sum()), int(column(rows, "free").sum())).scaled(100.0)
    section.require(RequiredNumber("free edges certified by the kernels alone", certified, "reported", unit="%"))
