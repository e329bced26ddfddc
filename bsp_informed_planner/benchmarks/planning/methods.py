"""What is compared: our planner, OMPL's, and two controls, each as a history of verified costs."""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from bsp_informed_planner.benchmarks.planning.problems import ShelfProblem
from bsp_informed_planner.errors import (
    PlanningFailedError,
    PlanningTimeoutError,
    SamplesExhaustedError,
    TrajectoryTimingError,
)
from bsp_informed_planner.ompl_workers.process import OmplWorkers
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import OMPL_PLANNER_IDS, PlanOptions, PlanResult
from bsp_informed_planner.planning.search import Progress
from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.sampling.guidance import Guidance
from bsp_informed_planner.sampling.path_guide import path_guidance

logger = logging.getLogger(__name__)

#: What happens before a first path, in this order.
PHASES = ("validation", "uniform search", "guidance", "guided search")
#: The planner keeps at most this much of its time for what follows the search [s].
RESERVE = 0.4


@dataclass(frozen=True)
class History:
    """What came of a run.

    Attributes:
        seconds: after which a better path was verified, from the beginning of the plan, ascending [s].
        costs: of these paths, descending.
        certified: whether the path that was returned is proved free, its timing included; None without a path.
        phases: time spent in each of `PHASES` up to the first path [s].
        exact_checks: configurations given to the exact judge.
    """

    seconds: tuple[float, ...] = ()
    costs: tuple[float, ...] = ()
    certified: bool | None = None
    phases: tuple[float, ...] = ()
    exact_checks: int = 0

    def cost_at(self, seconds: float) -> float:
        """Of the best path verified by then; infinite without one."""
        return min((c for s, c in zip(self.seconds, self.costs, strict=True) if s <= seconds), default=float("inf"))

    def first(self, limit: float) -> float:
        """When the first path was verified [s]; infinite if it was not within the limit."""
        return self.seconds[0] if self.seconds and self.seconds[0] <= limit else float("inf")


@dataclass(frozen=True)
class Run:
    """One run to be made.

    Attributes:
        problem: what to plan.
        seed: of the planner.
        seconds: for the search.
        first_solution: whether the first path ends it.
    """

    problem: ShelfProblem
    seed: int
    seconds: float
    first_solution: bool


@dataclass(frozen=True)
class Method:
    """A planner under test. `title` for people; `run` returns its history."""

    title: str
    run: Callable[[Run], History]


@cache
def robot() -> ArmRobot:
    """The arm of all problems: UR5 on its URDF's own meshes, all pairs of links that its SRDF leaves."""
    return ur5()


@cache
def workers() -> OmplWorkers:
    """The processes of OMPL's planners, with the checker that ours search with."""
    return OmplWorkers(robot())


def has_ompl() -> bool:
    return importlib.util.find_spec("ompl") is not None


def planner_of(problem: ShelfProblem, threads: int = 1) -> Planner:
    """A planner that has loaded and decomposed the scene and made its checkers."""
    planner = Planner(robot(), problem.scene, ompl_workers=workers())
    planner.get_ready(threads)
    return planner


def _plan(
    planner: Planner, run: Run, guidance: Guidance | None = None, **options: str | float | bool | int
) -> tuple[PlanResult | None, list[Progress]]:
    """A result, or None, and how it came to be."""
    told: list[Progress] = []

    chosen = {
        "allowed_seconds": run.seconds + RESERVE,
        "first_solution": run.first_solution,
        "seed": run.seed,
        **options,
    }
    try:
        result = planner.plan(
            run.problem.problem,
            PlanOptions(**chosen),  # type: ignore[arg-type]
            guidance=guidance,
            on_progress=told.append,
        )
    except (PlanningTimeoutError, SamplesExhaustedError):
        return None, told
    except (PlanningFailedError, TrajectoryTimingError) as error:
        logger.warning("counted as a failure: %s", error)
        return None, told
    return result, told


def _search_began(told: Sequence[Progress]) -> float:
    """When a search began: after start and goals had been validated [s]."""
    return next((progress.elapsed_seconds for progress in told if progress.phase != "validating"), 0.0)


def phases_until(told: Sequence[Progress], end: float) -> tuple[float, ...]:
    """Time in each of `PHASES` up to some time [s]."""
    spent = dict.fromkeys(PHASES, 0.0)
    name = PHASES[0]
    times = [*(min(progress.elapsed_seconds, end) for progress in told), end]
    for progress, begin, until in zip(told, times[:-1], times[1:], strict=True):
        if progress.phase == "guidance":
            name = PHASES[2]
        elif progress.phase != "validating":
            name = PHASES[3] if name in PHASES[2:] else PHASES[1]
        spent[name] += until - begin
    return tuple(spent.values())


def _history(result: PlanResult | None, run: Run, told: Sequence[Progress] = ()) -> History:
    if result is None:
        return History()
    pairs = [
        (seconds, cost)
        for seconds, cost in zip(result.cost_history.seconds, result.cost_history.costs, strict=True)
        if seconds <= run.seconds
    ]
    if not pairs:
        return History()
    seconds, costs = (tuple(values) for values in zip(*pairs, strict=True))
    phases = phases_until(told, seconds[0])
    return History(seconds, costs, result.certified, phases, result.statistics.exact_checks)


def _planner(planner_id: str, sampler_id: str = "uniform") -> Callable[[Run], History]:
    def plan(run: Run) -> History:
        # What a simplification finds is no first path.
        result, told = _plan(
            planner_of(run.problem),
            run,
            planner_id=planner_id,
            sampler_id=sampler_id,
            ompl_simplify=not run.first_solution,
        )
        return _history(result, run, told)

    return plan


def with_threads(run: Run, threads: int) -> History:
    """Our planner with exact keypoints, in so many threads."""
    result, _ = _plan(planner_of(run.problem, threads), run, threads=threads)
    return _history(result, run)


def tube_around_path(run: Run) -> History:
    """Control: our planner, guided by the tube around a path of RRT-Connect instead of one around keypoints.

    What it loses against keypoints is what keypoints know; what it gains against uniform samples comes from having any
    feasible corridor.
    """
    planner = planner_of(run.problem)
    result, _ = _plan(planner, run, planner_id="rrt_connect", sampler_id="uniform")
    first = _history(result, run)
    if result is None or not first.seconds or run.first_solution:
        return first
    spent = first.seconds[0]
    rest = Run(run.problem, run.seed + 1, run.seconds - spent, False)
    guided, told = _plan(planner, rest, path_guidance(robot(), result.path))
    begin, later = _search_began(told), _history(guided, rest)
    better = [(spent + s - begin, c) for s, c in zip(later.seconds, later.costs, strict=True) if c < first.costs[0]]
    return History(
        first.seconds[:1] + tuple(s for s, _ in better),
        first.costs[:1] + tuple(c for _, c in better),
        later.certified if better else first.certified,
    )


def restarts(run: Run) -> History:
    """Control: RRT-Connect and shortcut again and again, the best path of all, for the same time.

    Counted is what such a planner would do: start and goals are validated once, the timing of paths is left out, and
    only paths that are better than the best are verified.
    """
    planner = planner_of(run.problem)
    seconds: list[float] = []
    costs: list[float] = []
    certified: bool | None = None
    spent, seed = 0.0, run.seed
    while spent < run.seconds:
        left = Run(run.problem, seed, run.seconds - spent, True)
        result, told = _plan(planner, left, planner_id="rrt_connect", sampler_id="uniform")
        if result is None:
            break
        begin = _search_began(told) if costs else 0.0
        better = not costs or result.cost < costs[-1]
        spent += result.cost_history.seconds[-1] - begin
        spent -= 0.0 if better else result.statistics.verification_seconds
        if better and spent <= run.seconds:
            seconds.append(spent)
            costs.append(result.cost)
            certified = result.certified
        seed += 1
        if run.first_solution:
            break
    return History(tuple(seconds), tuple(costs), certified)


OMPL_TITLES = dict(
    zip(
        OMPL_PLANNER_IDS,
        ("OMPL RRTConnect + simplify", "OMPL RRTstar", "OMPL InformedRRTstar", "OMPL BITstar", "OMPL AORRTC"),
        strict=True,
    )
)


def methods() -> Mapping[str, Method]:
    """All of them, by a short name for columns; OMPL's where it is installed."""
    own = {
        "keypoints": Method("ours, exact keypoints", _planner("anytime", "keypoint_tube")),
        "uniform": Method("ours, uniform", _planner("anytime")),
        "learned": Method("ours, network", _planner("anytime", "learned")),
        "tube": Method("control: tube around an RRT-Connect path", tube_around_path),
        "restarts": Method("control: RRT-Connect restarts + shortcut", restarts),
    }
    return own | ({name: Method(title, _planner(name)) for name, title in OMPL_TITLES.items()} if has_ompl() else {})


def warm_up(problem: ShelfProblem) -> None:
    """Whatever happens once only: scenes sent to worker processes, checkers made, code and kernels loaded.

    A problem that is unsolvable warms up as well.
    """
    run = Run(problem, 0, 0.05, True)
    for sampler_id in ("keypoint_tube", "learned"):
        # Without a head start: else guidance might be made, and what it needs loaded, in a run that counts.
        _plan(planner_of(problem), run, planner_id="anytime", sampler_id=sampler_id, head_start=0)
    if has_ompl():
        _plan(planner_of(problem), run, planner_id="ompl_rrt_connect", sampler_id="uniform")


def in_random_order(names: list[str], rng: np.random.Generator) -> list[str]:
    """What comes first may find a colder machine: no method always does."""
    return [names[index] for index in rng.permutation(len(names))]
