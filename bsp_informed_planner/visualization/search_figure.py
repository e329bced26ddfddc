"""Pictures of a search in the plane: where samples fall, and how trees grow."""

from __future__ import annotations

import os

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import LineCollection

from bsp_informed_planner.planning.grown_tree import GrownTree
from bsp_informed_planner.planning.growth import Growth
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.visualization import overlay
from bsp_informed_planner.visualization.palette import GOAL, GRAPH, KEYPOINT, MIDDLE, START, WALL
from bsp_informed_planner.visualization.plane_figure import draw_walls, plane_panel


def draw_plane_samples(
    path_png: str | os.PathLike[str], scene: Scene, chain: FloatArray, samples: FloatArray, *, title: str
) -> None:
    """Writes a picture (PNG) of samples of a point robot in the plane.

    Args:
        path_png: file to write; folders are made.
        scene: the obstacles, drawn where they meet the plane z = 0.
        chain: (m, 2 or 3) start, keypoints, goal [m].
        samples: (k, 2) configurations.
        title: of the picture.

    Raises:
        OSError: if the file cannot be written.
    """
    figure, axes = plane_panel(scene, title, [f"{len(samples)} samples", f"{len(chain) - 2} keypoints"])
    draw_walls(axes, scene, 0.0)
    axes.scatter(samples[:, 0], samples[:, 1], s=12, color=[GRAPH], linewidths=0, zorder=4)
    overlay.draw_progress_line(axes, chain[:, :2], 1.5)
    overlay.draw_badges(axes, chain[1:-1, :2], chain[0, :2], chain[-1, :2])
    handles: list[Artist] = [
        overlay.line_handle(MIDDLE, "keypoint chain from start (S) to goal (G)", 1.5),
        overlay.badge_handle(KEYPOINT, "keypoints"),
        overlay.dot_handle(GRAPH, "samples"),
        overlay.patch_handle(WALL, "obstacles"),
    ]
    overlay.add_legend(figure, handles)
    overlay.save(figure, path_png)


def draw_plane_trees(path_png: str | os.PathLike[str], scene: Scene, growth: Growth, *, title: str) -> None:
    """Writes a picture (PNG) of the two trees of a bidirectional search for a point robot in the plane.

    Args:
        path_png: file to write; folders are made.
        scene: the obstacles, drawn where they meet the plane z = 0.
        growth: what the search did.
        title: of the picture.

    Raises:
        OSError: if the file cannot be written.
    """
    trees = ((growth.start_tree, START), (growth.goal_tree, GOAL))
    nodes = sum(len(tree.nodes) for tree, _ in trees)
    met = "the trees met" if growth.path is not None else "the trees did not meet"
    figure, axes = plane_panel(scene, title, [f"{nodes} nodes after {growth.samples} samples", met])
    draw_walls(axes, scene, 0.0)
    for tree, colour in trees:
        axes.add_collection(
            LineCollection(list(tree_edges(tree)), colors=[colour], linewidths=1.4, zorder=4), autolim=False
        )
    overlay.draw_badges(axes, np.empty((0, 2)), growth.start_tree.nodes[0, :2], growth.goal_tree.nodes[0, :2])
    handles: list[Artist] = [
        overlay.line_handle(START, "tree from the start (S)", 1.4),
        overlay.line_handle(GOAL, "tree from the goal (G)", 1.4),
        overlay.patch_handle(WALL, "obstacles"),
    ]
    overlay.add_legend(figure, handles)
    overlay.save(figure, path_png)


def tree_edges(tree: GrownTree) -> FloatArray:
    """(e, 2, 2) edges of a tree in the plane, each from a node to its parent."""
    children = np.flatnonzero(tree.parents >= 0)
    return np.stack([tree.nodes[children, :2], tree.nodes[tree.parents[children], :2]], axis=1)
