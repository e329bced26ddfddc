"""Markers for RViz and Foxglove: the decomposition and the plans.

Every array begins with a marker that deletes all earlier ones of its topic, so a change never leaves stale markers
behind; ids count from 0 in each namespace. Only message classes are imported here, nothing of rclpy.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Vector3
from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import Quaternion as QuaternionMsg
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.planning.grown_tree import GrownTree
from bsp_informed_planner.planning.path import interpolate, path_length
from bsp_informed_planner.planning.problem import PlanResult
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cylinder, PointCloud, Shape, Sphere
from bsp_informed_planner.visualization import palette
from bsp_informed_planner.visualization.cell_edges import cell_edges
from bsp_informed_planner.visualization.portals import portal_triangles
from bsp_informed_planner.visualization.shape_triangles import shape_triangles
from bsp_informed_planner.visualization.swept_arm import CoarseRobot

# Sizes: share of the longest edge of the workspace, or of the box around a path, the least and the greatest [m].
LINE_WIDTH = (0.001, 0.001, 0.01)
CANDIDATE_SIZE = (0.005, 0.004, 0.03)
PATH_WIDTH = (0.01, 0.003, 0.02)
# Between two points of a tool path in joint space [rad or m]; a long path has wider steps.
PATH_STEP, MOST_POINTS = 0.03, 1000
# Samples that are shown.
SAMPLES = 200
# Nodes of trees that are shown.
TREE_NODES = 3000


def decomposition_markers(scene: Scene, decomposition: Decomposition, stamp: Time) -> MarkerArray:
    """Markers of a scene and its decomposition, in the frame of the scene.

    Namespaces: "obstacles" (one marker a shape: cube, sphere, cylinder, the voxels of a point cloud as a cube list, or
    triangles), "cells" (the edges of free cells, a line list), "portals" (translucent triangles) and
    "keypoint_candidates" (a sphere list). What is empty is left out.

    Args:
        scene: the obstacles.
        decomposition: of this scene.
        stamp: of the scene.
    """
    header = Header(frame_id=scene.frame, stamp=stamp)
    extent = float((decomposition.bounds.upper - decomposition.bounds.lower).max())
    markers = [_delete_all(header)]
    placed = [item for obstacle in scene.obstacles.values() for item in obstacle.placed_shapes()]
    for index, (shape, pose) in enumerate(placed):
        markers.extend(_obstacle(header, index, shape, pose, scene.bounds))
    cells = _marker(header, "cells", 0, Marker.LINE_LIST, _size(LINE_WIDTH, extent), palette.CELL, 0.5)
    cells.points = _points(cell_edges(decomposition))
    portals = _marker(header, "portals", 0, Marker.TRIANGLE_LIST, 1.0, palette.PORTAL, 0.15)
    portals.points = _points(portal_triangles(decomposition, np.arange(decomposition.portal_count))[0])
    candidates = _marker(
        header, "keypoint_candidates", 0, Marker.SPHERE_LIST, _size(CANDIDATE_SIZE, extent), palette.KEYPOINT, 1.0
    )
    candidates.points = _points(decomposition.candidates)
    markers.extend(marker for marker in (cells, portals, candidates) if marker.points)
    return MarkerArray(markers=markers)


def plan_markers(robot: Robot, result: PlanResult) -> MarkerArray:
    """Markers of a plan, in the root frame of the robot, without a time: viewers take the newest transform.

    Namespaces: "path" (the way of the tool, a line strip coloured from start to goal), "waypoints" and "keypoints"
    (sphere lists), "start" and "goal" (a sphere each), "samples" (where the tool is in samples of the guidance),
    "trees" (where it is in the first nodes of the search's trees, if they were kept, a line list) and "swept_robot"
    (coarse hulls of the robot along the path, translucent triangles). What is empty is left out.
    """
    header = Header(frame_id=robot.root_frame)
    states = interpolate(result.path, max(PATH_STEP, path_length(result.path) / MOST_POINTS))
    tool = _tool_positions(robot, states)
    width = _size(PATH_WIDTH, float(np.ptp(tool, axis=0).max()))
    path = _marker(header, "path", 0, Marker.LINE_STRIP, width, palette.MIDDLE, 1.0)
    path.points = _points(tool)
    colours = palette.progress_colours(np.linspace(0.0, 1.0, len(tool)))
    path.colors = [ColorRGBA(r=r, g=g, b=b, a=1.0) for r, g, b in colours.tolist()]
    waypoints = _marker(header, "waypoints", 0, Marker.SPHERE_LIST, 2.0 * width, palette.MIDDLE, 1.0)
    waypoints.points = _points(_tool_positions(robot, result.path))
    keypoints = _marker(header, "keypoints", 0, Marker.SPHERE_LIST, 3.0 * width, palette.KEYPOINT, 1.0)
    keypoints.points = _points(result.guidance.keypoints)
    markers = [_delete_all(header), path, waypoints]
    if keypoints.points:
        markers.append(keypoints)
    for name, place, colour in (("start", tool[0], palette.START), ("goal", tool[-1], palette.GOAL)):
        end = _marker(header, name, 0, Marker.SPHERE, 4.0 * width, colour, 1.0)
        end.pose.position = _points(place)[0]
        markers.append(end)
    if result.guidance.sampler is not None:
        samples = _marker(header, "samples", 0, Marker.POINTS, width, palette.KEYPOINT, 0.5)
        drawn = result.guidance.sampler.sample(np.random.default_rng(result.statistics.seed), SAMPLES)
        samples.points = _points(_tool_positions(robot, drawn))
        markers.append(samples)
    trees = _marker(header, "trees", 0, Marker.LINE_LIST, 0.2 * width, palette.GRAPH, 0.6)
    trees.points = _points(_tree_edges(robot, result.trees))
    if trees.points:
        markers.append(trees)
    swept = _marker(header, "swept_robot", 0, Marker.TRIANGLE_LIST, 1.0, palette.MIDDLE, 0.2)
    swept.points = _points(CoarseRobot(robot).swept(states))
    if swept.points:
        markers.append(swept)
    return MarkerArray(markers=markers)


def _obstacle(header: Header, index: int, shape: Shape, pose: Pose, bounds: WorkspaceBounds) -> Iterable[Marker]:
    """The marker of a shape; none for a half-space that misses the bounds."""
    scale: tuple[float, float, float] | None = None
    kind = Marker.TRIANGLE_LIST
    if isinstance(shape, Box):
        kind, scale = Marker.CUBE, tuple(shape.size.tolist())
    elif isinstance(shape, Sphere):
        kind, scale = Marker.SPHERE, (2.0 * shape.radius,) * 3
    elif isinstance(shape, PointCloud):
        kind, scale = Marker.CUBE_LIST, (shape.resolution,) * 3
    elif isinstance(shape, Cylinder):
        kind, scale = Marker.CYLINDER, (2.0 * shape.radius, 2.0 * shape.radius, shape.height)
    marker = _marker(header, "obstacles", index, kind, 1.0, palette.FURNITURE, 0.9)
    if scale is not None:
        marker.scale = Vector3(x=scale[0], y=scale[1], z=scale[2])
        x, y, z, w = pose.quaternion.tolist()
        marker.pose = PoseMsg(position=_points(pose.position)[0], orientation=QuaternionMsg(x=x, y=y, z=z, w=w))
        if isinstance(shape, PointCloud):
            marker.points = _points(shape.voxel_centres)
        return [marker]
    marker.points = _points(shape_triangles(shape, pose, bounds))
    return [marker] if marker.points else []


def _tool_positions(robot: Robot, states: FloatArray) -> FloatArray:
    """(m, 3) positions of the tool frame in states (m, n), in the root frame [m]."""
    return np.array([robot.forward_kinematics(state).position for state in states])


def _tree_edges(robot: Robot, trees: Sequence[GrownTree]) -> FloatArray:
    """(2 e, 3) ends of edges between nodes and their parents, by the tool's places [m]."""
    ends = [np.empty((0, 3))]
    for tree in trees:
        shown = min(len(tree.nodes), TREE_NODES // len(trees))
        places = _tool_positions(robot, tree.nodes[:shown])
        children = np.flatnonzero((tree.parents[:shown] >= 0) & (tree.parents[:shown] < shown))
        if len(children):
            ends.append(np.stack((places[tree.parents[children]], places[children]), axis=1).reshape(-1, 3))
    return np.concatenate(ends)


def _delete_all(header: Header) -> Marker:
    return Marker(header=header, action=Marker.DELETEALL)


def _marker(
    header: Header, namespace: str, index: int, kind: int, size: float, colour: palette.Colour, alpha: float
) -> Marker:
    """A marker of one size and colour, which follows its frame when that moves."""
    red, green, blue = colour
    marker = Marker(header=header, ns=namespace, id=index, type=kind, action=Marker.ADD, frame_locked=True)
    marker.pose.orientation.w = 1.0
    marker.scale = Vector3(x=size, y=size, z=size)
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=alpha)
    return marker


def _points(places: FloatArray) -> list[Point]:
    """Places (..., 3) as messages, in order."""
    return [Point(x=x, y=y, z=z) for x, y, z in places.reshape(-1, 3).tolist()]


def _size(limits: tuple[float, float, float], extent: float) -> float:
    share, least, greatest = limits
    return min(max(share * extent, least), greatest)
