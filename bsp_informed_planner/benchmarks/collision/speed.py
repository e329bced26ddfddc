"""Times of verdicts, beside those of coal in a loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.collision.subjects import ROBOTS, configurations_of, robot_of, shelf_for
from bsp_informed_planner.benchmarks.collision.timing_kernels import judge_edges, judge_states
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, median
from bsp_informed_planner.benchmarks.stopwatch import time_calls
from bsp_informed_planner.collision.bounds import bounds_of
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.verdict_calls_kernels import COLLIDING, FREE, UNDECIDED
from bsp_informed_planner.collision.verdicts import Verdicts
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

STATES_OF_AN_EDGE = 32
SPEED_UP, SCENE_LIMIT = 30.0, 1.0
STATES, EDGES, EDGES_OF_COAL = 600, 200, 8


def speed_part(quick: bool) -> Part:
    """Times in shelves."""
    cases: list[Parameters] = [{"robot": robot} for robot in ROBOTS for _ in range(2 if quick else 6)]
    return Part("speed", "Time of a verdict", cases, measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Times in one shelf. Edges are 1 rad long and begin in free configurations."""
    name = str(parameters["robot"])
    robot, scene = robot_of(name), shelf_for(name, rng).scene
    bounds, judge = bounds_of(robot), ExactChecker(robot, scene)
    verdicts = Verdicts(bounds.checks(scene))
    judgement = verdicts.judgement
    states = configurations_of(robot, STATES, rng)
    found: list[tuple[FloatArray, FloatArray]] = []
    while len(found) < EDGES:
        start = configurations_of(robot, 1, rng)[0]
        step = rng.normal(size=robot.dof)
        end = start + step / np.linalg.norm(step)
        if judge.is_free(start) and (end >= robot.lower).all() and (end <= robot.upper).all():
            found.append((start, end))
    kinds = verdicts.of_edges(np.array([edge[0] for edge in found]), np.array([edge[1] for edge in found])).tolist()

    def seconds_of_edges(kind: int) -> float:
        own = [edge for edge, verdict in zip(found, kinds, strict=True) if verdict == kind]
        if not own:
            return float("nan")
        starts, ends = np.array([edge[0] for edge in own]), np.array([edge[1] for edge in own])
        return time_calls(lambda _: judge_edges(starts, ends, judgement), lambda: None, repeats=30).fastest / len(own)

    certified = [edge for edge, verdict in zip(found, kinds, strict=True) if verdict == FREE][:EDGES_OF_COAL]
    dense = np.concatenate(
        [start + np.linspace(0.0, 1.0, STATES_OF_AN_EDGE)[:, None] * (end - start) for start, end in certified]
    )

    def by_coal(rows: FloatArray) -> float:
        return time_calls(lambda _: [judge.is_free(row) for row in rows], lambda: None, repeats=5).fastest

    single = time_calls(lambda _: judge_states(states, judgement), lambda: None, repeats=30).fastest / STATES
    batch = time_calls(lambda _: verdicts.of_states(states), lambda: None, repeats=30).fastest / STATES
    pack = time_calls(bounds.checks, lambda: Scene(scene.obstacles, scene.bounds, scene.frame), repeats=20).fastest
    edge, coal_edge = seconds_of_edges(FREE), by_coal(dense) / len(certified)
    return {
        "robot": name,
        "obstacles": len(scene.obstacles),
        "state": 1e6 * single,
        "state_in_batch": 1e6 * batch,
        "coal_state": 1e6 * by_coal(states) / STATES,
        "edge": 1e6 * edge,
        "colliding_edge": 1e6 * seconds_of_edges(COLLIDING),
        "undecided_edge": 1e6 * seconds_of_edges(UNDECIDED),
        "coal_edge": 1e6 * coal_edge,
        "ratio": coal_edge / edge,
        "pack": 1e3 * pack,
    }


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table of times, and the required ratio."""
    section.text(
        "In random shelves, one core, fastest of repeated calls, from compiled code (coal: Python). Edges are 1 rad "
        f"long. Coal checks {STATES_OF_AN_EDGE} states of an edge, one after the other, each until the first hit; the "
        "kernels prove the whole edge free. Packing: from the scene object to the arrays of the kernels."
    )
    names = {
        "state": "configuration, alone",
        "state_in_batch": "configuration, in a batch",
        "coal_state": "configuration, coal",
        "edge": "edge certified",
        "colliding_edge": "edge found colliding",
        "undecided_edge": "edge left undecided",
        "coal_edge": f"edge of {STATES_OF_AN_EDGE} states, coal",
    }
    table = []
    for key, text in names.items():
        cells: list[object] = [text]
        for robot in ROBOTS:
            values = column([row for row in rows if row["robot"] == robot], key)
            values = values[np.isfinite(values)]
            cells.append(median(values, rng) if len(values) else "")
        table.append(cells)
    section.table(["time [us]", *ROBOTS], table)
    for robot in ROBOTS:
        own = [row for row in rows if row["robot"] == robot]
        if own:
            name = f"certified edge, times faster than {STATES_OF_AN_EDGE} states by coal, {robot}"
            section.require(RequiredNumber(name, median(column(own, "ratio"), rng), "at least", SPEED_UP))
    pack = median(column(rows, "pack"), rng)
    section.require(RequiredNumber("shelf ready for the kernels", pack, "at most", SCENE_LIMIT, "ms"))
