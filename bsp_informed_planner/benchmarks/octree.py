"""What most planners would use in place of a BSP: an octree with keypoints at the centres of the faces of its cells."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bsp_informed_planner.benchmarks.octree_kernels import FREE, build_octree, find_cell, shared_faces
from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.decomposition.facets import read_facets
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.decomposition.search_kernels import candidates_by_cell, search_chain
from bsp_informed_planner.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Octree:
    """Free cells of an octree, or of a quadtree in the plane z = section height, and the faces between them.

    Cells that are neither free nor in an obstacle are split down to a smallest size, at which they count as solid.

    Attributes:
        dimension: 2 or 3.
        lower: (3,) corner of the root cell; edge: (3,) edges of the smallest cells [m].
        children, states, corners, sizes: of the nodes, see `build_octree`.
        centres: (k, 3) of the faces that free cells share [m].
        cells: (k, 2) the cells of each.
    """

    dimension: int
    lower: Floats
    edge: Floats
    children: Indices
    states: Indices
    corners: Indices
    sizes: Indices
    centres: Floats
    cells: Indices

    @property
    def leaf_count(self) -> int:
        return int(np.count_nonzero(self.children < 0))

    @property
    def free_count(self) -> int:
        """Number of free cells."""
        return int(np.count_nonzero((self.children < 0) & (self.states == FREE)))

    @property
    def smallest_edge(self) -> float:
        """[m]."""
        return float(self.edge[:2].max())

    def locate(self, point: ArrayLike) -> int:
        """The free cell that holds a point (3,) [m]; -1 if there is none."""
        place = np.zeros(3, np.int64)
        axes = slice(0, self.dimension)
        offset = (np.asarray(point, dtype=np.float64) - self.lower)[axes] / self.edge[axes]
        place[axes] = np.floor(offset).astype(np.int64)
        cell = int(find_cell(place[0], place[1], place[2], 0, self.children, self.corners, self.sizes, self.dimension))
        return cell if cell >= 0 and self.states[cell] == FREE else -1

    def shortest_chain(self, start: ArrayLike, goal: ArrayLike) -> Floats | None:
        """(m, 3) start, keypoints at centres of faces, goal [m]; None if there is no chain.

        It is found by the search that also the BSP uses.

        Args:
            start, goal: (3,) [m].
        """
        ends = np.array([start, goal], dtype=np.float64)
        cells = [self.locate(end) for end in ends]
        if min(cells) < 0:
            return None
        count = len(self.centres)
        own = np.arange(count)
        nodes, _, _ = search_chain(
            self.centres,
            own,
            self.cells,
            *candidates_by_cell(own, self.cells, len(self.children)),
            np.zeros(count),
            np.zeros(count, np.bool_),
            np.empty(0, np.int64),
            ends[0],
            ends[1],
            *cells,
        )
        if not len(nodes):
            return None
        return np.concatenate((ends[:1], self.centres[nodes[1:-1]], ends[1:]))


def octree_of(scene: Scene, depth: int, options: DecompositionOptions | None = None) -> Octree:
    """Splits the workspace of a scene; the smallest cells have 2^-depth of its edges.

    Args:
        scene: obstacles and workspace.
        depth: from 0 to 16.
        options: the dimension and section height count.

    Raises:
        ValueError: if the depth is another.
        InvalidObstacleError: if an obstacle has a shape without volume.
    """
    if not 0 <= depth <= 16:
        raise ValueError(f"depth {depth}: expected 0 to 16")
    options = options or DecompositionOptions()
    facets = read_facets(scene, options)
    lower = scene.bounds.lower.copy()
    edge = (scene.bounds.upper - lower) * math.ldexp(1.0, -depth)
    if options.dimension == 2:
        lower[2], edge[2] = options.section_height, 0.0
    if len(facets.vertices):
        first = facets.vertex_offsets[:-1]
        boxes = np.stack(
            (np.minimum.reduceat(facets.vertices, first), np.maximum.reduceat(facets.vertices, first)), axis=1
        )
    else:
        boxes = np.empty((0, 2, 3))
    tree = build_octree(boxes, facets.planes, facets.facet_offsets, lower, edge, depth, options.dimension)
    centres, cells = shared_faces(*tree, options.dimension)
    return Octree(options.dimension, lower, edge, *tree, lower + centres * edge, cells)


def warm_up() -> None:
    """Compiles the kernels of this module."""
    from bsp_informed_planner.scene.scene import Obstacle, WorkspaceBounds
    from bsp_informed_planner.scene.shapes import Box

    scene = Scene.of([Obstacle.of("box", Box(np.full(3, 0.5)))], WorkspaceBounds(-np.ones(3), np.ones(3)))
    for dimension in (2, 3):
        octree_of(scene, 3, DecompositionOptions(dimension=dimension)).shortest_chain([-0.9, 0, 0], [0.9, 0, 0])
