"""A robot that moves along a planned path, in a page."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

import numpy as np

from bsp_informed_planner.planning.path import interpolate, path_length
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.palette import CANDIDATE, KEYPOINT, MIDDLE
from bsp_informed_planner.visualization.shape_triangles import RobotMeshes
from bsp_informed_planner.visualization.viewer.chain_layer import polyline_nodes
from bsp_informed_planner.visualization.viewer.plan_answer import PlanAnswer
from bsp_informed_planner.visualization.viewer.robot_layer import RobotLayer
from bsp_informed_planner.visualization.viewer.server import Viewer, rgb, set_value
from bsp_informed_planner.visualization.viewer.switches import LegendEntry, Switch
from bsp_informed_planner.visualization.viewer.tree_layer import tool_positions

if TYPE_CHECKING:
    import viser

# Between two points of the way of the tool, in joint space [rad or m]; long paths have so many points.
PATH_STEP, MOST_POINTS = 0.03, 1000
# Pictures a second while it plays, and how much of the workspace a dot has.
FRAMES, DOT = 25.0, 0.012


class MotionLayer:
    """The way of the tool, the keypoints and samples that led to it, and the robot on its way at a time of a slider.

    Attributes:
        robot: the robot that moves; way, keypoints, samples: what else is shown and hidden.
        ball: radius of the ball at the tool [m].
        slider: time [s].
        play: starts and stops the motion.
    """

    def __init__(self, viewer: Viewer, robot: Robot, meshes: RobotMeshes, start: FloatArray, extent: float) -> None:
        """
        Args:
            viewer: the page.
            robot: what moves.
            meshes: of the robot.
            start: (n,) where it is before there is a path.
            extent: of the scene, for the sizes of dots [m].
        """
        self._viewer = viewer
        self._robot_model = robot
        self._dot = DOT * extent
        self.ball = 0.6 * self._dot
        self._answer: PlanAnswer | None = None
        self._moving = RobotLayer(viewer, "moving", robot, meshes, start, MIDDLE, ball=self.ball)
        self.robot = Switch(viewer, "Robot on its way")
        self.robot.replace(self._moving.nodes)
        self.way = Switch(viewer, "Way of the tool")
        self.keypoints = Switch(viewer, "Keypoints")
        self.samples = Switch(
            viewer,
            "Samples",
            on=False,
            hint="The tool in samples around the keypoints, as the planner draws them.",
        )
        gui = viewer.server.gui
        self.slider: viser.GuiSliderHandle[float] = gui.add_slider("Time [s]", 0.0, 1.0, 0.01, 0.0, disabled=True)
        self.play = gui.add_button("Play", disabled=True)
        self.slider.on_update(lambda _: self._move())
        self.play.on_click(lambda _: self._toggle())
        self._stop = threading.Event()
        self._player: threading.Thread | None = None

    @staticmethod
    def legend() -> list[LegendEntry]:
        """What its colours mean."""
        return [
            LegendEntry(MIDDLE, "robot on its way, and the way of its tool from blue to red"),
            LegendEntry(KEYPOINT, "keypoints that guided the search", "dot"),
            LegendEntry(CANDIDATE, "samples around the keypoints, by the tool", "dot"),
        ]

    @property
    def configuration(self) -> FloatArray | None:
        """(n,) of the robot that moves; None without a path."""
        if self._answer is None:
            return None
        times, positions = self._answer.times, self._answer.positions
        return np.array([np.interp(self.slider.value, times, positions[:, j]) for j in range(positions.shape[1])])

    @property
    def is_playing(self) -> bool:
        """Whether the time runs."""
        return self._player is not None and self._player.is_alive()

    def show(self, answer: PlanAnswer | None) -> None:
        """Shows a plan from its beginning; None: no plan."""
        self.stop()
        with self._viewer.lock:
            self._answer = answer
            self.slider.disabled = self.play.disabled = answer is None
            if answer is None:
                for switch in (self.way, self.keypoints, self.samples):
                    switch.replace([])
                self.robot.hide(True)
                return
            states = interpolate(answer.path, max(PATH_STEP, path_length(answer.path) / MOST_POINTS))
            tool = tool_positions(self._robot_model, states)
            self.way.replace(polyline_nodes(self._viewer, "/plan/way", tool, thickness=4.0))
            places = tool_positions(self._robot_model, answer.samples)
            for switch, name, points, colour, size in (
                (self.keypoints, "keypoints", answer.keypoints, KEYPOINT, 2.0 * self._dot),
                (self.samples, "samples", places, CANDIDATE, 0.5 * self._dot),
            ):
                switch.replace(
                    [
                        self._viewer.server.scene.add_point_cloud(
                            f"/plan/{name}", points, rgb(colour), point_size=size, point_shape="circle",
                            precision="float32", point_shading="flat",
                        )
                    ]
                    if len(points)
                    else []
                )  # fmt: skip
            self.slider.max = max(float(answer.times[-1]), 0.01)
            set_value(self.slider, 0.0)
            self._move()
            self.robot.hide(False)

    def stop(self) -> None:
        """Stops the motion where it is."""
        self._stop.set()
        player, self._player = self._player, None
        if player is not None and player is not threading.current_thread():
            player.join(timeout=2.0)
        self.play.label = "Play"

    def _move(self) -> None:
        configuration = self.configuration
        if configuration is not None:
            self._moving.move(configuration)

    def _toggle(self) -> None:
        if self.is_playing:
            self.stop()
            return
        self._stop = threading.Event()
        self._player = threading.Thread(target=self._run, args=(self._stop,), daemon=True)
        self.play.label = "Stop"
        self._player.start()

    def _run(self, stop: threading.Event) -> None:
        end = float(self.slider.max)
        begin = self.slider.value if self.slider.value < end - 1e-3 else 0.0
        since = time.monotonic()
        while not stop.wait(1.0 / FRAMES):
            now = begin + time.monotonic() - since
            set_value(self.slider, min(now, end))
            if now >= end:
                self.play.label = "Play"
                return
