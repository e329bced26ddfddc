"""A picture of an arm that moves along a path."""

from __future__ import annotations

import math
import os
from dataclasses import replace

import numpy as np
from matplotlib.artist import Artist

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.planning.path import interpolate, path_length
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.visualization import overlay
from bsp_informed_planner.visualization.camera import Camera
from bsp_informed_planner.visualization.obstacle_layers import (
    aligned_azimuth,
    best_view,
    obstacle_bodies,
    obstacle_layers,
    points_to_fit,
)
from bsp_informed_planner.visualization.palette import (
    BASE,
    FURNITURE,
    GOAL,
    KEYPOINT,
    MIDDLE,
    PORTAL,
    START,
    progress_colours,
)
from bsp_informed_planner.visualization.portals import keypoint_portals, portal_layer
from bsp_informed_planner.visualization.renderer import Layer
from bsp_informed_planner.visualization.shape_triangles import RobotMeshes
from bsp_informed_planner.visualization.triangle_mesh import TriangleMesh

# Of the poses between start and goal.
GHOST_ALPHA, GHOST_EDGE_ALPHA = 0.26, 0.30
# Surfaces of the arm at start and goal that are nearer to each other than this coincide [m].
COINCIDENCE = 0.004
# The tool path is drawn through points no further apart than this in joint space [rad or m].
PATH_STEP = 0.03


def draw_arm_plan(
    path_png: str | os.PathLike[str],
    robot: Robot,
    scene: Scene,
    path: FloatArray,
    keypoints: FloatArray,
    *,
    decomposition: Decomposition | None = None,
    title: str = "",
    intermediate_poses: int = 5,
    size: tuple[int, int] = (1600, 900),
) -> None:
    """Writes a picture (PNG) of an arm that moves along a path, seen obliquely and from the side.

    The arm is solid at start and goal and translucent in between, its colour telling the progress. Obstacles that would
    hide the arm or the way of its tool are drawn as if of glass; everything else hides what is behind it.

    Args:
        path_png: file to write; folders are made.
        robot: the arm, drawn by its collision geometry.
        scene: the obstacles, in the root frame of the robot.
        path: (m, n) configurations, straight edges between them.
        keypoints: (k, 3) keypoints in the workspace, start and goal left out [m]; k may be 0.
        decomposition: of the scene; its portals that hold the keypoints are drawn.
        title: of the picture; the robot's name if empty.
        intermediate_poses: how many poses are drawn between start and goal.
        size: width and height of the picture in pixels.

    Raises:
        OSError: if the file cannot be written.
        ValueError: if the path is empty, or the picture too small.
    """
    path = np.asarray(path, dtype=np.float64).reshape(-1, robot.dof)
    keypoints = np.asarray(keypoints, dtype=np.float64).reshape(-1, 3)
    if len(path) == 0:
        raise ValueError("the path is empty")
    if min(size) < 400:
        raise ValueError(f"a picture of {size[0]} x {size[1]} pixels: expected at least 400 each way")
    states = interpolate(path, PATH_STEP)
    tool = np.array([robot.forward_kinematics(state).position for state in states])
    meshes = RobotMeshes(robot)
    base = Layer(meshes.base, np.array(BASE), np.zeros(len(meshes.base), dtype=np.int64))
    *others, goal = _pose_layers(meshes, path, intermediate_poses)
    goal_arm = goal.mesh.points
    arm = np.concatenate([meshes.base.points, tool, keypoints, goal_arm, *(layer.mesh.points for layer in others)])
    # What must be seen: the way of the tool, the keypoints and, counted less, the arm at the goal.
    way = np.concatenate((tool[:: max(len(tool) // 100, 1)], keypoints))
    targets = np.concatenate((way, goal_arm[:: max(len(goal_arm) // 60, 1)]))
    bodies = obstacle_bodies(scene)
    fit = points_to_fit(bodies, arm, scene.bounds)
    extra = [base, *others]
    portals = keypoint_portals(decomposition, keypoints) if decomposition is not None else np.empty(0, np.int64)
    if decomposition is not None and len(portals):
        extra.append(portal_layer(decomposition, portals))

    width, height = size
    panel_height = height - overlay.HEADER - overlay.FOOTER
    left_width = round(0.53 * (width - 3 * overlay.GAP))
    right_width = width - 3 * overlay.GAP - left_width
    obstacles = TriangleMesh.joined([body.mesh for body in bodies])
    reach = aligned_azimuth(obstacles, _reach_azimuth(tool))
    # Seen from behind the arm's shoulder, one looks into what it reaches into.
    around = [reach + math.pi + side * math.radians(angle) for angle in (50, 65, 35) for side in (1, -1)]
    oblique = best_view(obstacles, fit, targets, around, [math.radians(a) for a in (16, 28)], left_width, panel_height)
    sides = [reach - 0.5 * math.pi, reach + 0.5 * math.pi]
    side = best_view(obstacles, fit, targets, sides, [0.0], right_width, panel_height, None)

    figure = overlay.new_figure(width, height, title or robot.name, _facts(robot, path, tool, keypoints, decomposition))
    has_glass = False
    left = overlay.GAP
    for camera, caption in ((oblique, "Oblique view"), (side, "Side view, without perspective")):
        layers, glass = obstacle_layers(bodies, camera, targets)
        has_glass |= any(glass)
        # Where start and goal coincide, it is the goal that is seen.
        front = TriangleMesh(camera.nearer(goal.mesh.corners, COINCIDENCE), goal.mesh.normals)
        layers += [*extra, replace(goal, mesh=front)]
        panel = overlay.Panel.of(figure, left, overlay.FOOTER, camera, layers, caption)
        overlay.draw_progress_line(panel.axes, panel.pixels(tool))
        overlay.draw_badges(panel.axes, panel.pixels(keypoints), panel.pixels(tool[0]), panel.pixels(tool[-1]))
        left += camera.width + overlay.GAP
    _add_scale_bar(panel)
    overlay.add_legend(figure, _legend(len(keypoints) > 0, len(portals) > 0, has_glass, intermediate_poses > 0))
    overlay.save(figure, path_png)


def _pose_layers(meshes: RobotMeshes, path: FloatArray, intermediate_poses: int) -> list[Layer]:
    """The moving bodies in poses along a path: the intermediate ones, then start and goal."""
    lengths = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    fractions = np.append(np.arange(1, intermediate_poses + 1) / (intermediate_poses + 1), [0.0, 1.0])
    at = fractions * lengths[-1]
    states = np.stack([np.interp(at, lengths, path[:, joint]) for joint in range(path.shape[1])], axis=1)
    layers = []
    for state, fraction, colour in zip(states, fractions, progress_colours(fractions), strict=True):
        mesh = meshes.at(state)
        solid = fraction in (0.0, 1.0)
        layers.append(
            Layer(
                mesh,
                colour,
                # One body: lines between links that lie in each other would flicker.
                np.zeros(len(mesh), dtype=np.int64),
                1.0 if solid else GHOST_ALPHA,
                0.35 if solid else GHOST_EDGE_ALPHA,
            )
        )
    return layers


def _reach_azimuth(tool: FloatArray) -> float:
    """The direction in which the arm reaches [rad], from the way (m, 3) of its tool."""
    for point in (tool[-1], tool.mean(axis=0)):
        if math.hypot(point[0], point[1]) > 0.05:
            return math.atan2(point[1], point[0])
    return 0.0


def _facts(
    robot: Robot, path: FloatArray, tool: FloatArray, keypoints: FloatArray, decomposition: Decomposition | None
) -> str:
    travel = float(np.linalg.norm(np.diff(tool, axis=0), axis=1).sum())
    facts = [
        f"{robot.name}, {robot.dof} joints",
        f"path of {len(path)} waypoints, joint-space length {path_length(path):.2f}",
        f"tool travels {travel:.2f} m",
        f"{len(keypoints)} keypoint{'' if len(keypoints) == 1 else 's'}",
    ]
    if decomposition is not None:
        facts.append(overlay.counts(decomposition))
    return "   ·   ".join(facts)


def _add_scale_bar(panel: overlay.Panel) -> None:
    """A bar of 0.5 m, or 0.1 m where that is too long, in the lower right corner of a panel without perspective."""
    camera: Camera = panel.camera
    metres = next((m for m in (0.5, 0.2, 0.1, 0.05) if m * camera.scale < 0.3 * camera.width), 0.02)
    right, y = camera.width - 18.0, camera.height - 18.0
    left = right - metres * camera.scale
    panel.axes.plot([left, left, right, right], [y - 5, y, y, y - 5], color="black", linewidth=1.5, zorder=20)
    panel.axes.text(0.5 * (left + right), y - 6, f"{metres:g} m", size=10, ha="center", va="bottom", zorder=20)


def _legend(keypoints: bool, portals: bool, glass: bool, ghosts: bool) -> list[Artist]:
    handles: list[Artist] = [overlay.patch_handle(START, "arm at start (S)")]
    if ghosts:
        handles.append(overlay.patch_handle(MIDDLE, "in between", 0.4))
    handles.append(overlay.patch_handle(GOAL, "arm at goal (G)"))
    handles.append(overlay.line_handle(MIDDLE, "tool path"))
    if keypoints:
        handles.append(overlay.badge_handle(KEYPOINT, "keypoints"))
    if portals:
        handles.append(overlay.patch_handle(PORTAL, "portals of the keypoints", 0.3))
    handles.append(overlay.patch_handle(FURNITURE, "obstacles"))
    if glass:
        handles.append(overlay.glass_handle(FURNITURE, "obstacles, see-through"))
    return handles
