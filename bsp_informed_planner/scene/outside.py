"""Obstacles that the decomposition does not see."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.scene.polytopes import polytopes_of_obstacle
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cylinder, Sphere


def obstacles_outside(scene: Scene) -> tuple[str, ...]:
    """Ids of the obstacles whose boxes along the axes lie wholly outside the workspace bounds.

    Collision checks see them like all others. The decomposition does not: no keypoints lead around them.

    Raises:
        InvalidObstacleError: if a shape has no volume.
    """
    outside = []
    for obstacle in scene.obstacles.values():
        if _is_seen_at_once(obstacle, scene.bounds):
            continue
        # A half-space that misses the bounds has no part at all.
        vertices = [part.vertices for part in polytopes_of_obstacle(obstacle, scene.bounds)]
        if vertices:
            points = np.concatenate(vertices)
            apart = (points.min(axis=0) > scene.bounds.upper) | (points.max(axis=0) < scene.bounds.lower)
            if not apart.any():
                continue
        outside.append(obstacle.id)
    return tuple(outside)


def _is_seen_at_once(obstacle: Obstacle, bounds: WorkspaceBounds) -> bool:
    """Whether the middle of a shape that surely is solid there lies within bounds, as of most obstacles it does."""
    rotation, origin = obstacle.pose.rotation, obstacle.pose.position
    for shape, pose in obstacle.shapes:
        if isinstance(shape, (Box, Sphere, Cylinder)):
            middle = origin + rotation @ pose.position
            if (middle >= bounds.lower).all() and (middle <= bounds.upper).all():
                return True
    return False


def outside_warning(scene: Scene) -> str:
    """A sentence about `obstacles_outside`; empty if there are none."""
    outside = obstacles_outside(scene)
    if not outside:
        return ""
    listed = ", ".join(f"'{name}'" for name in outside[:5]) + (f" and {len(outside) - 5} more" if outside[5:] else "")
    low, high = (np.array2string(corner, separator=", ") for corner in (scene.bounds.lower, scene.bounds.upper))
    return (
        f"{listed} wholly outside the workspace bounds {low} to {high} m: paths are checked against such obstacles, "
        "but keypoints do not lead around them; widen the bounds if the robot gets there, or mend a wrong unit or frame"
    )
