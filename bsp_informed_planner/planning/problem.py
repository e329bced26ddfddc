"""Planning problems, options and results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.planning.grown_tree import GrownTree
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import Guidance
from bsp_informed_planner.sampling.guide import EXACT
from bsp_informed_planner.scene.pose import FloatArray, Pose


@dataclass(frozen=True, eq=False)
class JointGoal:
    """A goal configuration, taken to the letter, but for whole turns of continuous joints: those are the same goal.

    Attributes:
        configuration: (n,) [rad or m].
    """

    configuration: FloatArray


@dataclass(frozen=True, eq=False)
class PoseGoal:
    """A goal pose: any configuration, of any branch and winding, that brings a frame of the robot there.

    Attributes:
        pose: in the root frame of the robot [m].
        frame: of the robot; None: its tool frame.
    """

    pose: Pose
    frame: str | None = None


Goal = JointGoal | PoseGoal


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """From a start configuration (n,) to any of several goals."""

    start: FloatArray
    goals: Sequence[Goal]


#: OMPL's planners, in a worker process (extra `baselines`).
OMPL_PLANNER_IDS = (
    "ompl_rrt_connect",
    "ompl_rrt_star",
    "ompl_informed_rrt_star",
    "ompl_bit_star",
    "ompl_aorrtc",
)
PLANNER_IDS = ("anytime", "rrt_connect", "rrt_star", "rrt", *OMPL_PLANNER_IDS)


@dataclass(frozen=True)
class PlanOptions:
    """How to plan.

    Attributes:
        planner_id: "anytime": straight line, bidirectional start seeded with guidance, shortcut, then RRT* until the
            time is over; "rrt_connect": the same without RRT*; "rrt_star", "rrt": these alone, as in the paper.
            "ompl_...": OMPL's planners, which draw their own samples, with the same collision checks, last check and
            timing; they have no `max_samples`.
        sampler_id: "keypoint_tube": exact keypoints and the tube around their chain; "uniform"; "learned": keypoints
            and samples by networks (Algorithm 3); "cvae_shortest_path", "gmm": the paper's baselines, which have no
            keypoints; "path_library": the nearest solved paths. Without a model for the robot, keypoints are exact, and
            the result says why.
        allowed_seconds: time for everything, from validation to timing [s].
        first_solution: stop at the first verified path.
        head_start: uniform search before guidance is asked for, as a number of edges to check; None: as much as takes
            about the time of guidance, in which most problems are solved; 0: none. For "anytime" and "rrt_connect".
        join_keypoints: whether exact keypoints join the guidance of "learned" where it has led to no path soon. For
            "anytime" and "rrt_connect".
        uniform_fraction: share of uniform samples, lambda in the paper, in [0, 1].
        max_samples: most samples to draw; None: no bound but time.
        seed: of the random number generators; None: one is drawn. A plan by one thread that no time limit ends is the
            same for the same seed, on any machine: "rrt_connect", or with `first_solution` or `max_samples`.
        max_step: longest edge of a tree, eta; None: 5 % of the diagonal of the joint limits, or OMPL's own choice for
            "ompl_rrt_star" and "ompl_informed_rrt_star" [rad or m]. "ompl_bit_star" has none.
        verification_resolution: where the path that is returned cannot be proved free, since bodies are almost in
            touch, it is checked at states between which no point of the robot moves further than this [m]; None:
            0.3 mm, or 0.003 % of the diagonal of its space for a robot that only slides.
        padding: distance to keep from obstacles [m].
        velocity_scaling, acceleration_scaling: fractions of the robot's limits to use, in [0.01, 1].
        blend_deviation: how far the timed path may leave the corners of the planned one [rad or m]; where that is not
            free, it gets closer, and stops in the corner at last. None: 0.05 rad, or 0.5 % of the diagonal of its space
            for a robot that only slides.
        time_step: between two points of the trajectory [s].
        max_goals: most goal configurations (branches and windings) made from each pose.
        cost_weights: (n,) of the joints in lengths, and so in the cost and in `max_step`; None: 1 each.
        threads: 2: two threads search for one plan, each with samples of its own; the best path wins. Which one that is
            may then depend on timing. It can pay where processors are idle that share little with each other.
        keep_trees: keep the trees of the search in the result, to look at.
        ompl_simplify: whether OMPL's simplification shortens what "ompl_rrt_connect" finds.
    """

    planner_id: str = "anytime"
    sampler_id: str = EXACT
    allowed_seconds: float = 5.0
    first_solution: bool = False
    head_start: int | None = None
    join_keypoints: bool = True
    uniform_fraction: float = 0.5
    max_samples: int | None = None
    seed: int | None = None
    max_step: float | None = None
    verification_resolution: float | None = None
    padding: float = 0.0
    velocity_scaling: float = 1.0
    acceleration_scaling: float = 1.0
    blend_deviation: float | None = None
    time_step: float = 0.02
    max_goals: int = 16
    cost_weights: tuple[float, ...] | None = None
    threads: int = 1
    keep_trees: bool = False
    ompl_simplify: bool = True

    def __post_init__(self) -> None:
        def require(name: str, holds: bool, expected: str) -> None:
            if not holds:
                raise InvalidOptionError(name, getattr(self, name), expected)

        def positive(name: str, most: float = np.inf) -> None:
            value = getattr(self, name)
            require(name, bool(np.isfinite(value)) and 0.0 < value <= most, f"a number in (0, {most:g}]")

        positive("allowed_seconds", 3600.0)
        for name in ("velocity_scaling", "acceleration_scaling"):
            value = getattr(self, name)
            require(name, bool(np.isfinite(value)) and 0.01 <= value <= 1.0, "a number in [0.01, 1]")
        positive("time_step", 1.0)
        require("uniform_fraction", 0.0 <= self.uniform_fraction <= 1.0, "a number in [0, 1]")
        require("padding", bool(np.isfinite(self.padding)) and 0.0 <= self.padding <= 1.0, "a number in [0, 1] m")
        deviation = 0.0 if self.blend_deviation is None else self.blend_deviation
        require("blend_deviation", bool(np.isfinite(deviation)) and deviation >= 0.0, "0 or more")
        require("max_samples", self.max_samples is None or self.max_samples >= 1, "at least 1, or none for no bound")
        require("threads", self.threads in (1, 2), "1 or 2")
        weights = () if self.cost_weights is None else self.cost_weights
        require("cost_weights", all(np.isfinite(w) and w > 0.0 for w in weights), "positive numbers, one a joint")
        require("head_start", self.head_start is None or self.head_start >= 0, "0 or more, or none for the default")
        require("max_goals", self.max_goals >= 1, "at least 1")
        require("seed", self.seed is None or self.seed >= 0, "0 or more")
        for name in ("max_step", "verification_resolution"):
            if getattr(self, name) is not None:
                positive(name)


def default_verification_resolution(robot: Robot) -> float:
    """How far a point of the robot may move between states of a path that cannot be proved free, by default [m]."""
    return 3e-4 if robot.revolute.any() else 3e-5 * float(np.linalg.norm(robot.upper - robot.lower))


def default_blend_deviation(robot: Robot) -> float:
    """How far a timed path may leave the corners of the planned one, by default [rad or m]."""
    return 0.05 if robot.revolute.any() else 0.005 * float(np.linalg.norm(robot.upper - robot.lower))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A timed path, from rest to rest.

    Attributes:
        times: (k,) from 0 [s].
        positions, velocities, accelerations: (k, n) [rad or m, per s, per s^2].
    """

    times: FloatArray
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray

    @property
    def duration(self) -> float:
        """[s]"""
        return float(self.times[-1])


@dataclass(frozen=True)
class CostHistory:
    """How the cost fell: `costs[i]` was reached after `seconds[i]`."""

    seconds: tuple[float, ...] = ()
    costs: tuple[float, ...] = ()


@dataclass(frozen=True)
class PlanStatistics:
    """Where the time of a plan went [s] and what was done.

    Attributes:
        exact_checks: configurations given to Pinocchio and coal.
    """

    seed: int
    total_seconds: float = 0.0
    decomposition_seconds: float = 0.0
    inference_seconds: float = 0.0
    first_solution_seconds: float = 0.0
    verification_seconds: float = 0.0
    samples: int = 0
    valid_samples: int = 0
    nodes: int = 0
    edges_checked: int = 0
    exact_checks: int = 0
    cells: int = 0
    portals: int = 0
    candidates: int = 0


@dataclass(frozen=True, eq=False, repr=False)
class PlanResult:
    """A verified path.

    Attributes:
        path: (m, n) waypoints from the start to one of the goals, straight edges between them.
        trajectory: the same, timed; it was verified on its own.
        cost: joint-space length of `path`.
        certified: whether the straight edges between the points of `trajectory` are proved free, all states between the
            checked ones included; else they are checked at `verification_resolution`.
        guidance: what guided the search.
        verification_resolution: see PlanOptions [m].
        scene_revision: of the scene it was verified against.
        trees: of the search, if they were to be kept; OMPL's planners tell of none.
    """

    path: FloatArray
    trajectory: Trajectory
    cost: float
    certified: bool
    cost_history: CostHistory
    planner_id: str
    guidance: Guidance
    verification_resolution: float
    scene_revision: int
    statistics: PlanStatistics = field(default_factory=lambda: PlanStatistics(seed=0))
    trees: tuple[GrownTree, ...] = ()

    def __repr__(self) -> str:
        proof = "certified" if self.certified else "checked"
        return (
            f"PlanResult({proof}, cost {self.cost:.3f}, {len(self.path)} waypoints, {self.trajectory.duration:.2f} s, "
            f"sampler {self.guidance.sampler_id}, first path after {self.statistics.first_solution_seconds:.3f} s)"
        )
