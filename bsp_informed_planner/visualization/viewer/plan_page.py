"""The page of `bsp-planner view`: a robot, a scene, and a button that plans."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bsp_informed_planner.errors import BspPlannerError, PlanningCancelledError
from bsp_informed_planner.planning.growth import record_growth
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import Goal, JointGoal, PlanningProblem, PlanOptions
from bsp_informed_planner.sampling.guide import SAMPLER_IDS
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.shape_triangles import RobotMeshes
from bsp_informed_planner.visualization.viewer.cost_curve import CostCurve
from bsp_informed_planner.visualization.viewer.decomposition_layer import DecompositionLayer
from bsp_informed_planner.visualization.viewer.ends_layer import EndLayer
from bsp_informed_planner.visualization.viewer.motion_layer import MotionLayer
from bsp_informed_planner.visualization.viewer.plan_answer import PlanAnswer, PlanFunction, PlanQuestion
from bsp_informed_planner.visualization.viewer.robot_layer import base_nodes
from bsp_informed_planner.visualization.viewer.scene_layer import SceneLayer, section_of
from bsp_informed_planner.visualization.viewer.server import Viewer
from bsp_informed_planner.visualization.viewer.switches import add_legend
from bsp_informed_planner.visualization.viewer.tree_layer import TreeLayer

if TYPE_CHECKING:
    import viser

OPACITY = 0.6
# Time for trees that are only looked at [s].
GROWTH_SECONDS = 10.0


class PlanPage:
    """Start and goal, a button that plans from one to the other, and what came of it.

    Plans are made in a thread of their own, so that the page can be looked around in meanwhile.

    Attributes:
        scene, decomposition, start, goal, motion, tree, cost: the parts of the page.
        plan_button, stop_button, grow_button: what they say.
        ways: the ways to plan, by the name in the page.
    """

    def __init__(
        self,
        viewer: Viewer,
        planner: Planner,
        ways: dict[str, PlanFunction],
        start: FloatArray,
        goal: FloatArray,
        *,
        goals: Sequence[Goal] = (),
        options: PlanOptions | None = None,
        samplers: Sequence[str] = SAMPLER_IDS,
    ) -> None:
        """
        Args:
            viewer: the page, empty so far.
            planner: gives robot, scene, decomposition and checks.
            ways: at least one, the first is chosen at first.
            start, goal: (n,) where sliders are at first [rad or m].
            goals: what is planned to until somebody moves the goal, e.g. a pose that several configurations reach;
                none: to the goal.
            options: of plans at first; what the page has no control for stays so.
            samplers: ids to choose from.
        """
        self._viewer = viewer
        self._planner = planner
        self._options = options or PlanOptions()
        self.ways = ways
        self._goals = tuple(goals)
        self._work: threading.Thread | None = None
        self._cancel = threading.Event()
        robot, gui, decomposition = planner.robot, viewer.server.gui, planner.decomposition
        section = section_of(decomposition)
        meshes = RobotMeshes(robot)
        lower, upper = planner.scene.bounds.lower, planner.scene.bounds.upper

        gui.add_markdown(f"**{robot.name}** among {len(planner.scene.obstacles)} obstacles")
        with gui.add_folder("Plan"):
            self._way: viser.GuiDropdownHandle[str] = gui.add_dropdown("Through", tuple(ways))
            self._sampler: viser.GuiDropdownHandle[str] = gui.add_dropdown(
                "Samples", tuple(samplers), initial_value=self._options.sampler_id,
                hint="keypoint_tube: around a chain of keypoints; uniform: anywhere.",
            )  # fmt: skip
            self._seconds: viser.GuiSliderHandle[float] = gui.add_slider(
                "Seconds", 0.1, 20.0, 0.1, float(np.clip(self._options.allowed_seconds, 0.1, 20.0))
            )
            self.plan_button = gui.add_button("Plan")
            self.stop_button = gui.add_button("Stop planning", visible=False)
            self._text = gui.add_markdown("Choose start and goal below, and plan.")
            self.cost = CostCurve(viewer)
        with gui.add_folder("Motion"):
            extent = float((upper - lower).max())
            self.motion = MotionLayer(viewer, robot, meshes, start, extent)
        with gui.add_folder("Search trees", expand_by_default=False):
            self.grow_button = gui.add_button("Grow trees", hint="One run of RRT-Connect with these samples.")
            self.tree = TreeLayer(viewer, robot)
        ball = self.motion.ball
        self.start = EndLayer(viewer, "start", robot, meshes, planner.checker(), start, self._forget, ball)
        self.goal = EndLayer(viewer, "goal", robot, meshes, planner.checker(), goal, self._move_goal, ball)
        with gui.add_folder("Scene", expand_by_default=False):
            self.scene = SceneLayer(viewer, planner.scene, section=section, opacity=OPACITY if section is None else 1.0)
            self.decomposition = DecompositionLayer(viewer, decomposition, on=False)
        with gui.add_folder("What the colours mean", expand_by_default=False):
            add_legend(
                viewer,
                EndLayer.legend()
                + MotionLayer.legend()
                + TreeLayer.legend()
                + SceneLayer.legend(section is not None)
                + DecompositionLayer.legend(),
            )
        base = base_nodes(viewer, meshes)
        self.motion.show(None)
        self.plan_button.on_click(lambda _: self.plan())
        self.stop_button.on_click(lambda _: self.cancel())
        self.grow_button.on_click(lambda _: self.grow())
        low, high = self.scene.extent()
        if base or section is None:
            low, high = np.minimum(low, -0.2), np.maximum(high, 0.2)
        viewer.look_at(low, high, from_above=section is not None)

    @property
    def message(self) -> str:
        """What the page says about the last plan."""
        return str(self._text.content)

    @property
    def is_busy(self) -> bool:
        """Whether a plan is being made, or trees grow."""
        return self._work is not None and self._work.is_alive()

    def plan(self) -> None:
        """Begins to plan, as the button does; nothing if a plan is being made."""
        question = self._question(self._seconds.value)
        way = self.ways[self._way.value]

        def work(cancelled: Callable[[], bool]) -> str:
            begin = time.monotonic()
            answer = way(question, cancelled)
            seconds = time.monotonic() - begin
            # Of several goals, the one that the path leads to.
            if not np.array_equal(answer.path[-1], self.goal.configuration):
                self.goal.move(answer.path[-1])
            self.motion.show(answer)
            self.cost.show(answer.cost_seconds, answer.costs, seconds)
            return _about(answer, seconds)

        self._begin("planning ...", work)

    def grow(self) -> None:
        """Begins to grow trees, as the button does; nothing if a plan is being made."""
        question, said = self._question(GROWTH_SECONDS), self.message

        def work(cancelled: Callable[[], bool]) -> str:
            problem = PlanningProblem(question.start, question.goals)
            growth = record_growth(self._planner, problem, question.options, cancelled=cancelled)
            self.tree.show(growth)
            return said

        self._begin("growing trees ...", work)

    def cancel(self) -> None:
        """Ends what is going on, if it can be ended."""
        self._cancel.set()

    def close(self) -> None:
        """Ends all threads of the page."""
        self.cancel()
        self.motion.stop()
        if self._work is not None:
            self._work.join(timeout=5.0)

    def wait(self, seconds: float) -> bool:
        """Waits for the plan or the trees; whether they are done."""
        if self._work is not None:
            self._work.join(timeout=seconds)
        return not self.is_busy

    def _question(self, seconds: float) -> PlanQuestion:
        options = replace(self._options, sampler_id=self._sampler.value, allowed_seconds=seconds)
        goals = self._goals or (JointGoal(self.goal.configuration),)
        return PlanQuestion(self.start.configuration, goals, options)

    def _begin(self, said: str, work: Callable[[Callable[[], bool]], str]) -> None:
        with self._viewer.lock:
            if self.is_busy:
                return
            self._cancel = threading.Event()
            self._set_busy(True)
            self._text.content = said
            self._work = threading.Thread(target=self._run, args=(work, self._cancel), daemon=True)
            self._work.start()

    def _run(self, work: Callable[[Callable[[], bool]], str], cancel: threading.Event) -> None:
        try:
            said = work(cancel.is_set)
        except PlanningCancelledError:
            said = "Stopped."
        except BspPlannerError as error:
            said = f"**No plan**: {error}"
        with self._viewer.lock:
            self._text.content = said
            self._set_busy(False)

    def _set_busy(self, busy: bool) -> None:
        self.plan_button.disabled = self.grow_button.disabled = busy
        self.stop_button.visible = busy

    def _move_goal(self) -> None:
        self._goals = ()
        self._forget()

    def _forget(self) -> None:
        """A plan between other configurations is none between these."""
        with self._viewer.lock:
            self.motion.show(None)
            self.tree.show(None)
            self.cost.show(np.empty(0), np.empty(0), 0.0)
            if not self.is_busy:
                self._text.content = ""


def _about(answer: PlanAnswer, seconds: float) -> str:
    proof = "certified" if answer.certified else "checked"
    lines = [
        f"**{proof} path** of cost {answer.cost:.3f}, {len(answer.path)} waypoints, {answer.times[-1]:.2f} s long",
        f"{len(answer.keypoints)} keypoints; planned in {seconds:.2f} s"
        + (f", first path after {1e3 * answer.cost_seconds[0]:.0f} ms" if len(answer.cost_seconds) else ""),
    ]
    if answer.remark:
        lines.append(f"Fell back: {answer.remark}")
    return "\n\n".join(lines)
