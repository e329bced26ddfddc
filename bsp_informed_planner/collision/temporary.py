import os
import pickle

from bsp_informed_planner.collision.bounds import build_bounds


def bounds_of(robot):
    name = f"/tmp/w/core_bounds_{robot.name}_{robot.dof}_{getattr(robot, 'radius', 0)}.pickle"
    if os.path.exists(name):
        return pickle.load(open(name, "rb"))
    bounds = build_bounds(robot)
    pickle.dump(bounds, open(name, "wb"))
    return bounds
