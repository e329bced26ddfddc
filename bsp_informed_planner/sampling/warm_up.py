"""Compiles the kernels of this part by a small problem."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.sampling.chain_repair import ChainRepair
from bsp_informed_planner.sampling.guidance import KeypointGuideOptions
from bsp_informed_planner.sampling.layers import nearest_windings, paths_through_layers, tool_orientations
from bsp_informed_planner.sampling.local_primitives import LocalPrimitives
from bsp_informed_planner.sampling.network_kernels import dense
from bsp_informed_planner.sampling.orientation_kernels import matrices_at
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds
from bsp_informed_planner.scene.signed_distance import SignedDistance


def warm_up() -> None:
    """A path of a point through one layer, orientations, the repair of a path where nothing is, a layer, two boxes."""
    robot, start, goals = PointRobot(), np.zeros(2), np.ones((1, 2))
    layer = nearest_windings(robot, np.array([[0.5, 0.5]]), start)
    paths_through_layers(robot, start, [layer], goals, lambda a, b: True, KeypointGuideOptions(), lambda: False)
    quaternion = np.array([0.0, 0.0, 0.0, 1.0])
    orientations = tool_orientations(quaternion, quaternion, np.array([1.0, 0.0, 0.0]), 0.5, KeypointGuideOptions())
    matrices_at(np.zeros(3), orientations)
    nothing = Scene.of([], WorkspaceBounds(-np.ones(3), np.ones(3)), robot.root_frame)
    ChainRepair(robot, nothing).pushed(np.array([[start, [0.2, 0.5], goals[0]]]))
    SignedDistance(nothing).at(np.zeros((1, 3)))
    dense(np.zeros((1, 2), np.float32), np.zeros((2, 2), np.float32), np.zeros(2, np.float32))
    boxes = LocalPrimitives(np.zeros((1, 2, 3)), np.ones((1, 2, 3)), np.broadcast_to(np.eye(3), (1, 2, 3, 3)))
    boxes.nearest_distances(boxes)
