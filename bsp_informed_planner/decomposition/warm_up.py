"""Compiles the kernels of this part by a small problem in each dimension."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.decomposition.graph import cells_along, shortest_chain
from bsp_informed_planner.decomposition.incremental import IncrementalDecomposer
from bsp_informed_planner.decomposition.merging import merge_keypoints
from bsp_informed_planner.decomposition.options import DecompositionOptions, UpdateOptions
from bsp_informed_planner.scene.diff import ObstacleOperation, SceneDiff, apply
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box


def warm_up() -> None:
    """Decomposes a box that moves in a cube, searches a chain around it, and looks at it in every way there is."""
    box = Box(np.array([0.2, 0.4, 1.0]))
    scene = Scene.of([Obstacle.of("box", box)], WorkspaceBounds(-np.ones(3), np.ones(3)))
    moved = apply(scene, SceneDiff.of(ObstacleOperation.move("box", Pose.from_xyz_rpy([0.0, 0.05, 0.0]))))
    limits = UpdateOptions(replaced_share=1.0, changed_share=1.0, growth=100.0)
    for dimension in (2, 3):
        decomposer = IncrementalDecomposer(DecompositionOptions(dimension=dimension), limits)
        decomposer.decompose(scene)
        decomposition = decomposer.decompose(moved)
        chain = shortest_chain(decomposition, [-0.5, 0.05, 0.0], [0.5, 0.05, 0.0], removed_edges=[])
        cells_along(decomposition, chain.points)
        merge_keypoints(chain.points, 1.0, decomposition)
        decomposition.is_free(chain.points)
        decomposition.edges()
        decomposition.cell_polytope(int(chain.cells[0]))
