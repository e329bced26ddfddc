"""Pictures in the plane: a maze, its decomposition, and the path of a point."""

from __future__ import annotations

import os

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.decomposition.graph import KeypointChain
from bsp_informed_planner.planning.path import interpolate, path_length
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.polytopes import cross_section, polytopes_of
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.visualization import overlay
from bsp_informed_planner.visualization.palette import CANDIDATE, CELL, KEYPOINT, MIDDLE, PORTAL, WALL
from bsp_informed_planner.visualization.portals import keypoint_portals

# The longer side of the panel, and the shorter one at least, in pixels.
LONG_SIDE, SHORT_SIDE = 900, 500
# The path is drawn through points no further apart than this share of the diagonal of the workspace.
PATH_STEP = 0.005
# How far drawn obstacles may stand out of round ones, as a share of the diagonal of the workspace.
CURVE_SHARE = 0.001


def draw_point_plan(
    path_png: str | os.PathLike[str],
    robot: Robot,
    scene: Scene,
    path: FloatArray,
    keypoints: FloatArray,
    *,
    decomposition: Decomposition | None = None,
    title: str = "",
) -> None:
    """Writes a picture (PNG) of the path of a point robot in the plane.

    Args:
        path_png: file to write; folders are made.
        robot: the robot; its reference point is drawn.
        scene: the obstacles, drawn where they meet the plane of the decomposition, or z = 0.
        path: (m, n) configurations, straight edges between them.
        keypoints: (k, 2) or (k, 3) keypoints, start and goal left out [m]; k may be 0.
        decomposition: of the scene, in 2D; its cells, portals and keypoint candidates are drawn.
        title: of the picture; the robot's name if empty.

    Raises:
        OSError: if the file cannot be written.
        ValueError: if the path is empty.
    """
    path = np.asarray(path, dtype=np.float64).reshape(-1, robot.dof)
    if len(path) == 0:
        raise ValueError("the path is empty")
    keypoints = np.asarray(keypoints, dtype=np.float64)
    keypoints = keypoints.reshape(-1, keypoints.shape[1] if keypoints.ndim == 2 else 3)
    diagonal = float(np.linalg.norm((scene.bounds.upper - scene.bounds.lower)[:2]))
    way = np.array([robot.forward_kinematics(q).position for q in interpolate(path, PATH_STEP * diagonal)])[:, :2]
    facts = [
        f"path of {len(path)} waypoints, length {path_length(path):.3f} m",
        f"{len(keypoints)} keypoint{'' if len(keypoints) == 1 else 's'}",
    ]
    height = 0.0
    if decomposition is not None:
        height = decomposition.section_height
        facts.append(overlay.counts(decomposition))
    figure, axes = plane_panel(scene, title or robot.name, facts)
    draw_walls(axes, scene, height)
    if decomposition is not None:
        in_section = np.column_stack((keypoints[:, :2], np.full(len(keypoints), height)))
        _draw_decomposition(axes, decomposition, keypoint_portals(decomposition, in_section))
    overlay.draw_progress_line(axes, way)
    overlay.draw_badges(axes, keypoints[:, :2], way[0], way[-1])
    handles: list[Artist] = [overlay.line_handle(MIDDLE, "path from start (S) to goal (G)")]
    overlay.add_legend(figure, handles + _handles(len(keypoints) > 0, decomposition))
    overlay.save(figure, path_png)


def draw_plane_decomposition(
    path_png: str | os.PathLike[str],
    scene: Scene,
    decomposition: Decomposition,
    chain: KeypointChain | None = None,
    *,
    title: str = "",
) -> None:
    """Writes a picture (PNG) of a 2D decomposition; see `draw_decomposition` for the arguments."""
    facts = [overlay.counts(decomposition)]
    if chain is not None:
        facts.append(f"chain of {len(chain.points) - 2} keypoints, {chain.length:.3f} m long")
    figure, axes = plane_panel(scene, title or "Binary space partition of the plane", facts)
    draw_walls(axes, scene, decomposition.section_height)
    keypoints = np.empty((0, 3)) if chain is None else chain.points[1:-1]
    _draw_decomposition(axes, decomposition, keypoint_portals(decomposition, keypoints))
    handles: list[Artist] = []
    if chain is not None:
        overlay.draw_progress_line(axes, chain.points[:, :2])
        overlay.draw_badges(axes, keypoints[:, :2], chain.points[0, :2], chain.points[-1, :2])
        handles.append(overlay.line_handle(MIDDLE, "keypoint chain from start (S) to goal (G)"))
    overlay.add_legend(figure, handles + _handles(len(keypoints) > 0, decomposition))
    overlay.save(figure, path_png)


def draw_walls(axes: Axes, scene: Scene, height: float) -> None:
    """The cross-sections of all obstacles with the plane z = `height` [m]."""
    tolerance = CURVE_SHARE * float(np.linalg.norm((scene.bounds.upper - scene.bounds.lower)[:2]))
    sections = [
        cross_section(part, height)
        for obstacle in scene.obstacles.values()
        for shape, pose in obstacle.placed_shapes()
        for part in polytopes_of(shape, pose, scene.bounds, tolerance)
    ]
    polygons = [section for section in sections if section is not None]
    axes.add_collection(PolyCollection(polygons, facecolors=[WALL], edgecolors=[WALL], linewidths=0.5, zorder=3))


def section_of_cell(decomposition: Decomposition, cell: int) -> FloatArray | None:
    """(k, 2) corners of a cell of a 2D decomposition [m]; None if it has no area."""
    polytope = decomposition.cell_polytope(cell)
    return None if polytope is None else cross_section(polytope, decomposition.section_height)


def section_of_portal(decomposition: Decomposition, portal: int) -> FloatArray:
    """(2, 2) ends of a portal of a 2D decomposition [m], which is an upright rectangle."""
    corners = decomposition.portal(portal)[:, :2]
    distances = np.linalg.norm(corners[:, None] - corners[None], axis=2)
    first, second = np.unravel_index(int(distances.argmax()), distances.shape)
    return corners[[first, second]]


def plane_panel(scene: Scene, title: str, facts: list[str]) -> tuple[Figure, Axes]:
    """A figure with axes of equal scale over the workspace of a scene."""
    lower, upper = scene.bounds.lower[:2], scene.bounds.upper[:2]
    extent = (upper - lower) * 1.02
    scale = LONG_SIDE / float(extent.max())
    width, height = (max(round(side * scale), SHORT_SIDE) for side in extent.tolist())
    # Room for the names of the axes, and numbers such as -0.75.
    left, below = 96, overlay.FOOTER + 60
    figure_width = left + width + 30
    figure_height = overlay.HEADER + height + below
    figure = overlay.new_figure(figure_width, figure_height, title, "   ·   ".join(facts))
    axes = overlay.add_axes(figure, left, below, width, height)
    centre = 0.5 * (lower + upper)
    half_width, half_height = 0.5 * width / scale, 0.5 * height / scale
    axes.set_xlim(centre[0] - half_width, centre[0] + half_width)
    axes.set_ylim(centre[1] - half_height, centre[1] + half_height)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    border = np.array([lower, (upper[0], lower[1]), upper, (lower[0], upper[1])])
    axes.add_collection(
        PolyCollection([border], facecolors=["white"], edgecolors=[WALL], linewidths=1.2, zorder=1), autolim=False
    )
    return figure, axes


def _draw_decomposition(axes: Axes, decomposition: Decomposition, highlighted: NDArray[np.int64]) -> None:
    """Cells, portals, those with keypoints more clearly, and candidates."""
    sections = [section_of_cell(decomposition, int(cell)) for cell in decomposition.free_cells]
    cells = [section for section in sections if section is not None]
    axes.add_collection(
        PolyCollection(cells, facecolors="none", edgecolors=[(*CELL, 0.55)], linewidths=0.7, zorder=2), autolim=False
    )
    segments = [section_of_portal(decomposition, portal) for portal in range(decomposition.portal_count)]
    axes.add_collection(LineCollection(segments, colors=[(*PORTAL, 0.7)], linewidths=1.8, zorder=4), autolim=False)
    axes.add_collection(
        LineCollection([segments[portal] for portal in highlighted], colors=[PORTAL], linewidths=4.0, zorder=5),
        autolim=False,
    )
    x, y, _ = decomposition.candidates.T
    axes.scatter(x, y, s=9, color=[CANDIDATE], linewidths=0, zorder=6)


def _handles(keypoints: bool, decomposition: Decomposition | None) -> list[Artist]:
    """Entries of the legend for what is drawn."""
    handles: list[Artist] = []
    if keypoints:
        handles.append(overlay.badge_handle(KEYPOINT, "keypoints"))
    if decomposition is not None:
        if decomposition.portal_count:
            if keypoints:
                handles.append(overlay.line_handle(PORTAL, "their portals", 4.0))
            faint = tuple(1.0 - 0.7 * (1.0 - channel) for channel in PORTAL)
            handles.append(overlay.line_handle((faint[0], faint[1], faint[2]), "portals", 1.8))
            handles.append(overlay.dot_handle(CANDIDATE, "keypoint candidates"))
        handles.append(overlay.patch_handle((1.0, 1.0, 1.0), "free cells"))
    handles.append(overlay.patch_handle(WALL, "obstacles"))
    return handles
