"""How soon a plan that is cancelled is over."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack

import numpy as np
from bsp_informed_planner_msgs.action import PlanMotion
from rclpy.action import ActionClient

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.nodes.running_nodes import (
    WHERE,
    node_parameters,
    nodes_as_processes,
    nodes_in_this_process,
)
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, median, quantile
from bsp_informed_planner.nodes.client import SuiteClient, request_for
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem
from bsp_informed_planner.robots.demo_arms import ur5

LIMIT = 50.0
#: Time of the plans, and the latest moment of a cancel [s].
ALLOWED_SECONDS, LATEST = 20.0, 1.0
#: Longest wait for a message [s].
PATIENCE = 30.0


def cancels_part(quick: bool) -> Part:
    """Delays from the cancel to the result of `plan_motion`."""
    problems, repeats = (3, 6) if quick else (10, 10)
    cases: list[Parameters] = [{"where": where, "problems": problems, "repeats": repeats} for where in WHERE]
    return Part("cancels", "Cancels of `plan_motion`", cases, measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Plans that would go on to improve their path, cancelled at random moments."""
    robot = ur5()
    delays: list[float] = []
    moments: list[float] = []
    codes: list[int] = []
    with ExitStack() as stack:
        if parameters["where"] == WHERE[0]:
            make = stack.enter_context(nodes_in_this_process(node_parameters("ur5")))
        else:
            make, _ = stack.enter_context(nodes_as_processes(node_parameters("ur5")))
        client = make()
        action = ActionClient(client.node, PlanMotion, "plan_motion")
        stack.callback(action.destroy)
        _wait(client, action.server_is_ready)
        for seed in range(1, int(parameters["problems"]) + 1):
            problem = random_shelf_problem(robot, rng)
            revision = client.publish_scene(problem.scene)
            request = request_for(problem, robot, ALLOWED_SECONDS, seed, client.epoch, revision)
            for _ in range(int(parameters["repeats"])):
                sent = action.send_goal_async(PlanMotion.Goal(request=request))
                _wait(client, sent.done)
                goal = sent.result()
                result = goal.get_result_async()
                moment = float(rng.uniform(0.0, LATEST))
                client.spin_for(moment)
                begin = time.perf_counter()
                goal.cancel_goal_async()
                _wait(client, result.done)
                delays.append(time.perf_counter() - begin)
                moments.append(moment)
                codes.append(int(result.result().result.response.error_code))
    return {"where": parameters["where"], "seconds": delays, "moments": moments, "codes": codes}


def _wait(client: SuiteClient, condition: Callable[[], bool]) -> None:
    if not client.spin_until(condition, PATIENCE):
        raise RuntimeError(f"nothing was heard for {PATIENCE:.0f} s")


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table, and the limit on the longest."""
    section.text(
        f"Plans of a UR5 at random shelves, which would improve their paths for {ALLOWED_SECONDS:.0f} s, are cancelled "
        f"at random moments of their first {LATEST:g} s. The delay is from the call of the cancel to the result."
    )
    table = []
    for row in rows:
        values = 1e3 * column([{"value": value} for value in row["seconds"]], "value")
        preempted = sum(code == ErrorCode.PREEMPTED for code in row["codes"])
        middle, late = median(values, rng), quantile(values, 0.95, rng)
        table.append([row["where"], len(values), preempted, middle, late, float(values.max())])
        section.require(RequiredNumber(f"cancel of plan_motion, median, {row['where']}", middle, "reported", unit="ms"))
        section.require(
            RequiredNumber(
                f"cancel of plan_motion, longest, {row['where']}", float(values.max()), "at most", LIMIT, "ms"
            )
        )
    section.table(["nodes", "cancels", "answered PREEMPTED", "median [ms]", "95 % [ms]", "longest [ms]"], table)
