"""A picture of a decomposition of space."""

from __future__ import annotations

import math
import os

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import LineCollection

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.decomposition.graph import KeypointChain
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.visualization import overlay
from bsp_informed_planner.visualization.cell_edges import cell_edges
from bsp_informed_planner.visualization.obstacle_layers import (
    aligned_azimuth,
    best_view,
    obstacle_bodies,
    obstacle_layers,
    points_to_fit,
)
from bsp_informed_planner.visualization.palette import CANDIDATE, CELL, FURNITURE, KEYPOINT, MIDDLE, PORTAL
from bsp_informed_planner.visualization.plane_figure import draw_plane_decomposition
from bsp_informed_planner.visualization.portals import inner_portals, keypoint_portals, portal_layer
from bsp_informed_planner.visualization.triangle_mesh import TriangleMesh

# Lines are hidden by surfaces piece by piece, in pieces of at most this share of the diagonal of the workspace.
PIECE_SHARE = 0.02


def draw_decomposition(
    path_png: str | os.PathLike[str],
    scene: Scene,
    decomposition: Decomposition,
    chain: KeypointChain | None = None,
    *,
    title: str = "",
    size: tuple[int, int] = (1600, 900),
) -> None:
    """Writes a picture (PNG) of the free cells, portals and keypoint candidates of a decomposition, 2D or 3D.

    Args:
        path_png: file to write; folders are made.
        scene: the obstacles.
        decomposition: of the scene.
        chain: keypoints from a start to a goal, drawn in their order.
        title: of the picture.
        size: width and height in pixels of the picture in 3D; in 2D it has the shape of the workspace.

    Raises:
        OSError: if the file cannot be written.
        ValueError: if the picture is too small.
    """
    if decomposition.dimension == 2:
        draw_plane_decomposition(path_png, scene, decomposition, chain, title=title)
        return
    width, height = size
    if min(size) < 400:
        raise ValueError(f"a picture of {width} x {height} pixels: expected at least 400 each way")
    keypoints = np.empty((0, 3)) if chain is None else chain.points[1:-1]
    targets = decomposition.candidates if chain is None else chain.points
    bodies = obstacle_bodies(scene)
    obstacles = TriangleMesh.joined([body.mesh for body in bodies])
    bounds = np.stack((decomposition.bounds.lower, decomposition.bounds.upper))
    corners = np.stack(np.meshgrid(*bounds.T, indexing="ij"), axis=-1).reshape(-1, 3)
    panel_width = (width - 3 * overlay.GAP) // 2
    panel_height = height - overlay.HEADER - overlay.FOOTER
    front = aligned_azimuth(obstacles, math.pi)
    azimuths = [front + math.radians(angle) for angle in (-35, 35, 145, 215)]
    elevations = [math.radians(22)]
    whole = best_view(obstacles, corners, targets, azimuths, elevations, panel_width, panel_height)
    near = points_to_fit(bodies, keypoints if chain is None else chain.points, scene.bounds)
    close = best_view(obstacles, near, targets, azimuths, elevations, panel_width, panel_height)

    facts = [
        f"{decomposition.facet_count} facets, {decomposition.split_count} of them split",
        overlay.counts(decomposition),
        f"decomposed in {1e3 * decomposition.timings.total_seconds:.2f} ms",
    ]
    if chain is not None:
        facts.append(f"chain of {len(keypoints)} keypoints, {chain.length:.2f} m long")
    figure = overlay.new_figure(width, height, title or "Binary space partition", "   ·   ".join(facts))

    layers, _ = obstacle_layers(bodies, whole, np.empty((0, 3)))
    panel = overlay.Panel.of(figure, overlay.GAP, overlay.FOOTER, whole, layers, "Free cells")
    _draw_lines(panel, cell_edges(decomposition), PIECE_SHARE * float(np.linalg.norm(bounds[1] - bounds[0])))

    layers, glass = obstacle_layers(bodies, close, targets if chain is not None else np.empty((0, 3)))
    chosen = inner_portals(decomposition) if chain is None else keypoint_portals(decomposition, keypoints)
    if len(chosen):
        layers.append(
            portal_layer(decomposition, chosen, 0.18) if chain is None else portal_layer(decomposition, chosen)
        )
    caption = (
        "Portals that end at obstacles, and all keypoint candidates"
        if chain is None
        else f"Keypoint chain, {'its portals, ' if len(chosen) else ''}and all keypoint candidates"
    )
    panel = overlay.Panel.of(figure, 2 * overlay.GAP + panel_width, overlay.FOOTER, close, layers, caption)
    seen = decomposition.candidates[~panel.hides(decomposition.candidates)]
    x, y = panel.pixels(seen).T
    panel.axes.scatter(x, y, s=6, color=[CANDIDATE], linewidths=0, zorder=8)
    handles: list[Artist] = [
        overlay.patch_handle(FURNITURE, "obstacles"),
        overlay.line_handle(CELL, "edges of free cells", 1.2),
        *([overlay.patch_handle(PORTAL, "portals", 0.3)] if len(chosen) else []),
        overlay.dot_handle(CANDIDATE, "keypoint candidates"),
    ]
    if chain is not None:
        line = panel.pixels(chain.points)
        overlay.draw_progress_line(panel.axes, line)
        overlay.draw_badges(panel.axes, line[1:-1], line[0], line[-1])
        handles += [
            overlay.line_handle(MIDDLE, "chain from start (S) to goal (G)"),
            overlay.badge_handle(KEYPOINT, "keypoints"),
        ]
    if any(glass):
        handles.append(overlay.glass_handle(FURNITURE, "obstacles, see-through"))
    overlay.add_legend(figure, handles)
    overlay.save(figure, path_png)


def _draw_lines(panel: overlay.Panel, edges: FloatArray, piece: float) -> None:
    """Draws edges (e, 2, 3) [m] where no surface hides them, in pieces of at most a length [m]."""
    if not len(edges):
        return
    counts = np.ceil(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1) / piece).clip(1).astype(int)
    edge = np.arange(len(edges)).repeat(counts)
    index = np.arange(len(edge)) - (np.cumsum(counts) - counts).repeat(counts)
    shares = np.stack((index, index + 1), axis=1) / counts[edge][:, None]
    pieces = edges[edge, :1] + shares[..., None] * (edges[edge, 1:] - edges[edge, :1])
    shown = pieces[~panel.hides(pieces.mean(axis=1))]
    panel.axes.add_collection(
        LineCollection(list(panel.pixels(shown)), colors=[(*CELL, 0.6)], linewidths=0.8, zorder=7), autolim=False
    )
