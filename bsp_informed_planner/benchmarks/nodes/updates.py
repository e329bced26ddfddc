"""From a change of the scene to the first plan on it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
from bsp_informed_planner_msgs.msg import PlanRequest
from sensor_msgs.msg import JointState

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.decomposition.scenes import shelf_of_boxes
from bsp_informed_planner.benchmarks.nodes.running_nodes import (
    WHERE,
    node_parameters,
    nodes_as_processes,
    nodes_in_this_process,
)
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, median, quantile
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.scene_conversions import scene_to_msg
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

LIMIT = 20.0
#: Pause before a scene [s].
SETTLING_SECONDS = 0.1


def updates_part(quick: bool) -> Part:
    """Times from publishing a scene of 20 boxes to the answer of a plan that asks for it."""
    cases: list[Parameters] = [{"where": where, "updates": 15 if quick else 200} for where in WHERE]
    return Part("updates", "From a scene to the first plan on it", cases, measure, summarise, Mode.ALONE)


def _short_motion(robot: Robot, scene: Scene, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Two free states with a straight way between them: the plan itself takes as little as a plan can."""
    checker = ExactChecker(robot, scene, padding=0.05)
    for _ in range(10_000):
        start = rng.uniform(0.5 * robot.lower, 0.5 * robot.upper)
        goal = start + rng.normal(0.0, 0.05, robot.dof)
        if checker.is_edge_free(start, goal):
            return start, goal
    raise RuntimeError("the robot has no room in this scene")


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Publish, and at once ask for a plan on the revision that will come of it."""
    robot = ur5()
    seconds = []
    with ExitStack() as stack:
        if parameters["where"] == "one process":
            make = stack.enter_context(nodes_in_this_process(node_parameters("ur5")))
        else:
            make, _ = stack.enter_context(nodes_as_processes(node_parameters("ur5")))
        client = make()
        scene = replace(shelf_of_boxes(rng).scene, frame=robot.root_frame)
        revision = client.publish_scene(scene)
        for index in range(int(parameters["updates"]) + 3):
            scene = replace(shelf_of_boxes(rng).scene, frame=robot.root_frame)
            start, goal = _short_motion(robot, scene, rng)
            message = scene_to_msg(scene)
            revision += 1
            # What the nodes prepare of the scene before is over.
            time.sleep(SETTLING_SECONDS)
            request = PlanRequest(
                start=JointState(position=start.tolist()),
                goal_states=[JointState(position=goal.tolist())],
                allowed_planning_time=5.0,
                first_solution=True,
                seed=1,
                scene_epoch=client.epoch,
                scene_revision=revision,
            )
            begin = time.perf_counter()
            client.publish_message(message)
            response = client.plan(request, 10.0)
            elapsed = time.perf_counter() - begin
            if response.error_code != ErrorCode.SUCCESS:
                raise RuntimeError(response.message)
            # The first ones load what is needed once.
            if index >= 3:
                seconds.append(elapsed)
    return {"where": parameters["where"], "boxes": len(scene.obstacles), "seconds": seconds}


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table and the limit."""
    section.text(
        f"{SETTLING_SECONDS:g} s after the answer before, a whole scene is published, and a plan asked for at once "
        "that names the revision which will come of it. The time until its answer covers the message, the "
        "decomposition, the copy of the scene in the planner node, and a plan whose start and goal a straight line "
        "connects."
    )
    table = []
    for row in rows:
        values = 1e3 * column([{"value": value} for value in row["seconds"]], "value")
        middle = median(values, rng)
        table.append([row["where"], len(values), row["boxes"], middle, quantile(values, 0.9, rng)])
        section.require(
            RequiredNumber(f"scene of 20 boxes to first plan, {row['where']}", middle, "at most", LIMIT, "ms")
        )
    section.table(["nodes", "updates", "obstacles", "median [ms]", "90 % [ms]"], table)
