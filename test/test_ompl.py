"""OMPL's planners in worker processes: the real ones."""

from __future__ import annotations

import gc
import importlib.util
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ompl")

from bsp_informed_planner.collision.certifier import Verdict
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.errors import (
    InvalidOptionError,
    MissingPackageError,
    PlannerProcessError,
    PlanningCancelledError,
    PlanningTimeoutError,
)
from bsp_informed_planner.nodes.error_codes import ErrorCode, error_code
from bsp_informed_planner.ompl_workers import process
from bsp_informed_planner.ompl_workers.process import OmplProcess, OmplWorkers
from bsp_informed_planner.ompl_workers.request import OmplRequest
from bsp_informed_planner.planning import JointGoal, Planner, PlanningProblem, PlanOptions, PlanResult, PoseGoal
from bsp_informed_planner.planning.problem import OMPL_PLANNER_IDS
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem
from bsp_informed_planner.planning.verification import CertifyingChecker
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box

ROBOT = PointRobot()
MAZE = random_maze(np.random.default_rng(3)).problem
PROBLEM = PlanningProblem(MAZE.start, [JointGoal(MAZE.goals[0])])
#: Machines that have other work are slow.
SLACK = 5.0


def first(planner_id: str = "ompl_rrt_connect", **options: Any) -> PlanOptions:
    return replace(PlanOptions(planner_id, allowed_seconds=15.0, first_solution=True, seed=1), **options)


@pytest.fixture(scope="module")
def workers() -> Iterator[OmplWorkers]:
    workers = OmplWorkers(ROBOT)
    workers.start()
    yield workers
    workers.close()


@pytest.fixture(scope="module")
def planner(workers: OmplWorkers) -> Planner:
    """Its worker is ready."""
    planner = Planner(ROBOT, MAZE.scene, ompl_workers=workers)
    planner.plan(PROBLEM, first())
    return planner


def walled_in(workers: OmplWorkers | None = None) -> tuple[Planner, PlanningProblem]:
    """A goal that no path reaches."""
    bounds = WorkspaceBounds(np.array([0.0, 0.0, -0.05]), np.array([1.0, 1.0, 0.05]))
    wall = Obstacle.of("wall", Box(np.array([0.1, 1.5, 0.2])), Pose.from_xyz_rpy([0.5, 0.5, 0.0]))
    planner = Planner(ROBOT, Scene.of([wall], bounds), ompl_workers=workers)
    return planner, PlanningProblem(np.array([0.1, 0.5]), [JointGoal(np.array([0.9, 0.5]))])


def assert_verified(planner: Planner, result: PlanResult) -> None:
    proof = CertifyingChecker(ExactChecker(planner.robot, planner.scene), result.verification_resolution)
    assert proof.verdict(result.path) is not Verdict.COLLIDING
    assert (proof.verdict(result.trajectory.positions) is Verdict.CERTIFIED) == result.certified
    assert result.cost == pytest.approx(float(np.linalg.norm(np.diff(result.path, axis=0), axis=1).sum()))
    assert result.cost_history.costs[-1] == pytest.approx(result.cost)


def is_running(pid: int) -> bool:
    """Whether a process lives; a zombie does not."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def is_gone(pid: int, seconds: float = 60.0) -> bool:
    """Whether a process ends soon."""
    end = time.monotonic() + seconds
    while is_running(pid) and time.monotonic() < end:
        time.sleep(0.01)
    return not is_running(pid)


@pytest.mark.parametrize("planner_id", OMPL_PLANNER_IDS)
def test_mazes_are_solved(planner: Planner, planner_id: str) -> None:
    result = planner.plan(PROBLEM, first(planner_id))
    assert_verified(planner, result)
    assert result.planner_id == planner_id
    assert result.guidance.sampler_id == "uniform"
    assert "their own" in result.guidance.fallback_reason
    assert np.array_equal(result.path[[0, -1]], [MAZE.start, MAZE.goals[0]])
    assert result.statistics.edges_checked > 0


@pytest.mark.parametrize("planner_id", ["ompl_informed_rrt_star", "ompl_bit_star"])
def test_time_improves_paths(planner: Planner, planner_id: str) -> None:
    one = planner.plan(PROBLEM, first(planner_id))
    many = planner.plan(PROBLEM, first(planner_id, first_solution=False, allowed_seconds=3.0))
    assert_verified(planner, many)
    assert list(many.cost_history.costs) == sorted(many.cost_history.costs, reverse=True)
    assert len(many.cost_history.costs) > 1
    assert many.cost < one.cost


def test_simplification_is_an_option(planner: Planner) -> None:
    raw = planner.plan(PROBLEM, first(ompl_simplify=False))
    simplified = planner.plan(PROBLEM, first())
    assert_verified(planner, raw)
    assert_verified(planner, simplified)
    assert simplified.cost_history.costs[0] == pytest.approx(raw.cost)
    assert simplified.cost < raw.cost


def test_same_seed_same_path(planner: Planner) -> None:
    paths = [planner.plan(PROBLEM, first(seed=seed, ompl_simplify=False)).path for seed in (4, 4, 5)]
    assert np.array_equal(paths[0], paths[1])
    assert not np.array_equal(paths[0], paths[2])


def test_an_arm_reaches_into_a_shelf() -> None:
    arm = ur5()
    problem = random_shelf_problem(arm, np.random.default_rng(3))
    planner = Planner(arm, problem.scene)
    # Several goals, which OMPL's AORRTC alone cannot.
    for planner_id in ("ompl_rrt_connect", "ompl_aorrtc"):
        options = first(planner_id, first_solution=planner_id == "ompl_rrt_connect")
        options = replace(options, allowed_seconds=2.5 if planner_id == "ompl_aorrtc" else 15.0)
        result = planner.plan(PlanningProblem(problem.start, [PoseGoal(problem.goal_poses[0])]), options)
        assert_verified(planner, result)
        reached = arm.forward_kinematics(result.path[-1])
        assert np.allclose(reached.matrix, problem.goal_poses[0].matrix, atol=1e-5)


def test_start_at_the_goal(planner: Planner) -> None:
    result = planner.plan(PlanningProblem(MAZE.start, [JointGoal(MAZE.start)]), first())
    assert result.cost == 0.0


@pytest.mark.parametrize("planner_id", OMPL_PLANNER_IDS)
def test_nothing_found_within_the_time(planner: Planner, workers: OmplWorkers, planner_id: str) -> None:
    closed, problem = walled_in(workers)
    begin = time.monotonic()
    with pytest.raises(PlanningTimeoutError, match=r"0\.50 s"):
        closed.plan(problem, PlanOptions(planner_id, allowed_seconds=0.5))
    assert time.monotonic() - begin <= 0.55 + SLACK


@pytest.mark.parametrize("planner_id", OMPL_PLANNER_IDS)
def test_the_start_of_a_worker_is_not_planning_time(planner_id: str) -> None:
    """The first plan of a node, say: its time is for planning, and the start, which takes longer, comes on top."""
    planner = Planner(ROBOT, MAZE.scene)
    begin = time.monotonic()
    result = planner.plan(PROBLEM, first(planner_id, allowed_seconds=0.3))
    seconds = time.monotonic() - begin
    assert_verified(planner, result)
    assert 0.3 < result.statistics.total_seconds < seconds
    planner.ompl_workers.close()


def test_a_worker_that_is_not_ready_in_time_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "START_SECONDS", 0.01)
    closed, problem = walled_in()
    with pytest.raises(PlanningTimeoutError):
        closed.plan(problem, first(allowed_seconds=0.02))
    assert len(closed.ompl_workers.idle_pids) == 1
    assert is_running(closed.ompl_workers.idle_pids[0])


@pytest.mark.parametrize("planner_id", OMPL_PLANNER_IDS)
def test_cancelled_plans_end_at_once(planner: Planner, workers: OmplWorkers, planner_id: str) -> None:
    closed, problem = walled_in(workers)
    cancel = time.monotonic() + 0.2
    with pytest.raises(PlanningCancelledError):
        closed.plan(problem, first(planner_id, first_solution=False), cancelled=lambda: time.monotonic() > cancel)
    assert time.monotonic() - cancel < 0.02 + SLACK
    # Whether it stopped or was killed, the next plan has a worker.
    assert_verified(planner, planner.plan(PROBLEM, first()))


def during_a_search(workers: OmplWorkers, sent: signal.Signals) -> threading.Timer:
    """Sends a signal to the worker while it searches."""
    timer = threading.Timer(0.15, os.kill, (workers.idle_pids[0], sent))
    timer.start()
    return timer


def ready_worker() -> OmplWorkers:
    workers = OmplWorkers(ROBOT)
    Planner(ROBOT, MAZE.scene, ompl_workers=workers).plan(PROBLEM, first())
    return workers


def test_hanging_workers_are_ended() -> None:
    workers = ready_worker()
    closed, problem = walled_in(workers)
    (pid,) = workers.idle_pids
    cancel = time.monotonic() + 0.3
    timer = during_a_search(workers, signal.SIGSTOP)
    with pytest.raises(PlanningCancelledError):
        closed.plan(problem, first(), cancelled=lambda: time.monotonic() > cancel)
    assert time.monotonic() - cancel < 0.02 + SLACK
    timer.join()
    # Nobody waits for its end.
    assert is_gone(pid)
    assert not workers.idle_pids

    Planner(ROBOT, MAZE.scene, ompl_workers=workers).plan(PROBLEM, first())
    pid = workers.idle_pids[0]
    begin = time.monotonic()
    timer = during_a_search(workers, signal.SIGSTOP)
    with pytest.raises(PlanningTimeoutError):
        closed.plan(problem, first(allowed_seconds=0.5))
    assert time.monotonic() - begin < 0.6 + SLACK
    timer.join()
    assert is_gone(pid)


def test_a_crash_is_named() -> None:
    workers = ready_worker()
    closed, problem = walled_in(workers)
    (pid,) = workers.idle_pids
    timer = during_a_search(workers, signal.SIGSEGV)
    with pytest.raises(
        PlannerProcessError, match=r"worker process of 'ompl_rrt_connect' was ended by SIGSEGV"
    ) as caught:
        closed.plan(problem, first())
    timer.join()
    assert error_code(caught.value) is ErrorCode.CRASH
    assert not is_running(pid)
    # One that dies while it waits is replaced without a word.
    Planner(ROBOT, MAZE.scene, ompl_workers=workers).plan(PROBLEM, first())
    (pid,) = workers.idle_pids
    os.kill(pid, signal.SIGKILL)
    assert is_gone(pid)
    Planner(ROBOT, MAZE.scene, ompl_workers=workers).plan(PROBLEM, first())
    workers.close()


def request(**fields: Any) -> OmplRequest:
    of_maze = OmplRequest(
        planner_id="ompl_rrt_connect",
        start=MAZE.start,
        goals=np.array(MAZE.goals[:1]),
        lower=ROBOT.lower,
        upper=ROBOT.upper,
        padding=0.0,
        resolution=0.005,
        deadline=time.monotonic() + 10.0,
        seed=1,
    )
    return replace(of_maze, **fields)


def test_errors_of_a_search_are_told(planner: Planner, workers: OmplWorkers) -> None:
    pids = workers.idle_pids
    with pytest.raises(PlannerProcessError, match="raised InvalidOptionError: finest = -1"):
        workers.solve(MAZE.scene, request(resolution=-1.0), lambda: False, lambda path: False)
    assert workers.idle_pids == pids


def test_paths_of_the_default_checker_are_proved(workers: OmplWorkers) -> None:
    found: list[FloatArray] = []

    def take(path: FloatArray) -> bool:
        found.append(path)
        return False

    workers.solve(MAZE.scene, request(resolution=1e-4), lambda: False, take)
    assert found
    proof = CertifyingChecker(ExactChecker(ROBOT, MAZE.scene), 1e-4)
    assert all(proof.verdict(path) is not Verdict.COLLIDING for path in found)


def test_other_checkers_can_be_given() -> None:
    workers = OmplWorkers(ROBOT, ExactChecker)
    result = Planner(ROBOT, MAZE.scene, ompl_workers=workers).plan(PROBLEM, first(verification_resolution=0.002))
    assert result.statistics.edges_checked > 0
    workers.close()


def test_a_worker_knows_one_scene_at_a_time(workers: OmplWorkers) -> None:
    """Planners of different scenes share it in turn, and none gets a path of another's scene."""
    scenes = [random_maze(np.random.default_rng(seed)).problem for seed in (3, 4, 3)]
    for maze in scenes:
        planner = Planner(ROBOT, maze.scene, ompl_workers=workers)
        assert_verified(planner, planner.plan(PlanningProblem(maze.start, [JointGoal(maze.goals[0])]), first()))
    assert len(workers.idle_pids) == 1


def test_a_caller_that_raises_ends_its_worker() -> None:
    process = OmplProcess(ROBOT, ExactChecker)

    def refuse(path: FloatArray) -> bool:
        raise RuntimeError("no")

    with pytest.raises(RuntimeError, match="no"):
        process.solve(MAZE.scene, request(), lambda: False, refuse)
    assert not is_running(process.pid)
    process.close()


def test_edges_may_be_checked_by_ompl(planner: Planner, workers: OmplWorkers) -> None:
    found: list[FloatArray] = []

    def take(path: FloatArray) -> bool:
        found.append(path)
        return False

    # So far apart that walls fall between two states.
    counts = workers.solve(MAZE.scene, request(discrete_fraction=0.9, simplify=False), lambda: False, take)
    assert counts is not None
    assert counts.edges == 0
    assert counts.states > 0
    proof = CertifyingChecker(ExactChecker(ROBOT, MAZE.scene), 1e-4)
    assert proof.verdict(found[0]) is Verdict.COLLIDING


def test_threads_have_workers_of_their_own() -> None:
    workers = OmplWorkers(ROBOT)
    planner = Planner(ROBOT, MAZE.scene, ompl_workers=workers)
    results: list[PlanResult] = []
    threads = [threading.Thread(target=lambda: results.append(planner.plan(PROBLEM, first()))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 2
    assert np.array_equal(results[0].path, results[1].path)
    pids = workers.idle_pids
    assert len(set(pids)) == 2
    workers.close()
    assert not any(is_running(pid) for pid in pids)


def test_workers_end_with_their_planner() -> None:
    planner = Planner(ROBOT, MAZE.scene)
    planner.ompl_workers.start()
    (pid,) = planner.ompl_workers.idle_pids
    assert is_running(pid)
    del planner
    gc.collect()
    assert is_gone(pid)


@pytest.mark.parametrize("how", ["os.kill(os.getpid(), 9)", "pass"])
def test_workers_do_not_outlive_their_parent(how: str) -> None:
    program = (
        "import os\n"
        "from bsp_informed_planner.ompl_workers.process import OmplWorkers\n"
        "from bsp_informed_planner.robots.point import PointRobot\n"
        "workers = OmplWorkers(PointRobot())\n"
        "workers.start()\n"
        "print(workers.idle_pids[0], flush=True)\n" + how
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=False)
    assert is_gone(int(done.stdout))


def test_options_that_ompl_does_not_have(planner: Planner) -> None:
    with pytest.raises(InvalidOptionError, match="max_samples"):
        planner.plan(PROBLEM, first(max_samples=100))


def test_without_ompl(planner: Planner, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        MissingPackageError, match=r"'ompl_rrt_connect' needs .* 'bsp_informed_planner\[baselines\]'"
    ) as caught:
        planner.plan(PROBLEM, first())
    assert error_code(caught.value) is ErrorCode.INVALID_GROUP_NAME


def test_scenes_can_be_sent() -> None:
    scene = pickle.loads(pickle.dumps(MAZE.scene))
    assert list(scene.obstacles) == list(MAZE.scene.obstacles)
    assert scene.bounds == MAZE.scene.bounds
    assert (scene.frame, scene.revision) == (MAZE.scene.frame, MAZE.scene.revision)
