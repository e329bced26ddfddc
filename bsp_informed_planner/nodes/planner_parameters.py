"""Parameters of the planner node."""

from __future__ import annotations

from dataclasses import dataclass

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.nodes.parameters import parameter
from bsp_informed_planner.nodes.robot_source import RobotParameters
from bsp_informed_planner.planning.problem import PLANNER_IDS, PlanOptions
from bsp_informed_planner.sampling.guide import EXACT, SAMPLER_IDS


@dataclass(frozen=True)
class PlannerParameters(RobotParameters):
    """Parameters of the planner node."""

    planner_id: str = parameter("anytime", "Planner of requests that name none.", choices=PLANNER_IDS, live=True)
    sampler_id: str = parameter(EXACT, "Sampler of requests that name none.", choices=SAMPLER_IDS, live=True)
    allowed_planning_time: float = parameter(
        5.0, "Time of requests that give none [s].", minimum=0.01, maximum=600.0, live=True
    )
    max_seconds: float = parameter(
        60.0, "Longest time that a request may ask for [s].", minimum=0.01, maximum=3600.0, live=True
    )
    uniform_fraction: float = parameter(0.5, "Share of uniform samples, lambda.", minimum=0.0, maximum=1.0, live=True)
    verification_resolution: float = parameter(
        0.0,
        "Where a path cannot be proved free, no point of the robot moves further between two states that are checked "
        "[m]; 0: the robot's default.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    )
    padding: float = parameter(0.0, "Distance kept from obstacles [m].", minimum=0.0, maximum=1.0, live=True)
    blend_deviation: float = parameter(
        -1.0,
        "How far the timed path may leave the corners of the path [rad or m]; negative: the robot's default.",
        minimum=-1.0,
        maximum=1.0,
        live=True,
    )
    trajectory_time_step: float = parameter(
        0.02, "Between two points of a trajectory [s].", minimum=1e-3, maximum=1.0, live=True
    )
    allow_empty_scene: bool = parameter(False, "Plan in a scene without obstacles, instead of refusing to.", live=True)
    use_inference: bool = parameter(True, "Ask the inference node for guidance; false: find keypoints here.", live=True)
    inference_timeout: float = parameter(
        1.0, "Longest wait for the inference node [s].", minimum=0.01, maximum=60.0, live=True
    )
    workers: int = parameter(2, "How many plans are worked on at once.", minimum=1, maximum=64)
    queue_size: int = parameter(16, "How many more may wait; one beyond is refused at once.", minimum=0, maximum=1000)
    joint_state_max_age: float = parameter(
        1.0, "Oldest joint_states that fill up a start state [s]; 0: any.", minimum=0.0, maximum=3600.0, live=True
    )

    publish_markers: bool = parameter(True, "Publish plan_markers for RViz and Foxglove.", live=True)
    publish_trees: bool = parameter(
        False, "Show the trees of the search in plan_markers too, for a look at hard problems.", live=True
    )
    save_problem_on_failure: str = parameter(
        "", "Folder for a file of each plan that fails, which `bsp-planner plan FILE` repeats; empty: none is written."
    )

    def validate(self) -> None:
        if self.allowed_planning_time > self.max_seconds:
            raise InvalidOptionError(
                "parameter allowed_planning_time",
                self.allowed_planning_time,
                f"at most max_seconds, {self.max_seconds:g}",
            )

    def plan_options(self) -> PlanOptions:
        """Options of a request that leaves everything open."""
        return PlanOptions(
            planner_id=self.planner_id,
            sampler_id=self.sampler_id,
            allowed_seconds=self.allowed_planning_time,
            uniform_fraction=self.uniform_fraction,
            verification_resolution=self.verification_resolution or None,
            padding=self.padding,
            blend_deviation=None if self.blend_deviation < 0.0 else self.blend_deviation,
            time_step=self.trajectory_time_step,
            keep_trees=self.publish_trees and self.publish_markers,
        )
