"""Start and goal configurations that are set by sliders in a page."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.palette import GOAL, START, WALL, Colour
from bsp_informed_planner.visualization.shape_triangles import RobotMeshes
from bsp_informed_planner.visualization.viewer.robot_layer import RobotLayer
from bsp_informed_planner.visualization.viewer.server import Viewer, set_value
from bsp_informed_planner.visualization.viewer.switches import LegendEntry, Switch

if TYPE_CHECKING:
    import viser

COLLIDING: Colour = WALL
GHOST_OPACITY = 0.45


class EndLayer:
    """The robot in one configuration, with a slider for each joint; dark where it collides.

    Attributes:
        robot: what is shown and hidden.
        sliders: one for each joint [rad or m].
        is_free: whether the configuration is free of collision.
    """

    is_free: bool

    def __init__(
        self,
        viewer: Viewer,
        name: str,
        robot: Robot,
        meshes: RobotMeshes,
        checker: ExactChecker,
        configuration: FloatArray,
        on_change: Callable[[], None],
        ball: float,
    ) -> None:
        """
        Args:
            viewer: the page.
            name: "start" or "goal".
            robot: whose joints these are.
            meshes: of the robot.
            checker: of its own, tells what is free.
            configuration: (n,) within the limits [rad or m].
            on_change: called after somebody has moved a slider.
            ball: radius of the ball at the tool [m].
        """
        self._viewer = viewer
        self._checker = checker
        self._colour = START if name == "start" else GOAL
        gui = viewer.server.gui
        self._on_change = on_change
        configuration = np.clip(configuration, robot.lower, robot.upper)
        self._robot = RobotLayer(
            viewer, name, robot, meshes, configuration, self._colour, opacity=GHOST_OPACITY, ball=ball
        )
        with gui.add_folder(name.capitalize(), expand_by_default=False):
            self.robot = Switch(viewer, f"Robot at the {name}")
            self.robot.replace(list(self._robot.nodes))
            self.sliders: list[viser.GuiSliderHandle[float]] = [
                gui.add_slider(joint, float(low), float(high), max(float(high - low) / 2000.0, 1e-4), float(value))
                for joint, low, high, value in zip(
                    robot.joint_names, robot.lower, robot.upper, configuration, strict=True
                )
            ]
            self._text = gui.add_markdown("")
        # Sliders are rounded; who leaves them alone gets the configuration as it was given.
        self._configuration = configuration
        self._is_moving = False
        for slider in self.sliders:
            slider.on_update(lambda _: self._moved())
        self._check()

    @staticmethod
    def legend() -> list[LegendEntry]:
        """What its colours mean."""
        return [
            LegendEntry(START, "robot at the start"),
            LegendEntry(GOAL, "robot at the goal"),
            LegendEntry(COLLIDING, "robot at a start or goal in collision"),
        ]

    @property
    def configuration(self) -> FloatArray:
        """(n,) [rad or m]."""
        return self._configuration.copy()

    def move(self, configuration: FloatArray) -> None:
        """Puts robot and sliders into a configuration (n,) [rad or m], without telling anybody."""
        with self._viewer.lock:
            self._is_moving = True
            try:
                for slider, value in zip(self.sliders, configuration.tolist(), strict=True):
                    set_value(slider, value)
            finally:
                self._is_moving = False
            self._configuration = configuration.copy()
            self._check()

    def _moved(self) -> None:
        with self._viewer.lock:
            if self._is_moving:
                return
            self._configuration = np.array([slider.value for slider in self.sliders], dtype=np.float64)
            self._check()
        self._on_change()

    def _check(self) -> None:
        """Shows the configuration, and says whether it is free."""
        self.is_free = bool(self._checker.is_free(self._configuration))
        self._robot.move(self._configuration)
        self._robot.paint(self._colour if self.is_free else COLLIDING)
        self._text.content = "" if self.is_free else "**In collision**: move a slider, or no plan begins or ends here."
