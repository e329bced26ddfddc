from __future__ import annotations

import contextlib
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from fcl_checker import FclChecker

from bsp_informed_planner.collision.bounds import FINEST
from bsp_informed_planner.collision.certifier import Verdict
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.errors import (
    InvalidOptionError,
    InvalidStateError,
    NoGoalError,
    PlanningCancelledError,
    PlanningTimeoutError,
    SamplesExhaustedError,
    StateInCollisionError,
    StateOutsideLimitsError,
    UnknownPlannerError,
    UnknownSamplerError,
    UnreachablePoseError,
)
from bsp_informed_planner.planning import JointGoal, Planner, PlanningProblem, PlanOptions, PlanResult, PoseGoal
from bsp_informed_planner.planning.judges import Judges
from bsp_informed_planner.planning.path import interpolate, path_length
from bsp_informed_planner.planning.problem import OMPL_PLANNER_IDS, PLANNER_IDS
from bsp_informed_planner.planning.sampling_box import NEAR, near_bounds, sampling_bounds
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem
from bsp_informed_planner.planning.verification import CertifyingChecker
from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.sampling.guidance import ConfigurationChain, Guidance
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Sphere

OWN_PLANNER_IDS = [planner_id for planner_id in PLANNER_IDS if planner_id not in OMPL_PLANNER_IDS]
FIRST = PlanOptions(allowed_seconds=10.0, first_solution=True, seed=1)


@pytest.fixture(scope="module")
def arm() -> ArmRobot:
    return ur5()


def maze_problem(seed: int) -> tuple[Planner, PlanningProblem]:
    problem = random_maze(np.random.default_rng(seed)).problem
    return Planner(PointRobot(), problem.scene), PlanningProblem(problem.start, [JointGoal(problem.goals[0])])


def shelf_problem(arm: ArmRobot, seed: int) -> tuple[Planner, PlanningProblem]:
    problem = random_shelf_problem(arm, np.random.default_rng(seed))
    return Planner(arm, problem.scene), PlanningProblem(problem.start, [PoseGoal(problem.goal_poses[0])])


def assert_free(planner: Planner, result: PlanResult) -> None:
    """Path and trajectory are free at the resolution that the result names, for a checker of its own."""
    checker = ExactChecker(planner.robot, planner.scene)
    for states in (result.path, result.trajectory.positions):
        for start, end in zip(states[:-1], states[1:], strict=True):
            assert checker.is_edge_free(start, end, 2.0 * result.verification_resolution)


def assert_verified(planner: Planner, result: PlanResult) -> None:
    """What `assert_free` says, and the rest."""
    assert_free(planner, result)
    checker = ExactChecker(planner.robot, planner.scene)
    proof = CertifyingChecker(checker, result.verification_resolution)
    # The exact judge alone proves no less than is claimed.
    verdict = proof.verdict(result.trajectory.positions)
    assert verdict is not Verdict.COLLIDING
    assert verdict is Verdict.CERTIFIED or not result.certified
    assert result.cost == pytest.approx(path_length(result.path))
    assert np.allclose(result.trajectory.positions[[0, -1]], result.path[[0, -1]], atol=1e-6)
    assert (np.abs(result.trajectory.velocities) <= planner.robot.velocity_limits * (1.0 + 1e-6)).all()
    assert (np.abs(result.trajectory.accelerations) <= planner.robot.acceleration_limits * (1.0 + 1e-6)).all()
    assert (result.path >= planner.robot.lower).all()
    assert (result.path <= planner.robot.upper).all()


@pytest.mark.parametrize("seed", range(8))
def test_mazes_are_solved(seed: int) -> None:
    planner, problem = maze_problem(seed)
    result = planner.plan(problem, FIRST)
    assert_verified(planner, result)
    assert np.array_equal(result.path[0], problem.start)


@pytest.mark.parametrize("planner_id", OWN_PLANNER_IDS)
@pytest.mark.parametrize("sampler_id", ["keypoint_tube", "uniform"])
def test_every_planner_and_sampler(planner_id: str, sampler_id: str) -> None:
    planner, problem = maze_problem(3)
    options = PlanOptions(
        planner_id=planner_id, sampler_id=sampler_id, allowed_seconds=10.0, first_solution=True, seed=5, max_step=0.05
    )
    result = planner.plan(problem, options)
    assert_verified(planner, result)
    assert result.planner_id == planner_id
    if result.guidance.sampler_id != sampler_id:
        assert "before keypoints were needed" in result.guidance.remark
        assert not result.guidance.fallback_reason


@pytest.mark.parametrize("seed", [2, 5, 6])
def test_an_arm_reaches_into_a_shelf(arm: ArmRobot, seed: int) -> None:
    planner, problem = shelf_problem(arm, seed)
    result = planner.plan(problem, FIRST)
    assert_verified(planner, result)
    goal = problem.goals[0]
    assert isinstance(goal, PoseGoal)
    reached = arm.forward_kinematics(result.path[-1])
    assert np.allclose(reached.matrix, goal.pose.matrix, atol=1e-5)
    chain = planner.guide(planner.prepare(problem, FIRST)).chains[0]
    assert np.array_equal(chain.configurations[0], result.path[0])
    # Each configuration of the chain puts the tool on its keypoint.
    for configuration, keypoint in zip(chain.configurations, chain.keypoints, strict=True):
        assert np.allclose(arm.forward_kinematics(configuration).position, keypoint, atol=1e-5)


def test_python_fcl_agrees_with_a_path(arm: ArmRobot) -> None:
    planner, problem = shelf_problem(arm, 5)
    result = planner.plan(problem, FIRST)
    other = FclChecker(arm, planner.scene)
    states = interpolate(result.path, 0.05)
    assert all(other.is_free(state) for state in states)


def test_time_improves_paths(arm: ArmRobot) -> None:
    planner, problem = shelf_problem(arm, 6)
    first = planner.plan(problem, FIRST)
    better = planner.plan(problem, PlanOptions(allowed_seconds=2.0, seed=1))
    assert_verified(planner, better)
    costs = better.cost_history.costs
    assert list(costs) == sorted(costs, reverse=True)
    assert costs[-1] == pytest.approx(better.cost)
    assert better.cost < first.cost
    assert better.statistics.total_seconds <= 3.0


def test_same_seed_same_path(arm: ArmRobot) -> None:
    planner, problem = shelf_problem(arm, 2)
    options = PlanOptions(planner_id="rrt_connect", allowed_seconds=20.0, seed=11)
    first, second = (planner.plan(problem, options) for _ in range(2))
    assert np.array_equal(first.path, second.path)


def test_threads_share_a_planner() -> None:
    planner, problem = maze_problem(3)
    alone = planner.plan(problem, FIRST)
    results: list[PlanResult] = []
    threads = [threading.Thread(target=lambda: results.append(planner.plan(problem, FIRST))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 4
    assert all(np.array_equal(result.path, alone.path) for result in results)


@pytest.mark.parametrize("sampler_id", ["keypoint_tube", "uniform"])
def test_two_threads_search_for_one_plan(arm: ArmRobot, sampler_id: str) -> None:
    planner, problem = shelf_problem(arm, 6)
    result = planner.plan(problem, PlanOptions(allowed_seconds=2.0, seed=1, threads=2, sampler_id=sampler_id))
    assert_verified(planner, result)
    assert list(result.cost_history.costs) == sorted(result.cost_history.costs, reverse=True)
    assert list(result.cost_history.seconds) == sorted(result.cost_history.seconds)


def test_two_threads_end_when_one_is_cancelled() -> None:
    planner, problem = walled_in()
    begin = time.monotonic()
    options = PlanOptions(allowed_seconds=30.0, threads=2)
    with pytest.raises(PlanningCancelledError):
        planner.plan(problem, options, cancelled=lambda: time.monotonic() - begin > 0.2)
    assert time.monotonic() - begin < 2.0


def test_a_plan_of_so_many_samples_is_repeatable() -> None:
    planner, problem = maze_problem(3)
    options = PlanOptions(allowed_seconds=60.0, seed=3, max_samples=3000)
    first, second = (planner.plan(problem, options) for _ in range(2))
    assert np.array_equal(first.path, second.path)
    assert first.statistics.samples <= 3000


def test_judges_forget_between_plans(arm: ArmRobot) -> None:
    """What a judge remembers lets it look further within a plan's limits: the next plan would be another one."""
    planner, problem = shelf_problem(arm, 2)
    judges = Judges(arm, planner.scene, FINEST)
    judge = judges.lend()
    edge = problem.start, 0.9 * np.asarray(problem.start)
    assert judge.certify(*edge, lambda: True) is judge.certify(*edge, lambda: True)
    judges.give_back(judge)
    again = judges.lend()
    assert again is judge
    # The work is done anew, and here not allowed.
    assert again.certify(*edge, lambda: False) is Verdict.COLLIDING


def test_a_refused_goal_keeps_no_judge(arm: ArmRobot) -> None:
    planner, problem = shelf_problem(arm, 2)
    judge = planner._judges.lend()
    planner._judges.give_back(judge)
    far = Pose.from_xyz_rpy([9.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    with pytest.raises(UnreachablePoseError):
        planner.plan(PlanningProblem(problem.start, [PoseGoal(far)]))
    assert planner._judges.lend() is judge


@pytest.mark.parametrize("solved_first", [False, True])
def test_a_failure_of_guidance_ends_both_threads(arm: ArmRobot, solved_first: bool) -> None:
    planner, problem = shelf_problem(arm, 6) if solved_first else walled_in()
    options = PlanOptions(allowed_seconds=30.0, seed=1, threads=2, head_start=100_000 if solved_first else 0)
    plan = planner.prepare(problem, options)

    def failing() -> Guidance:
        raise ZeroDivisionError

    begin = time.monotonic()
    with pytest.raises(ZeroDivisionError):
        planner.solve(plan, failing)
    assert time.monotonic() - begin < 10.0


def test_dear_joints_move_less() -> None:
    planner, problem = maze_problem(3)
    result = planner.plan(problem, PlanOptions(allowed_seconds=1.0, seed=1, cost_weights=(1.0, 5.0)))
    assert_free(planner, result)
    assert result.cost == pytest.approx(path_length(result.path, np.array([1.0, 5.0])))
    plain = planner.plan(problem, PlanOptions(allowed_seconds=1.0, seed=1))
    assert result.cost <= path_length(plain.path, np.array([1.0, 5.0])) * 1.01
    with pytest.raises(InvalidOptionError, match="2 numbers, one a joint"):
        planner.plan(problem, PlanOptions(cost_weights=(1.0,)))


def test_sample_budgets_beyond_memory_are_refused() -> None:
    planner, problem = maze_problem(3)
    with pytest.raises(InvalidOptionError, match="max_samples = 1000000000: expected at most"):
        planner.plan(problem, PlanOptions(max_samples=10**9))


def walled_in() -> tuple[Planner, PlanningProblem]:
    """A goal that no path reaches."""
    bounds = WorkspaceBounds(np.array([0.0, 0.0, -0.05]), np.array([1.0, 1.0, 0.05]))
    wall = Obstacle.of("wall", Box(np.array([0.1, 1.5, 0.2])), Pose.from_xyz_rpy([0.5, 0.5, 0.0]))
    planner = Planner(PointRobot(), Scene.of([wall], bounds))
    return planner, PlanningProblem(np.array([0.1, 0.5]), [JointGoal(np.array([0.9, 0.5]))])


@pytest.mark.parametrize("planner_id", OWN_PLANNER_IDS)
def test_nothing_found_within_the_time(planner_id: str) -> None:
    planner, problem = walled_in()
    begin = time.monotonic()
    with pytest.raises(PlanningTimeoutError, match=r"0\.50 s"):
        planner.plan(problem, PlanOptions(planner_id=planner_id, allowed_seconds=0.5))
    # Within a tenth; the rest is for a machine that has other work.
    assert time.monotonic() - begin <= 0.55 + 1.5


def test_samples_run_out() -> None:
    planner, problem = walled_in()
    with pytest.raises(SamplesExhaustedError, match="200"):
        planner.plan(problem, PlanOptions(max_samples=200, allowed_seconds=30.0))


def test_cancelled_plans_end_at_once() -> None:
    planner, problem = walled_in()
    begin = time.monotonic()
    with pytest.raises(PlanningCancelledError):
        planner.plan(problem, PlanOptions(allowed_seconds=30.0), cancelled=lambda: time.monotonic() - begin > 0.2)
    assert time.monotonic() - begin < 2.0


@pytest.mark.parametrize("planner_id", ["anytime", "rrt_star"])
def test_the_caller_is_asked_often(arm: ArmRobot, planner_id: str) -> None:
    """Between two looks at the caller's wish there is little work: less than a cancel may take, 20 ms."""
    planner, problem = shelf_problem(arm, 5)
    # Time of the processor, since that of the clock depends on what else the machine does.
    looks = [time.thread_time()]

    def cancelled() -> bool:
        looks.append(time.thread_time())
        return False

    with contextlib.suppress(PlanningTimeoutError):
        planner.plan(problem, PlanOptions(planner_id=planner_id, allowed_seconds=0.6, seed=2), cancelled=cancelled)
    looks.append(time.thread_time())
    assert np.diff(looks).max() < 0.02


def test_getting_ready_changes_no_plan(arm: ArmRobot) -> None:
    planner, problem = shelf_problem(arm, 3)
    other = Planner(arm, planner.scene)
    other.get_ready(2)
    results = [one.plan(problem, FIRST) for one in (planner, other)]
    assert np.array_equal(results[0].path, results[1].path)
    assert results[1].statistics.exact_checks == results[0].statistics.exact_checks


def test_unreachable_keypoints_fall_back_to_uniform_and_say_so() -> None:
    planner, problem = walled_in()
    plan = planner.prepare(problem, PlanOptions(allowed_seconds=1.0))
    guidance = planner.guide(plan)
    assert guidance.sampler_id == "uniform"
    assert "no keypoints" in guidance.fallback_reason


def test_guidance_from_elsewhere_is_used() -> None:
    planner, problem = maze_problem(3)
    result = planner.plan(problem, FIRST, guidance=Guidance("uniform", fallback_reason="because"))
    assert_verified(planner, result)
    assert result.guidance.fallback_reason == "because"


class Staying:
    """Samples of one state, by a network that has learned nothing."""

    def __init__(self, state: np.ndarray) -> None:
        self.state = state

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        return np.repeat(self.state[None], count, axis=0)


@pytest.mark.parametrize("threads", [1, 2])
def test_exact_keypoints_join_networks_that_lead_nowhere(threads: int) -> None:
    planner, problem = maze_problem(3)
    (goal,) = problem.goals
    assert isinstance(goal, JointGoal)
    line = np.array((problem.start, goal.configuration))
    chain = ConfigurationChain(line, planner.robot.reference_points)
    alone = Guidance("learned", (chain,), Staying(line[0]), seconds=1.0)
    # No sample is uniform, so that a path comes from guidance or not at all.
    options = replace(FIRST, head_start=0, uniform_fraction=0.0, max_samples=20_000, threads=threads)
    result = planner.plan(problem, options, guidance=alone)
    assert_verified(planner, result)
    assert result.guidance.sampler_id == "learned"
    assert result.guidance.remark.startswith("keypoint_tube joined")
    assert result.guidance.chains[0] is chain
    assert len(result.guidance.chains) > 1
    assert result.statistics.inference_seconds > 1.0
    with pytest.raises(SamplesExhaustedError):
        planner.plan(problem, replace(options, join_keypoints=False), guidance=alone)
    with pytest.raises(SamplesExhaustedError):
        planner.plan(problem, options, guidance=replace(alone, sampler_id="path_library"))


def test_nothing_joins_networks_where_there_are_no_keypoints() -> None:
    planner, problem = walled_in()
    plan = planner.prepare(problem, PlanOptions(allowed_seconds=1.0))
    alone = Guidance("learned", (), Staying(plan.start))
    assert planner._with_keypoints(plan, alone) is alone


def test_ill_posed_problems_are_named(arm: ArmRobot) -> None:
    planner, problem = maze_problem(3)
    start, goal = problem.start, problem.goals[0]

    def plan(start: np.ndarray, goals: list[JointGoal | PoseGoal], options: PlanOptions | None = None) -> None:
        planner.plan(PlanningProblem(start, goals), options)

    with pytest.raises(InvalidStateError, match="start: 3 values"):
        plan(np.zeros(3), [goal])
    with pytest.raises(InvalidStateError, match="goal: the position of joint 'y' is not finite"):
        plan(start, [JointGoal(np.array([0.5, np.nan]))])
    with pytest.raises(StateOutsideLimitsError, match=r"goal: joint 'x' at 1\.2000"):
        plan(start, [JointGoal(np.array([1.2, 0.5]))])
    with pytest.raises(NoGoalError):
        plan(start, [])
    with pytest.raises(UnknownPlannerError, match="known: anytime"):
        plan(start, [goal], PlanOptions(planner_id="chomp"))
    with pytest.raises(UnknownSamplerError, match="known: keypoint_tube"):
        plan(start, [goal], PlanOptions(sampler_id="halton"))
    wall = next(iter(planner.scene.obstacles.values()))
    with pytest.raises(StateInCollisionError, match=wall.id):
        plan(wall.pose.position[:2], [goal])
    with pytest.raises(UnreachablePoseError, match=r"tool0.*\(3\.000"):
        Planner(arm, shelf_problem(arm, 2)[0].scene).plan(
            PlanningProblem(shelf_problem(arm, 2)[1].start, [PoseGoal(Pose.from_xyz_rpy([3.0, 0.0, 0.0]))])
        )


def test_what_is_too_close_for_the_padding_is_not_said_to_collide() -> None:
    ball = Obstacle.of("ball", Sphere(0.1), Pose.from_xyz_rpy([0.5, 0.5, 0.0]))
    planner = Planner(PointRobot(), Scene.of([ball], WorkspaceBounds(np.array([0, 0, -0.05]), np.array([1, 1, 0.05]))))

    def refusal(x: float, padding: float) -> StateInCollisionError:
        problem = PlanningProblem(np.array([x, 0.5]), [JointGoal(np.array([0.9, 0.9]))])
        with pytest.raises(StateInCollisionError) as caught:
            planner.plan(problem, PlanOptions(padding=padding))
        return caught.value

    close = refusal(0.35, 0.2)
    assert close.padding == 0.2
    assert str(close) == "start: 'point' comes closer to 'ball' than the padding of 0.2 m"
    for touching in (refusal(0.45, 0.2), refusal(0.45, 0.0)):
        assert touching.padding == 0.0
        assert "'point' collides with 'ball'" in str(touching)


def test_goals_are_alternatives() -> None:
    planner, problem = maze_problem(3)
    beyond = JointGoal(np.array([7.0, 7.0]))
    result = planner.plan(PlanningProblem(problem.start, [beyond, problem.goals[0]]), FIRST)
    assert_verified(planner, result)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("allowed_seconds", 0.0),
        ("allowed_seconds", np.nan),
        ("uniform_fraction", -0.1),
        ("max_samples", 0),
        ("velocity_scaling", 1.5),
        ("acceleration_scaling", 0.0),
        ("padding", -0.01),
        ("seed", -1),
        ("max_step", 0.0),
        ("verification_resolution", np.inf),
    ],
)
def test_options_have_ranges(option: str, value: float) -> None:
    with pytest.raises(InvalidOptionError, match=option):
        PlanOptions(**{option: value})  # type: ignore[arg-type]


def test_padding_keeps_a_distance() -> None:
    planner, problem = maze_problem(3)
    result = planner.plan(problem, PlanOptions(first_solution=True, seed=1, padding=0.01))
    checker = ExactChecker(planner.robot, planner.scene)
    distances = [checker.distance(state) for state in interpolate(result.path, 0.002)]
    assert min(distances) >= 0.009


def test_uniform_samples_hold_every_posture(arm: ArmRobot) -> None:
    start = np.array([0.1, -1.0, 1.0, -1.0, 3.0, 5.0])
    lower, upper = sampling_bounds(arm, start, np.zeros((1, 6)))
    full = arm.upper - arm.lower >= 2.0 * np.pi
    assert (upper - lower >= np.minimum(2.0 * np.pi, arm.upper - arm.lower) - 1e-9)[full].all()
    assert (lower >= arm.lower).all()
    assert (upper <= arm.upper).all()


def test_a_search_begins_near_start_and_goals(arm: ArmRobot) -> None:
    start = np.array([0.1, -1.0, 1.0, -1.0, 3.0, 5.0])
    near = start + np.array([1.0, -0.5, 0.3, 0.0, -2.0, -3.0])
    wound = near - np.array([0.0, 0.0, 0.0, 0.0, 2.0 * np.pi, 0.0])
    lower, upper = near_bounds(arm, start, np.array([near, wound]))
    whole_lower, whole_upper = sampling_bounds(arm, start, np.array([near, wound]))
    for state in (start, near):
        assert (lower <= state).all()
        assert (state <= upper).all()
    # The goal that is wound further does not make the box larger, but is a goal all the same.
    assert wound[4] < lower[4]
    inside = np.maximum(np.minimum(start, near) - NEAR, arm.lower)
    assert (lower <= inside + 1e-12).all()
    assert (upper - lower).prod() < 0.1 * (whole_upper - whole_lower).prod()
    # A goal that is further than half a turn alone is in the box.
    lower, upper = near_bounds(arm, start, wound[None])
    assert (lower <= wound).all()
    assert (wound <= upper).all()


@pytest.mark.parametrize("planner_id", OWN_PLANNER_IDS)
def test_trees_are_kept_when_asked_for(planner_id: str) -> None:
    maze = random_maze(np.random.default_rng(7)).problem
    planner = Planner(PointRobot(), maze.scene)
    problem = PlanningProblem(maze.start, [JointGoal(goal) for goal in maze.goals])
    options = PlanOptions(planner_id, max_samples=2000, allowed_seconds=20.0, seed=1)
    assert planner.plan(problem, options).trees == ()
    result = planner.plan(problem, replace(options, keep_trees=True))
    assert sum(len(tree.nodes) for tree in result.trees) > 0
    for tree in result.trees:
        assert len(tree.parents) == len(tree.nodes)
        assert (tree.parents < len(tree.nodes)).all()
    roots = np.concatenate([tree.nodes[tree.parents < 0] for tree in result.trees])
    assert (roots == maze.start).all(axis=1).any()
