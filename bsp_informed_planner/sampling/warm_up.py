"""Compiles the kernels of this part by a small problem."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.sampling.chain_repair import ChainRepair
from bsp_informed_planner.sampling.guidance import KeypointGuideOptions
from bsp_informed_planner.sampling.layers import nearest_windings, paths_through_layers
from bsp_informed_planner.sampling.local_primitives import LocalPrimitives
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds


def warm_up() -> None:
    """A path of a point through one layer, the repair of one where there is nothing to repair, a pair of boxes."""
    robot, start, goals = PointRobot(), np.zeros(2), np.ones((1, 2))
    layer = nearest_windings(robot, np.array([[0.5, 0.5]]), start)
    paths_through_layers(robot, start, [layer], goals, lambda a, b: True, KeypointGuideOptions(), lambda: False)
    nothing = Scene.of([], WorkspaceBounds(-np.ones(3), np.ones(3)), robot.root_frame)
    ChainRepair(robot, nothing).pushed(np.array([[start, [0.2, 0.5], goals[0]]]))
    boxes = LocalPrimitives(np.zeros((1, 2, 3)), np.ones((1, 2, 3)), np.broadcast_to(np.eye(3), (1, 2, 3, 3)))
    boxes.nearest_distances(boxes)
