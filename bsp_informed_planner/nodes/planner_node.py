"""The planner node: answers `plan` and `plan_motion` with verified, timed paths."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace

from bsp_informed_planner_msgs.action import PlanMotion
from bsp_informed_planner_msgs.msg import PlanRequest, PlanResponse
from bsp_informed_planner_msgs.srv import GetPlannerInfo, Plan
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.qos import qos_profile_sensor_data
from rclpy.task import Future
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from bsp_informed_planner.errors import NO_MODEL, BspPlannerError, PlanningCancelledError
from bsp_informed_planner.nodes.error_codes import ErrorCode, error_code
from bsp_informed_planner.nodes.failure_records import FailureRecords
from bsp_informed_planner.nodes.gated_group import GatedGroup
from bsp_informed_planner.nodes.joint_state_cache import JointStateCache
from bsp_informed_planner.nodes.lifecycle import PlannerSuiteNode, run
from bsp_informed_planner.nodes.meter import Meter
from bsp_informed_planner.nodes.newest_first import NewestFirstWorker
from bsp_informed_planner.nodes.own_thread import Reply
from bsp_informed_planner.nodes.plan_conversions import (
    changes_from_msg,
    options_from_msg,
    problem_from_msg,
    response_from_result,
)
from bsp_informed_planner.nodes.plan_jobs import PlanJobs
from bsp_informed_planner.nodes.planner_info import describe_robot, first_of
from bsp_informed_planner.nodes.planner_parameters import PlannerParameters
from bsp_informed_planner.nodes.qos import LATCHED, SERVICES
from bsp_informed_planner.nodes.remote_guidance import InferenceUnavailableError, RemoteGuide
from bsp_informed_planner.nodes.robot_preparation import RobotPreparation
from bsp_informed_planner.nodes.robot_source import RobotSource
from bsp_informed_planner.nodes.world import World, WorldTracker
from bsp_informed_planner.planning.planner import Planner, PreparedPlan
from bsp_informed_planner.planning.problem import PLANNER_IDS, JointGoal, PlanningProblem, PlanOptions, PlanResult
from bsp_informed_planner.planning.search import Progress
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import Guidance
from bsp_informed_planner.sampling.guide import EXACT, GUIDES, SAMPLER_IDS
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.visualization.markers import plan_markers

logger = logging.getLogger(__name__)

#: How long a plan waits for a scene revision that its client has heard of before this node has [s].
SCENE_PATIENCE = 1.0
#: Time of the plan that a new robot is tried out with [s].
WARM_UP_SECONDS = 1.0
#: Between two sets of markers [s].
MARKER_PERIOD = 0.1
#: How long the result of an action is kept for a client that has not asked for it yet [s].
RESULT_TIMEOUT = 30
#: How long a node that is cleaned up waits for its last answers to be made, and then for the last to be sent [s].
ANSWER_SECONDS, SENDING_SECONDS = 5.0, 0.25
#: Head start of an answer before others are told of the plan [s]: all of it goes through one interpreter.
ANSWER_FIRST = 0.005
#: Most plans that others have yet to be told of: then answers wait.
MOST_UNTOLD = 100


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer to a request, and the plan that it tells of, or why there is none."""

    response: PlanResponse
    plan: tuple[Robot, PlanResult] | None = None
    error: Exception | None = None


class PlannerNode(PlannerSuiteNode):
    """Serves `plan` and `plan_motion`; publishes `trajectory` and `plan_markers` of each plan that succeeds.

    Plans run in worker threads, which answer by themselves. Requests and scenes come in through threads of their own,
    which only hand them over, so the scene can change while plans run: each is made, and checked, for the revision that
    was in force when it began.
    """

    def __init__(self, **options: object) -> None:
        super().__init__("planner_node", **options)

    def setup(self) -> None:
        self._parameter_set = self.follow_parameters(PlannerParameters, self._on_parameters)
        self._defaults = self._settings.plan_options()
        self._joints = JointStateCache(self._settings.joint_state_max_age)
        self._failures = 0
        self._in_flight = 0
        self._counting = threading.Lock()
        # Of these the goals, and when one was last taken, or answered.
        self._goals = 0
        self._last_goal = -SENDING_SECONDS
        self._records = FailureRecords(self._settings.save_problem_on_failure)
        self._plans = Meter()
        self._world = WorldTracker(self, self._settings.allow_empty_scene)
        self.release_with(self._world.close)
        # Robots and default sampler ids whose models have been asked for, and those that have been found to have none.
        # Replaced as wholes: several threads read and write them.
        self._asked_for_model: frozenset[tuple[str, str]] = frozenset()
        self._without_model: frozenset[tuple[str, str]] = frozenset()
        preparation = RobotPreparation(self._world, self._try_out, self.note_error)
        self.release_with(preparation.close)
        self._robot_source = RobotSource(self, self._settings, preparation.submit, self.note_error)
        self.release_with(self._robot_source.close)
        self._guide = RemoteGuide(self, self._settings.inference_timeout)
        self.release_with(self._guide.close)
        self._trajectory_publisher = self.create_publisher(JointTrajectory, "trajectory", LATCHED)
        self.release_with(self.destroy_publisher, self._trajectory_publisher)
        self._marker_publisher = self.create_publisher(MarkerArray, "plan_markers", LATCHED)
        self.release_with(self.destroy_publisher, self._marker_publisher)
        self._markers = NewestFirstWorker(self._publish_markers, "markers", pause=MARKER_PERIOD)
        self.release_with(self._markers.stop)
        self._publications = ThreadPoolExecutor(1, "publications")
        self.release_with(self._publications.shutdown)
        self._untold = threading.BoundedSemaphore(MOST_UNTOLD)
        self._jobs: PlanJobs[Answer] = PlanJobs(self._settings.workers, self._settings.queue_size)
        gate = GatedGroup()
        action = ActionServer(
            self,
            PlanMotion,
            "plan_motion",
            self._on_plan_motion,
            callback_group=gate,
            goal_callback=self._on_goal,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            result_timeout=RESULT_TIMEOUT,
            goal_service_qos_profile=SERVICES,
            result_service_qos_profile=SERVICES,
            cancel_service_qos_profile=SERVICES,
        )
        self.release_with(action.destroy)
        self.release_with(gate.close, SENDING_SECONDS)
        gate.open()
        if self.executor is not None:
            self.executor.wake()
        requests = self.own_thread("requests")
        requests.subscribe(JointState, "joint_states", lambda m, _: self._joints.take(m), qos_profile_sensor_data)
        requests.serve(Plan, "plan", self._on_plan, SERVICES)
        requests.serve(GetPlannerInfo, "get_planner_info", self._on_get_planner_info, SERVICES)
        # Released first: every request is answered while the services are still there.
        self.release_with(self._finish_jobs)

    @property
    def _settings(self) -> PlannerParameters:
        return self._parameter_set.values

    def _on_parameters(self, settings: PlannerParameters) -> None:
        self._defaults = settings.plan_options()
        self._world.allow_empty_scene = settings.allow_empty_scene
        self._joints.max_age = settings.joint_state_max_age
        self._guide.timeout = settings.inference_timeout

    def _finish_jobs(self) -> None:
        """Cancel what runs and waits, and let the executor send the results of the action."""
        self._jobs.stop()
        end = time.monotonic() + ANSWER_SECONDS
        # A goal that was taken begins a little later, and its answer is sent right after its coroutine has ended, by a
        # thread that may have to wait for a core.
        while self.context.ok() and (now := time.monotonic()) < end:
            if not self._goals and now >= self._last_goal + SENDING_SECONDS:
                return
            time.sleep(0.01)

    def diagnostic_values(self) -> dict[str, object]:
        return {
            "scene_epoch": self._world.epoch,
            "scene_revision": self._world.revision,
            "robot": self._world.robot_name,
            "preparation": self._world.preparation,
            "model": self._settings.sampler_id,
            "plans_in_flight": self._in_flight,
            "failures": self._failures,
            **self._plans.values("plans"),
        }

    def _on_get_planner_info(self, request: GetPlannerInfo.Request, reply: Reply) -> None:
        settings, response = self._settings, GetPlannerInfo.Response()
        response.planner_ids = first_of(settings.planner_id, PLANNER_IDS)
        lacking = {sampler for robot, sampler in self._without_model if robot == self._world.robot_name}
        response.sampler_ids = [name for name in first_of(settings.sampler_id, SAMPLER_IDS) if name not in lacking]
        response.models = [name for name in GUIDES if name not in lacking]
        response.default_planning_time, response.max_planning_time = (
            settings.allowed_planning_time,
            settings.max_seconds,
        )
        response.workers, response.queue_size = settings.workers, settings.queue_size
        response.plans_in_flight = self._in_flight
        response.scene_epoch, response.scene_revision = self._world.epoch, self._world.revision
        try:
            describe_robot(self._world.robot, response)
            response.error_code = int(ErrorCode.SUCCESS)
        except Exception as error:  # noqa: BLE001 -- every request gets an answer
            response.error_code, response.message = int(error_code(error)), str(error)
        reply(response)

    def _on_plan(self, request: Plan.Request, reply: Reply) -> None:
        def answer(made: Answer) -> None:
            reply(Plan.Response(response=made.response))
            self._tell_of(made)
            self._count_in_flight(-1)

        self._count_in_flight(1)
        self._submit(request.request, answer, lambda: False, None)

    def _on_goal(self, _: PlanMotion.Goal) -> GoalResponse:
        """Take any goal, whose result says what is wrong with it, unless the node may be gone before it is asked."""
        if self._jobs.is_stopping:
            return GoalResponse.REJECT
        self._last_goal = time.monotonic()
        return GoalResponse.ACCEPT

    async def _on_plan_motion(self, goal: ServerGoalHandle) -> PlanMotion.Result:
        def on_progress(progress: Progress) -> None:
            goal.publish_feedback(
                PlanMotion.Feedback(
                    phase=progress.phase,
                    elapsed_seconds=progress.elapsed_seconds,
                    best_cost=progress.best_cost or 0.0,
                    samples=progress.samples,
                )
            )

        future = Future(executor=self.executor)

        def answer(made: Answer) -> None:
            future.set_result(made.response)
            self.executor.wake()
            # After the answer: who tells others may be kept by them.
            self._tell_of(made)

        self._count_in_flight(1, is_goal=True)
        try:
            self._submit(goal.request.request, answer, lambda: bool(goal.is_cancel_requested), on_progress)
            response: PlanResponse = await future
        finally:
            self._count_in_flight(-1, is_goal=True)
        if response.error_code == ErrorCode.SUCCESS:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        return PlanMotion.Result(response=response)

    def _count_in_flight(self, change: int, is_goal: bool = False) -> None:
        with self._counting:
            self._in_flight += change
            if is_goal:
                self._goals += change
                self._last_goal = time.monotonic()

    def _submit(
        self,
        request: PlanRequest,
        answer: Callable[[Answer], None],
        cancelled: Callable[[], bool],
        on_progress: Callable[[Progress], None] | None,
    ) -> None:
        """Have the answer to a request made, and given, in a worker thread."""

        def ended() -> bool:
            return cancelled() or self._jobs.is_stopping

        self._jobs.submit(
            lambda: self._plan(request, ended, on_progress),
            lambda error: self._refusal(error, request, None),
            answer,
            cancelled,
        )

    def _plan(
        self, request: PlanRequest, cancelled: Callable[[], bool], on_progress: Callable[[Progress], None] | None
    ) -> Answer:
        """One plan, in a worker thread. Never raises."""
        begin = time.monotonic()
        try:
            return self._answer(request, cancelled, on_progress)
        finally:
            self._plans.count(time.monotonic() - begin)

    def _answer(
        self, request: PlanRequest, cancelled: Callable[[], bool], on_progress: Callable[[Progress], None] | None
    ) -> Answer:
        world = problem = options = plan = None
        try:
            self.require_active()
            if cancelled():
                raise PlanningCancelledError
            situation = self._world.situation(
                int(request.scene_epoch), int(request.scene_revision), SCENE_PATIENCE, cancelled
            )
            options = options_from_msg(request, self._defaults, self._settings.max_seconds)
            begin = time.monotonic()
            end = begin + options.allowed_seconds
            world = self._world.make(situation, options.allowed_seconds, cancelled)
            world = world.changed(
                changes_from_msg(request), lambda robot: self._world.bounds_of(robot, end - time.monotonic(), cancelled)
            )
            problem = problem_from_msg(request, world.robot, self._joints.recent())
            if not self._settings.use_inference:
                world.planner.load_guide(options.sampler_id)
            # What the robot holds is worked on, if it is new, in the time of the plan.
            spent = time.monotonic() - begin
            plan = world.planner.prepare(
                problem, options, cancelled=cancelled, on_progress=on_progress, spent_seconds=spent
            )
            # Guidance is asked for only if a short search without any finds no path.
            result = world.planner.solve(plan, lambda: self._guidance(world, plan, cancelled))
        except Exception as error:  # noqa: BLE001 -- every request gets an answer
            saved = self._records.save(error, world, problem, options, None if plan is None else plan.seed)
            if saved is not None:
                self.get_logger().info(f"problem saved: bsp-planner plan {saved}")
            return self._refusal(error, request, world)
        response = response_from_result(result, world.robot)
        response.scene_epoch = world.epoch
        response.error_code = int(ErrorCode.SUCCESS)
        response.message = self._summary(result)
        return Answer(response, (world.robot, result))

    def _tell_of(self, answer: Answer) -> None:
        """Have others told of an answer, in the order of answers."""
        self._untold.acquire()
        # Of a node that is being cleaned up, the answer is all that is left to give.
        with suppress(RuntimeError):
            self._publications.submit(self._tell, answer, time.monotonic() + ANSWER_FIRST)
            return
        self._untold.release()

    def _tell(self, answer: Answer, begin: float) -> None:
        """In a thread of its own: to the log, and to those who look on."""
        self._untold.release()
        time.sleep(max(begin - time.monotonic(), 0.0))
        if answer.plan is None:
            self._log_refusal(answer)
            return
        self.get_logger().info(answer.response.message)
        try:
            self._trajectory_publisher.publish(answer.response.trajectory)
        except Exception as error:  # noqa: BLE001 -- the next one may be published
            self.note_error(f"trajectory: {error}")
        if self._settings.publish_markers:
            self._markers.submit(answer.plan)
        self._ask_for_default_model(*answer.plan)

    def _publish_markers(self, item: tuple[Robot, PlanResult]) -> None:
        """In a thread of their own, when the answer is on its way: markers are for people."""
        try:
            self._marker_publisher.publish(plan_markers(*item))
        except Exception as error:  # noqa: BLE001 -- the worker must go on
            self.note_error(f"plan_markers: {error}")

    def _guidance(self, world: World, plan: PreparedPlan, cancelled: Callable[[], bool]) -> Guidance:
        """From the inference node; else exact keypoints found here; else uniform. The answer says which and why."""
        sampler_id = plan.options.sampler_id
        if sampler_id == "uniform" or not self._settings.use_inference:
            return world.planner.guide(plan)
        if world.is_changed:
            guidance = world.planner.guide(plan, EXACT)
            if sampler_id == EXACT:
                return guidance
            return _with_reason(guidance, "the inference node does not know the scene with the request's changes")
        plan.search.report("guidance")
        try:
            guidance = self._guide.guide(
                sampler_id,
                plan.start,
                plan.goals,
                world.epoch,
                world.revision,
                plan.seed or 1,
                0.5 * plan.budget.remaining,
                cancelled,
            )
        except InferenceUnavailableError as error:
            # Networks are the inference node's: loading them here would take longer than the plan.
            local = world.planner.guide(plan, EXACT)
            if not local.fallback_reason:
                local = replace(local, fallback_reason="keypoints were found in the planner node")
            guidance = _with_reason(local, str(error))
            self.get_logger().warning(guidance.fallback_reason)
            return guidance
        if guidance.fallback_reason.startswith(f"{sampler_id}: {NO_MODEL}"):
            self._note_without_model(world.robot, sampler_id, guidance.fallback_reason)
        return guidance

    def _ask_for_default_model(self, robot: Robot, result: PlanResult) -> None:
        """After the first plan: easy ones need no guidance, so nobody else would find out that there is no model."""
        sampler_id = self._settings.sampler_id
        entry = robot.name, sampler_id
        if not self._settings.use_inference or sampler_id in ("uniform", EXACT) or entry in self._asked_for_model:
            return
        if self._guide.ask_for_model(
            sampler_id, result.path[[0, -1]], lambda reason: self._note_without_model(robot, sampler_id, reason)
        ):
            self._asked_for_model |= {entry}

    def _note_without_model(self, robot: Robot, sampler_id: str, reason: str) -> None:
        """Say once that keypoints are exact though another sampler is asked for, and list it no more."""
        if (robot.name, sampler_id) not in self._without_model:
            self._without_model |= {(robot.name, sampler_id)}
            self.get_logger().warning(f"{reason}; keypoints are exact")

    def _try_out(self, planner: Planner, problem: ScenarioProblem) -> None:
        """One plan of a robot that is new, with guidance: the next is as fast as it can be."""
        settings = self._settings
        # Of another robot of this name, perhaps.
        name = planner.robot.name
        self._without_model = frozenset(entry for entry in self._without_model if entry[0] != name)
        self._asked_for_model = frozenset(entry for entry in self._asked_for_model if entry[0] != name)
        if not settings.use_inference and (reason := planner.load_guide(settings.sampler_id)):
            self._note_without_model(planner.robot, settings.sampler_id, reason)
        planner.get_ready()
        goals = [JointGoal(goal) for goal in problem.goals]
        options = PlanOptions("rrt_star", EXACT, allowed_seconds=WARM_UP_SECONDS, first_solution=True, seed=1)
        planner.plan(PlanningProblem(problem.start, goals), options)

    def _summary(self, result: PlanResult) -> str:
        seconds = result.statistics.total_seconds
        remark = f"; {result.guidance.remark}" if result.guidance.remark else ""
        return (
            f"path of cost {result.cost:.3f} verified on scene {result.scene_revision} after {seconds:.2f} s, "
            f"{len(result.path)} waypoints, {result.trajectory.duration:.2f} s long{remark}"
        )

    def _log_refusal(self, answer: Answer) -> None:
        if isinstance(answer.error, PlanningCancelledError):
            self.get_logger().info(str(answer.error))
        else:
            self.note_error(f"{ErrorCode(answer.response.error_code).name}: {answer.error}")
        if not isinstance(answer.error, BspPlannerError):
            logger.error("while planning", exc_info=answer.error)

    def _refusal(self, error: Exception, request: PlanRequest, world: World | None) -> Answer:
        self._failures += 1
        response = PlanResponse(
            error_code=int(error_code(error)),
            message=str(error),
            planner_id=request.planner_id or self._defaults.planner_id,
            sampler_id=request.sampler_id or self._defaults.sampler_id,
            scene_epoch=self._world.epoch if world is None else world.epoch,
            scene_revision=self._world.revision if world is None else world.revision,
        )
        return Answer(response, error=error)


def _with_reason(guidance: Guidance, reason: str) -> Guidance:
    """Guidance that is not what was asked for."""
    return replace(guidance, fallback_reason="; ".join(filter(None, (reason, guidance.fallback_reason))))


def main(args: list[str] | None = None) -> None:
    """Entry point of `planner_node`."""
    run(PlannerNode, args)


if __name__ == "__main__":
    main()
