"""The decomposition of a workspace into convex cells, with portals and keypoint candidates."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.decomposition.cell_kernels import cell_faces
from bsp_informed_planner.decomposition.construction import Construction, construct
from bsp_informed_planner.decomposition.facets import decomposed_bounds, read_facets
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.decomposition.search_kernels import candidates_by_cell, list_edges
from bsp_informed_planner.decomposition.traversal_kernels import locate_points
from bsp_informed_planner.errors import InvalidDecompositionError
from bsp_informed_planner.scene.polytopes import ConvexPolytope
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds

# Corners of a cell's faces that are closer than this are one vertex [m].
SAME_VERTEX = 1e-6


@dataclass(frozen=True)
class DecompositionTimings:
    """Wall-clock times [s] of: reading the scene, the partitioning, portals, candidates and graph."""

    scene_seconds: float = 0.0
    partition_seconds: float = 0.0
    portal_seconds: float = 0.0
    graph_seconds: float = 0.0

    @property
    def total_seconds(self) -> float:
        return self.scene_seconds + self.partition_seconds + self.portal_seconds + self.graph_seconds


@dataclass(frozen=True, eq=False)
class Decomposition:
    """Convex cells of a workspace, the portals between free cells, and keypoint candidates on the portals.

    The attributes up to `clearance_cap` are the content of the message KeypointGraph: an object made from them does
    everything that the original does. Arrays become read-only. Cells are named by the indices of their leaves.

    Attributes:
        dimension: 3, or 2 for the decomposition of a horizontal plane, which is a slab here with that plane halfway up.
        bounds: of the decomposed space.
        node_planes: (n, 4) rows (a, b, c, d): node i splits space at a x + b y + c z = d. Node 0 is the root.
        node_front, node_back: (n,) children where the left side is larger or smaller than d; they come after their
            parent; -1 for a leaf.
        node_solid: (n,) whether a leaf is an obstacle.
        portal_corners: (m, 3) corners of all portals [m], in order around each.
        portal_offsets: (p + 1,) where the corners of each portal begin.
        portal_cells: (p, 2) the free cells in front of and behind each portal.
        candidates: (k, 3) keypoint candidates [m].
        candidate_portals: (k,) the portal of each.
        candidate_clearances: (k,) distance from the nearest obstacle, cut off at `clearance_cap` [m].
        clearance_cap: [m].
        frame, scene_revision: of the scene.
        timings: of its making.
        facet_count, split_count: facets of the scene, and how often the partitioning cut one in two; 0 if not known.

    Raises:
        InvalidDecompositionError: if the arrays do not fit together.
    """

    dimension: int
    bounds: WorkspaceBounds
    node_planes: Floats
    node_front: Indices
    node_back: Indices
    node_solid: Flags
    portal_corners: Floats
    portal_offsets: Indices
    portal_cells: Indices
    candidates: Floats
    candidate_portals: Indices
    candidate_clearances: Floats
    clearance_cap: float
    frame: str = "world"
    scene_revision: int = 0
    timings: DecompositionTimings = field(default_factory=DecompositionTimings)
    facet_count: int = 0
    split_count: int = 0

    def __post_init__(self) -> None:
        if self.dimension not in (2, 3):
            raise InvalidDecompositionError(f"dimension {self.dimension}: expected 2 or 3")
        nodes = self._array("node_front", np.int64, (-1,))
        self._array("node_planes", np.float64, (nodes, 4))
        self._array("node_back", np.int64, (nodes,))
        self._array("node_solid", np.bool_, (nodes,))
        portals = self._array("portal_cells", np.int64, (-1, 2))
        self._array("portal_offsets", np.int64, (portals + 1,))
        corners = self._array("portal_corners", np.float64, (-1, 3))
        count = self._array("candidates", np.float64, (-1, 3))
        self._array("candidate_portals", np.int64, (count,))
        self._array("candidate_clearances", np.float64, (count,))

        inner = np.flatnonzero(self.node_front >= 0)
        children = np.stack((self.node_front[inner], self.node_back[inner]))
        # Children behind their parents: every walk down ends.
        if nodes == 0 or (children <= inner).any() or (children >= nodes).any() or children.size != nodes - 1:
            raise InvalidDecompositionError("node_front and node_back do not make a binary tree")
        self._check_range("portal_cells", self.portal_cells, nodes)
        self._check_range("candidate_portals", self.candidate_portals, portals)
        if (self.node_front[self.portal_cells] >= 0).any():
            raise InvalidDecompositionError("portal_cells: a portal joins nodes that are no leaves")
        offsets = self.portal_offsets
        if offsets[0] != 0 or offsets[-1] != corners or (offsets[1:] < offsets[:-1]).any():
            raise InvalidDecompositionError("portal_offsets do not divide portal_corners")

    @staticmethod
    def _of_own_arrays(**attributes: Any) -> Decomposition:
        """A decomposition of all its attributes, with arrays that need no check: it takes as long as an update."""
        decomposition = object.__new__(Decomposition)
        for name, value in attributes.items():
            if isinstance(value, np.ndarray):
                value = value.view()
                value.setflags(write=False)
            object.__setattr__(decomposition, name, value)
        return decomposition

    def _array(self, name: str, dtype: type, shape: tuple[int, ...]) -> int:
        """Turns an attribute into a read-only contiguous array; returns its length."""
        given = getattr(self, name)
        try:
            array: NDArray[Any] = np.ascontiguousarray(given, dtype=dtype).view()
        except (TypeError, ValueError) as error:
            raise InvalidDecompositionError(f"{name}: {error}") from error
        if array.ndim != len(shape) or any(
            want not in (-1, have) for want, have in zip(shape, array.shape, strict=True)
        ):
            raise InvalidDecompositionError(f"{name} has shape {array.shape}, expected {shape}")
        if dtype is np.float64 and not np.isfinite(array).all():
            raise InvalidDecompositionError(f"{name}: a value is not finite")
        array.setflags(write=False)
        object.__setattr__(self, name, array)
        return len(array)

    @staticmethod
    def _check_range(name: str, indices: Indices, length: int) -> None:
        if indices.size and (indices.min() < 0 or indices.max() >= length):
            raise InvalidDecompositionError(f"{name}: an index is outside 0 to {length - 1}")

    # --- cells ---

    def locate(self, points: ArrayLike) -> Indices:
        """Cells of points (m, 3) [m]: (m,), -1 outside the workspace. On a border, the cell in front."""
        return locate_points(self._points(points), *self.tree, self.bounds.lower, self.bounds.upper)

    def is_free(self, points: ArrayLike) -> Flags:
        """(m,) whether points (m, 3) [m] lie in free cells."""
        cells = self.locate(points)
        return np.asarray((cells >= 0) & ~self.node_solid[cells])

    def cell_polytope(self, cell: int) -> ConvexPolytope | None:
        """The polytope of a cell; None for a cell that is little more than a rounding error.

        That is one with less than four faces of 1e-10 m^2, e.g. a needle 10 um wide.

        Raises:
            IndexError: if there is no such cell.
        """
        if not 0 <= cell < len(self.node_front) or self.node_front[cell] >= 0:
            raise IndexError(f"node {cell} is no cell")
        corners, offsets, planes = cell_faces(cell, *self.tree, self.bounds.lower, self.bounds.upper)
        # Of a sliver only the faces that are wider than rounding are left: no polytope.
        if len(planes) < 4:
            return None
        distances = np.abs(corners[:, None] - corners[None]).max(axis=2)
        first = (distances < SAME_VERTEX).argmax(axis=1)
        kept, index = np.unique(first, return_inverse=True)
        faces = tuple(index[begin:end] for begin, end in zip(offsets[:-1], offsets[1:], strict=True))
        return ConvexPolytope(corners[kept], faces, planes)

    @property
    def free_cells(self) -> Indices:
        """Indices of the free cells."""
        return np.flatnonzero((self.node_front < 0) & ~self.node_solid)

    @property
    def leaves(self) -> Indices:
        """Indices of all cells, free and solid."""
        return np.flatnonzero(self.node_front < 0)

    @property
    def cell_count(self) -> int:
        """Number of free cells."""
        return len(self.free_cells)

    @property
    def section_height(self) -> float:
        """Height of the plane that a 2D decomposition is of [m]."""
        return float(0.5 * (self.bounds.lower[2] + self.bounds.upper[2]))

    # --- portals and graph ---

    @property
    def portal_count(self) -> int:
        return len(self.portal_cells)

    @property
    def candidate_count(self) -> int:
        return len(self.candidates)

    def portal(self, index: int) -> Floats:
        """(c, 3) corners of a portal [m]."""
        return self.portal_corners[self.portal_offsets[index] : self.portal_offsets[index + 1]]

    @property
    def edge_count(self) -> int:
        """Number of edges of the connectivity graph."""
        by_cell = np.diff(self.cell_candidates[0])
        by_portal = np.bincount(self.candidate_portals, minlength=1)
        # Candidates of one portal meet in both of its cells.
        return int((by_cell * (by_cell - 1) // 2).sum() - (by_portal * (by_portal - 1) // 2).sum())

    def edges(self) -> Indices:
        """(e, 2) the edges of the connectivity graph, as indices of candidates, the lower first; large."""
        return list_edges(self.candidate_portals, self.portal_cells, *self.cell_candidates)

    @property
    def tree(self) -> tuple[Floats, Indices, Indices]:
        """`node_planes`, `node_front`, `node_back`: arguments of the kernels."""
        return self.node_planes, self.node_front, self.node_back

    @cached_property
    def cell_candidates(self) -> tuple[Indices, Indices]:
        """Where each node's list of candidates begins (n + 1,), and the lists, one after the other (2 k,)."""
        return candidates_by_cell(self.candidate_portals, self.portal_cells, len(self.node_front))

    @staticmethod
    def _points(points: ArrayLike) -> NDArray[np.float64]:
        array = np.ascontiguousarray(points, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != 3:
            raise ValueError(f"points of shape {array.shape}: expected (m, 3)")
        return array


def decompose(scene: Scene, options: DecompositionOptions | None = None) -> Decomposition:
    """Decomposes the workspace of a scene by binary space partitioning (paper, Algorithm 2, lines 1 to 3).

    Free cells hold no obstacle, up to `BspOptions.plane_tolerance`, so that segments between points of a free cell are
    collision-free for a point. Cells without interior count as solid.

    Args:
        scene: obstacles and workspace.
        options: defaults if None.

    Raises:
        InvalidObstacleError: if an obstacle has a shape without volume.
    """
    options = options or DecompositionOptions()
    begin = time.perf_counter()
    bounds = decomposed_bounds(scene, options)
    facets = read_facets(scene, options)
    scene_seconds = time.perf_counter() - begin
    return decomposition_of(construct(facets, bounds, options), scene, bounds, options, scene_seconds)


def decomposition_of(
    construction: Construction,
    scene: Scene,
    bounds: WorkspaceBounds,
    options: DecompositionOptions,
    scene_seconds: float,
) -> Decomposition:
    """What has been constructed, as a decomposition of a scene.

    Args:
        construction: from the facets of the scene.
        scene: gives frame and revision.
        bounds: see `decomposed_bounds`.
        options: what it was constructed by.
        scene_seconds: time that it took to read the scene.
    """
    return Decomposition._of_own_arrays(
        dimension=options.dimension,
        bounds=bounds,
        node_planes=construction.node_planes,
        node_front=construction.node_front,
        node_back=construction.node_back,
        node_solid=construction.node_solid,
        portal_corners=construction.portal_corners,
        portal_offsets=construction.portal_offsets,
        portal_cells=construction.portal_cells,
        candidates=construction.candidates,
        candidate_portals=construction.candidate_portals,
        candidate_clearances=construction.candidate_clearances,
        clearance_cap=options.clearance_cap,
        frame=scene.frame,
        scene_revision=scene.revision,
        timings=DecompositionTimings(
            scene_seconds,
            construction.partition_seconds,
            construction.portal_seconds,
            construction.graph_seconds,
        ),
        facet_count=construction.facets.facet_count,
        split_count=construction.split_count,
    )
