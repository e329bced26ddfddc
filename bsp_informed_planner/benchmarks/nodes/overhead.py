"""What the `plan` service takes beyond the library."""

from __future__ import annotations

import copy
import itertools
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.nodes.empty_service import empty_service
from bsp_informed_planner.benchmarks.nodes.running_nodes import (
    node_parameters,
    nodes_as_processes,
    nodes_in_this_process,
)
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, median
from bsp_informed_planner.errors import PlanningFailedError
from bsp_informed_planner.nodes.client import request_for
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.planning import Planner, PlanningProblem, PoseGoal
from bsp_informed_planner.planning.problem import PlanOptions
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.scene.pose import FloatArray

LIMITS = {"one process": 2.0, "processes": 5.0}
ALLOWED_SECONDS = 5.0
#: Pause after an answer [s].
SETTLING_SECONDS = 0.03


def overhead_part(quick: bool) -> Part:
    """Paired times of library and service, on the same problems with the same seeds."""
    problems, repeats = (4, 6) if quick else (30, 20)
    cases: list[Parameters] = [{"where": where, "problems": problems, "repeats": repeats} for where in LIMITS]
    return Part("overhead", "The `plan` service against the library", cases, measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """For each problem that the library solves the median times of both, alternating, and that of the differences."""
    robot = ur5()
    library: list[float] = []
    service: list[float] = []
    empty: list[float] = []
    points: list[int] = []
    differences: list[float] = []
    different = 0
    with ExitStack() as stack:
        # Guidance found in the planner node, as the library does: so both do the same work.
        nodes = node_parameters("ur5", use_inference=False)
        if parameters["where"] == "one process":
            make = stack.enter_context(nodes_in_this_process(nodes))
        else:
            make, _ = stack.enter_context(nodes_as_processes(nodes))
        client = make()
        round_trip = stack.enter_context(empty_service(client.node, parameters["where"] != "one process"))
        for seed in itertools.count(1):
            if len(library) == int(parameters["problems"]):
                break
            problem = random_shelf_problem(robot, rng)
            planner = Planner(robot, problem.scene)
            goals = [PoseGoal(pose) for pose in problem.goal_poses]
            options = PlanOptions(allowed_seconds=ALLOWED_SECONDS, first_solution=True, seed=seed)
            try:
                planner.plan(PlanningProblem(problem.start, goals), options)
            except PlanningFailedError:
                # Whether a path exists is not known of random problems.
                continue
            revision = client.publish_scene(problem.scene)
            request = request_for(problem, robot, ALLOWED_SECONDS, seed, client.epoch, revision)
            request.first_solution = True
            times_taken = []
            for repeat in range(int(parameters["repeats"]) + 2):
                begin = time.perf_counter()
                result = planner.plan(PlanningProblem(problem.start, goals), options)
                middle = time.perf_counter()
                response = client.plan(request, 10.0)
                end = time.perf_counter()
                if response.error_code != ErrorCode.SUCCESS:
                    raise RuntimeError(response.message)
                # What others are told of the plan, after its answer, is neither's.
                time.sleep(SETTLING_SECONDS)
                # The first ones load what is needed once for a scene.
                bare = round_trip(copy.copy(request), len(response.trajectory.points))
                if repeat >= 2:
                    times_taken.append((middle - begin, end - middle, bare))
            different += not np.array_equal(np.array(response.waypoints), result.path.ravel())
            times: FloatArray = np.array(times_taken)
            library.append(float(np.median(times[:, 0])))
            service.append(float(np.median(times[:, 1])))
            points.append(len(response.trajectory.points))
            empty.append(float(np.median(times[:, 2])))
            differences.append(float(np.median(times[:, 1] - times[:, 0])))
    return {
        "where": parameters["where"],
        "library": library,
        "service": service,
        "empty": empty,
        "points": points,
        "difference": differences,
        "different_paths": different,
    }


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table and the two limits."""
    section.text(
        "Random shelf problems of a UR5 that the library solves, first verified path. Service and library take turns "
        "on the same problem with the same seed, both finding keypoints themselves, so they do the same work; the "
        "difference is what messages, threads and the interpreter cost. In one process the nodes share it with their "
        "client, too. The empty service is one of plain rclpy, whose answers have as many points, are made beforehand, "
        "and whose executor has nothing else to wait for."
    )
    table: list[list[Any]] = []
    for row in rows:
        library, service, difference, empty = (
            median(1e3 * column([{"value": value} for value in row[name]], "value"), rng)
            for name in ("library", "service", "difference", "empty")
        )
        points = f"{np.median(row['points']):.0f}"
        table.append(
            [row["where"], len(row["library"]), points, library, service, difference, empty, row["different_paths"]]
        )
        section.require(
            RequiredNumber(
                f"plan service over the library, {row['where']}", difference, "at most", LIMITS[str(row["where"])], "ms"
            )
        )
        section.require(RequiredNumber(f"empty service round trip, {row['where']}", empty, "reported", unit="ms"))
    section.table(
        [
            "nodes",
            "problems",
            "points",
            "library [ms]",
            "service [ms]",
            "difference of pairs [ms]",
            "empty service [ms]",
            "other paths",
        ],
        table,
    )
