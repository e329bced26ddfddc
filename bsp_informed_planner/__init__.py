"""Collision-free, short paths for robot arms in cluttered spaces, by learning from local experience.

Importing the package loads neither ROS, nor torch, nor a viewer; each part is imported by its own name, e.g.
`from bsp_informed_planner.planning import Planner`.
"""

__version__ = "0.1.0"
