"""The planner: validation, guidance, search, verification and timing of one plan."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.certifier import Verdict
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.holding import robot_in_scene
from bsp_informed_planner.compile_kernels import ensure_compiled
from bsp_informed_planner.decomposition.decomposition import Decomposition, decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import (
    InvalidOptionError,
    PlanningFailedError,
    PlanningTimeoutError,
    RobotDescriptionError,
    SamplesExhaustedError,
    UnknownFrameError,
    UnknownPlannerError,
    UnknownSamplerError,
)
from bsp_informed_planner.ompl_workers.process import OmplWorkers, require_ompl
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.fitting_chains import with_fitting_chains
from bsp_informed_planner.planning.judges import Judges
from bsp_informed_planner.planning.ompl_search import OmplPathSearch
from bsp_informed_planner.planning.problem import (
    OMPL_PLANNER_IDS,
    PLANNER_IDS,
    CostHistory,
    PlanningProblem,
    PlanOptions,
    PlanResult,
    PlanStatistics,
    default_verification_resolution,
)
from bsp_informed_planner.planning.rrt_star import require_room
from bsp_informed_planner.planning.search import Progress, Search
from bsp_informed_planner.planning.validation import free_state, goal_configurations
from bsp_informed_planner.planning.verified_timing import verified_trajectory
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import Guidance, KeypointGuideOptions
from bsp_informed_planner.sampling.guide import EXACT, LEARNED, SAMPLER_IDS, GuideSetting
from bsp_informed_planner.sampling.scene_guides import UNAVAILABLE, SceneGuides
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

#: Time kept back for timing the path that is returned: a share of what is allowed, at most so many seconds.
RESERVE_SHARE = 0.15
RESERVE_SECONDS = 0.3
#: Work that kernels are given at a time, about a millisecond: a number of edges, of arms and of robots that only slide.
#: It does not hang on the clock, since what is found may hang on it.
WORK, SLIDING_WORK = 64, 1024


@dataclass(frozen=True, eq=False)
class PreparedPlan:
    """A validated problem whose time is running.

    Attributes:
        start: (n,) free.
        goals: (k, n) free, the nearest first.
        options: of the plan.
        seed: of its generator.
        judges: the last check, one for each thread.
        checks_before: what the judges had checked before.
        budget, search: what it spends, and how.
    """

    start: FloatArray
    goals: FloatArray
    options: PlanOptions
    seed: int
    judges: tuple[BoundedChecker, ...]
    checks_before: int
    budget: Budget
    search: Search


class Planner:
    """Plans for one robot in one scene.

    The scene and the robot do not change, so an instance may be used by several threads at once: each plan has a
    collision checker and a generator of its own.

    Args:
        robot: the robot, without what it holds in the scene.
        scene: what to keep clear of, in the robot's root frame.
        decomposition: of this scene; None: made when first needed.
        guide_options: how keypoints are lifted to configurations.
        models: folder of learned models; None: those that come with the package.
        decomposition_options: used when the decomposition is made here; None: of the robot's workspace dimension.
        ompl_workers: processes for OMPL's planners, of this robot, which planners of other scenes may share; None: of
            its own, started when first needed.

    Raises:
        UnknownFrameError: if the scene is not given in the root frame of the robot, or attaches to an unknown link.
        RobotDescriptionError: if the robot has no collision geometry.
        InvalidOptionError: if the decomposition is of another scene, or of another dimension than the robot's.
        SceneError: if a shape of an obstacle has no volume.

    Examples:
        >>> from bsp_informed_planner.robots.demo_arms import ur5  # doctest: +SKIP
        >>> planner = Planner(ur5(), load_scene("shelf.yaml"))  # doctest: +SKIP
        >>> result = planner.plan(PlanningProblem(start, [JointGoal(goal)]))  # doctest: +SKIP
        >>> result.trajectory.positions  # doctest: +SKIP
    """

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        *,
        decomposition: Decomposition | None = None,
        guide_options: KeypointGuideOptions | None = None,
        models: str | None = None,
        decomposition_options: DecompositionOptions | None = None,
        ompl_workers: OmplWorkers | None = None,
    ) -> None:
        if scene.frame != robot.root_frame:
            raise UnknownFrameError(scene.frame, [robot.root_frame], "the scene, for this robot")
        if not robot.collision_model.ngeoms:
            raise RobotDescriptionError(f"robot '{robot.name}' has no collision geometry: nothing could be checked")
        ensure_compiled()
        self.robot = robot_in_scene(robot, scene)
        self.scene = scene
        self._decomposition: Decomposition | None = None
        if decomposition is not None:
            self.adopt(decomposition)
        self._decomposition_options = decomposition_options or DecompositionOptions(dimension=robot.workspace_dimension)
        options = guide_options or KeypointGuideOptions()
        self._guides = SceneGuides(GuideSetting(self.robot, scene, lambda: self.decomposition, options, models))
        self.ompl_workers = ompl_workers or OmplWorkers(robot)
        self._judges = Judges(self.robot, scene, default_verification_resolution(self.robot))

    @property
    def decomposition(self) -> Decomposition:
        """Of the scene; made when first asked for.

        Raises:
            SceneError: if the scene cannot be decomposed.
        """
        if self._decomposition is None:
            self._decomposition = decompose(self.scene, self._decomposition_options)
        return self._decomposition

    def adopt(self, decomposition: Decomposition) -> bool:
        """Use a decomposition of the scene that was made elsewhere. False if there is another one already.

        Raises:
            InvalidOptionError: if it is of another scene, or of another dimension than the robot's.
        """
        of = (decomposition.dimension, decomposition.frame, decomposition.scene_revision)
        if of != (self.robot.workspace_dimension, self.scene.frame, self.scene.revision):
            raise InvalidOptionError(
                "decomposition", of, f"dimension {self.robot.workspace_dimension}, frame and revision of the scene"
            )
        if self._decomposition is None:
            self._decomposition = decomposition
        return self._decomposition is decomposition

    def get_ready(self, threads: int = 1, *, decompose: bool = True) -> None:
        """Make what the first plan would make and all later ones use: some milliseconds that need not be a plan's.

        That is the last check, for plans without padding, and the decomposition.

        Args:
            threads: of the plans.
            decompose: whether plans will need the decomposition.

        Raises:
            SceneError: if the scene cannot be decomposed.
        """
        if decompose:
            _ = self.decomposition
        self._judges.get_ready(threads)

    def checker(self, padding: float = 0.0) -> ExactChecker:
        """An exact collision checker of its own for the caller. `padding`: distance to keep from obstacles [m]."""
        return self.judge(padding).judge

    def judge(self, padding: float = 0.0, finest: float | None = None) -> BoundedChecker:
        """The last check of configurations and edges, of its own for the caller.

        Args:
            padding: distance to keep from obstacles [m].
            finest: shortest interval of its proofs [m]; None: the default of `PlanOptions.verification_resolution`.
        """
        return self._judges.make(padding, finest)

    def plan(
        self,
        problem: PlanningProblem,
        options: PlanOptions | None = None,
        *,
        guidance: Guidance | None = None,
        cancelled: Callable[[], bool] | None = None,
        on_progress: Callable[[Progress], None] | None = None,
    ) -> PlanResult:
        """Plan a verified, timed path.

        Args:
            problem: from where to where.
            options: see there.
            guidance: from elsewhere, e.g. a network; None: made here, as `options.sampler_id` says.
            cancelled: asked often; True ends the plan.
            on_progress: told of each phase and each better path.

        Raises:
            UnknownPlannerError, UnknownSamplerError: an id that does not exist.
            ProblemError: start or goal are not usable; its subclass says how.
            PlanningTimeoutError, SamplesExhaustedError: no verified path with the time or samples allowed.
            TrajectoryTimingError: a path, but no timing of it.
            PlanningCancelledError: the caller has cancelled.
            MissingPackageError, PlannerProcessError: OMPL is not installed, or its process failed.
        """
        options = options or PlanOptions()
        if guidance is None and options.sampler_id in SAMPLER_IDS:
            self.load_guide(options.sampler_id)
        plan = self.prepare(problem, options, cancelled=cancelled, on_progress=on_progress)
        return self.solve(plan, (lambda: self.guide(plan)) if guidance is None else guidance)

    def prepare(
        self,
        problem: PlanningProblem,
        options: PlanOptions | None = None,
        *,
        cancelled: Callable[[], bool] | None = None,
        on_progress: Callable[[Progress], None] | None = None,
        spent_seconds: float = 0.0,
    ) -> PreparedPlan:
        """The first part of `plan`, for callers that get guidance from elsewhere: its time starts to run here.

        Args:
            problem, options, cancelled, on_progress: see `plan`.
            spent_seconds: of the time allowed, before this call, e.g. on this planner [s].

        Raises:
            UnknownPlannerError, UnknownSamplerError, ProblemError, PlanningCancelledError: see `plan`.
            InvalidOptionError: for more samples than memory allows, or cost weights of other joints than the robot's.
            InvalidOptionError: `max_samples` for one of OMPL's planners, whose samples cannot be counted.
            MissingPackageError: OMPL is not installed.
        """
        options = options or PlanOptions()
        self._require_usable(options)
        seed = secrets.randbits(32) if options.seed is None else options.seed
        reserve = min(RESERVE_SHARE * options.allowed_seconds, RESERVE_SECONDS)
        work = WORK if self.robot.revolute.any() else SLIDING_WORK
        budget = Budget(options.allowed_seconds - reserve, options.max_samples, cancelled, work, spent_seconds)
        search = Search(self.robot, options, budget, seed, on_progress)
        search.report("validating")
        judges = tuple(
            self._judges.lend(options.padding, search.verification_resolution) for _ in range(options.threads)
        )
        before = sum(judge.checks for judge in judges)
        try:
            start = free_state(self.robot, judges[0], "start", problem.start)
            goals = goal_configurations(
                self.robot, judges[0], problem, start, options.max_goals, budget.check_cancelled
            )
        except BaseException:
            self._judges.give_back(*judges)
            raise
        return PreparedPlan(start, goals, options, seed, judges, before, budget, search)

    def _require_usable(self, options: PlanOptions) -> None:
        """Raises what `prepare` names, if options cannot be had or do not fit this robot."""
        if options.planner_id not in PLANNER_IDS:
            raise UnknownPlannerError(options.planner_id, PLANNER_IDS)
        if options.planner_id in OMPL_PLANNER_IDS:
            require_ompl(options.planner_id)
            if options.max_samples is not None:
                raise InvalidOptionError("max_samples", options.max_samples, f"none for '{options.planner_id}'")
        if options.sampler_id not in SAMPLER_IDS:
            raise UnknownSamplerError(options.sampler_id, SAMPLER_IDS)
        if options.cost_weights is not None and len(options.cost_weights) != self.robot.dof:
            raise InvalidOptionError("cost_weights", options.cost_weights, f"{self.robot.dof} numbers, one a joint")
        if options.max_samples is not None:
            require_room("max_samples", options.max_samples, self.robot.dof)

    def load_guide(self, sampler_id: str) -> str:
        """Load the models of a sampler id, which takes seconds for the first network of a process.

        `plan` does it before its time begins.

        Returns:
            why there is none to load, so that exact keypoints take its place; empty if there is.

        Raises:
            UnknownSamplerError: for an id that does not exist.
        """
        if sampler_id in ("uniform", EXACT):
            return ""
        try:
            self._guides.get(sampler_id)
        except UNAVAILABLE as error:
            return f"{sampler_id}: {error}"
        return ""

    def guide(self, plan: PreparedPlan, sampler_id: str | None = None) -> Guidance:
        """Guidance for a plan, with the reason if it is not what was asked for.

        Args:
            plan: a prepared one.
            sampler_id: None: as the plan's options ask for.
        """
        sampler_id = sampler_id or plan.options.sampler_id
        if sampler_id == "uniform" or plan.options.uniform_fraction == 1.0:
            return Guidance("uniform")
        if plan.options.planner_id in OMPL_PLANNER_IDS:
            return Guidance("uniform", fallback_reason="OMPL's planners take no samples but their own")
        plan.search.report("guidance")
        # Half of the time at most: without a chain, the other half is still there to search uniformly.
        half = plan.budget.part(0.5 * plan.budget.remaining)
        return self._guides.guide(sampler_id, plan.start, plan.goals, plan.judges[0], half.is_out_of_time)

    def solve(self, plan: PreparedPlan, guidance: Guidance | Callable[[], Guidance]) -> PlanResult:
        """The last part of `plan`: search, verification, timing. A prepared plan is solved once.

        Args:
            plan: from `prepare`.
            guidance: or what makes it, once it is needed: most first paths are found sooner than guidance.

        Raises:
            PlanningTimeoutError, SamplesExhaustedError, PlanningCancelledError: see `plan`.
        """
        try:
            return self._solved(plan, guidance)
        finally:
            self._judges.give_back(*plan.judges)

    def _solved(self, plan: PreparedPlan, guidance: Guidance | Callable[[], Guidance]) -> PlanResult:
        options, budget, search = plan.options, plan.budget, plan.search

        def fitting() -> Guidance:
            made = guidance if isinstance(guidance, Guidance) else guidance()
            return with_fitting_chains(made, self.robot, plan.start, plan.goals)

        if options.planner_id in OMPL_PLANNER_IDS:
            path = self._ompl_path(plan)
            used = fitting()
        else:
            known = isinstance(guidance, Guidance)
            path = search.run(
                list(plan.judges),
                plan.start,
                plan.goals,
                fitting() if known else fitting,
                lambda made: self._with_keypoints(plan, made),
            )
            used = search.guidance or self._unused(options)
        if path is None:
            if budget.samples_left <= 0:
                raise SamplesExhaustedError(budget.samples)
            raise PlanningTimeoutError(options.allowed_seconds, budget.samples)
        if not np.array_equal(path[0], plan.start) or not (path[-1] == plan.goals).all(axis=1).any():
            raise PlanningFailedError("the search returned a path between other states than start and goal")
        search.report("timing")
        trajectory, verdict = verified_trajectory(path, self.robot, plan.judges[0], options, budget.check_cancelled)
        search.report("done")
        self._guides.learn(options.sampler_id, path)
        return PlanResult(
            path=path,
            trajectory=trajectory,
            cost=search.incumbent.cost,
            certified=verdict is Verdict.CERTIFIED,
            cost_history=CostHistory(tuple(search.incumbent.seconds), tuple(search.incumbent.costs)),
            planner_id=options.planner_id,
            guidance=used,
            verification_resolution=search.verification_resolution,
            scene_revision=self.scene.revision,
            statistics=self._statistics(plan, used),
            trees=search.trees,
        )

    def _with_keypoints(self, plan: PreparedPlan, guidance: Guidance) -> Guidance:
        """Guidance of networks, joined by exact keypoints: where one of them fails, the other seldom does."""
        if not plan.options.join_keypoints or guidance.sampler_id != LEARNED:
            return guidance
        exact = self.guide(plan, EXACT)
        return guidance.joined_by(exact) if exact.sampler_id == EXACT else guidance

    def _ompl_path(self, plan: PreparedPlan) -> FloatArray | None:
        """(m, n) a verified path, or None when the budget is spent without."""
        rng = np.random.default_rng(plan.seed)
        ompl = OmplPathSearch(self.ompl_workers, self.robot, self.scene, plan.options, plan.search, rng)
        return ompl.run(plan.judges[0], plan.start, plan.goals)

    @staticmethod
    def _unused(options: PlanOptions) -> Guidance:
        """What is said of a search that was over before guidance was asked for."""
        if options.sampler_id == "uniform" or options.uniform_fraction == 1.0:
            return Guidance("uniform")
        return Guidance("uniform", remark="a path was found before keypoints were needed")

    def _statistics(self, plan: PreparedPlan, guidance: Guidance) -> PlanStatistics:
        search = plan.search
        decomposition = self._decomposition
        return PlanStatistics(
            seed=plan.seed,
            total_seconds=search.budget.elapsed,
            decomposition_seconds=0.0 if decomposition is None else decomposition.timings.total_seconds,
            inference_seconds=guidance.seconds,
            first_solution_seconds=search.first_solution_seconds,
            verification_seconds=search.verification_seconds,
            samples=search.budget.samples,
            valid_samples=search.budget.valid_samples,
            nodes=search.nodes,
            edges_checked=search.budget.edges_checked,
            exact_checks=sum(judge.checks for judge in plan.judges) - plan.checks_before,
            cells=0 if decomposition is None else decomposition.cell_count,
            portals=0 if decomposition is None else decomposition.portal_count,
            candidates=0 if decomposition is None else decomposition.candidate_count,
        )
