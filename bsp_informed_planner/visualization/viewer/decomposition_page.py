"""The page of `bsp-planner decompose --view`."""

from __future__ import annotations

from dataclasses import dataclass

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.visualization.viewer.chain_layer import ChainLayer
from bsp_informed_planner.visualization.viewer.decomposition_layer import DecompositionLayer
from bsp_informed_planner.visualization.viewer.scene_layer import SceneLayer, section_of
from bsp_informed_planner.visualization.viewer.selection_layer import SelectionLayer
from bsp_informed_planner.visualization.viewer.server import Viewer
from bsp_informed_planner.visualization.viewer.switches import add_legend

# Obstacles are seen through a little, so that what is in a shelf can be seen from all sides.
OPACITY = 0.6


@dataclass(frozen=True, eq=False)
class DecompositionPage:
    """A scene and its decomposition in a page, by its parts."""

    scene: SceneLayer
    decomposition: DecompositionLayer
    chain: ChainLayer
    selection: SelectionLayer


def show_decomposition(
    viewer: Viewer,
    scene: Scene,
    decomposition: Decomposition,
    start: FloatArray | None = None,
    goal: FloatArray | None = None,
) -> DecompositionPage:
    """Fills a page with a scene and its decomposition.

    Args:
        viewer: the page, empty so far.
        scene: the obstacles.
        decomposition: of the scene, in 2D or 3D.
        start, goal: (3,) ends of the first chain of keypoints [m]; None for two that show something.
    """
    gui = viewer.server.gui
    section = section_of(decomposition)
    gui.add_markdown(summary(scene, decomposition))
    with gui.add_folder("What the colours mean"):
        add_legend(
            viewer,
            SceneLayer.legend(section is not None)
            + DecompositionLayer.legend()
            + ChainLayer.legend()
            + SelectionLayer.legend(),
        )
    with gui.add_folder("Show"):
        obstacles = SceneLayer(viewer, scene, section=section, opacity=OPACITY if section is None else 1.0)
        cells = DecompositionLayer(viewer, decomposition)
    chain = ChainLayer(viewer, decomposition, start, goal)
    selection = SelectionLayer(viewer, decomposition)
    viewer.look_at(*obstacles.extent(), from_above=section is not None)
    return DecompositionPage(obstacles, cells, chain, selection)


def summary(scene: Scene, decomposition: Decomposition) -> str:
    """Two lines about a decomposition, in Markdown."""
    seconds = decomposition.timings.total_seconds
    return (
        f"**{len(scene.obstacles)} obstacles**, {decomposition.facet_count} facets, decomposed in "
        f"{1e3 * seconds:.2f} ms\n\n"
        f"{decomposition.cell_count} free cells, {decomposition.portal_count} portals, "
        f"{decomposition.candidate_count:,} keypoint candidates, {decomposition.edge_count:,} edges"
    )
