"""Covers of rigid bodies: trees of balls around them, and balls inside of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.cover_kernels import (
    assign_cells,
    cover_greedily,
    enclosing_ball,
    shrunk_ball,
)
from bsp_informed_planner.collision.solid_kernels import (
    CELL_SIZE,
    balls_around,
    cut_into_cells,
    medial_balls,
    recut_cells,
)
from bsp_informed_planner.collision.solids import Body, Solid
from bsp_informed_planner.scene.pose import FloatArray

#: Longer solids have covers that are coarser, as much as they are longer, so that they take no more time [m].
LARGE = 1.5


@dataclass(frozen=True)
class CoverOptions:
    """How fine covers are.

    Attributes:
        protrusions: how far the balls of each level of a tree stand out of the body at most [m], the finest last.
        cells_per_protrusion: edge of the smallest cells, as a share of the finest protrusion.
        most_cells: along the surface of a group of bodies: larger ones have coarser cells.
        most_leaves: of a group's tree, about: no level is begun that would have more.
        medial_samples: balls that are tried, for each group.
        node_candidates: most cells around which balls are tried, in each node.
        sample: cells on which candidates are compared.
        inner_balls: most balls inside a group.
        inner_gain: a further ball inside has to hold this share of the group's inner cells.
    """

    protrusions: tuple[float, ...] = (0.05, 0.018, 0.005)
    cells_per_protrusion: float = 0.25
    most_cells: int = 250_000
    most_leaves: int = 20_000
    medial_samples: int = 800
    node_candidates: int = 150
    sample: int = 3000
    inner_balls: int = 32
    inner_gain: float = 0.003

    def for_extent(self, extent: float) -> CoverOptions:
        """The same, coarser for a group with a solid that is longer than `LARGE` [m], as is the solid."""
        factor = max(extent / LARGE, 1.0)
        return replace(self, protrusions=tuple(factor * protrusion for protrusion in self.protrusions))


@dataclass(eq=False)
class Node:
    """A ball of a tree, and the cells that it stands for.

    Attributes:
        ball: (4,) centre and radius; it holds all cells [m].
        cells: (n, 7) centre, half edge, signed distance, margin, index of the solid that it is of.
        protrusion: how far the ball may stand out of the bodies [m].
        children: whose cells are these cells, or parts of them; none for a leaf.
    """

    ball: FloatArray
    cells: FloatArray
    protrusion: float = math.inf
    children: list[Node] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Cover:
    """Balls around and inside of a group of bodies, in the frame of their joint.

    Attributes:
        outer: (m, 4) a tree of balls, depth first: centres and radii [m]. The leaves cover the bodies; a node holds
            all of the bodies that its leaves are there for.
        ends: (m,) index after the last node below a node.
        inner: (k, 4) balls that lie in the bodies.
    """

    outer: FloatArray
    ends: np.ndarray
    inner: FloatArray


@dataclass(frozen=True, eq=False)
class RobotCovers:
    """Covers of all groups of a robot's bodies.

    Attributes:
        covers: of each group.
        clear_pairs: (k, 2) groups that never touch, although they are checked against each other.
    """

    covers: tuple[Cover, ...]
    clear_pairs: NDArray[np.int64]


class CoverBuilder:
    """Covers a group of rigid bodies.

    The bodies are cut into small cubes, which hold all of them, surface and inside (`cut_into_cells`). A ball counts as
    covering a cube only if it holds all of it, so that a cover of the cubes is a proved cover of the bodies. Covers are
    found greedily among balls around medial points, whose radii let them stand out of the bodies by a given protrusion;
    balls that then turn out larger than the cubes they are there for need are shrunk (about their
    centres: the smallest ball around the same cubes may stand out more). The cubes of each ball are
    covered by finer balls in the same way, level by level.

    Args:
        bodies: fixed to each other, in one frame.
        options: see there.
        seed: of the choice of candidates.
    """

    def __init__(self, bodies: Sequence[Body], options: CoverOptions | None = None, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)
        self._solids = [solid for body in bodies for solid in body.solids]
        self._options = (options or CoverOptions()).for_extent(max(map(_extent, self._solids), default=0.0))
        self._balls = np.concatenate([np.empty((0, 4)), *(body.balls for body in bodies)])
        cells = np.concatenate([np.empty((0, 7)), *(self._cells(i) for i in range(len(self._solids)))])
        cells = cells[self._rng.permutation(len(cells))]
        self._medial = np.concatenate(
            [np.empty((0, 4)), *(self._medial_balls(i, cells) for i in range(len(self._solids)))]
        )
        exact = np.zeros((len(self._balls), 7))
        exact[:, :3], exact[:, 4], exact[:, 5] = self._balls[:, :3], -self._balls[:, 3], self._balls[:, 3]
        exact[:, 6] = -1.0
        self.root = Node(np.zeros(4), np.concatenate([cells, exact]))
        first = np.append(self.root.cells[:, :3].mean(axis=0), 0.0)
        self.root.ball = (
            _exact(self.root.cells) if len(self.root.cells) == 1 else enclosing_ball(self.root.cells, first)
        )
        self._inner_cells = cells[cells[:, 4] < 0.0]
        self._inner: FloatArray | None = None

    def _cells(self, index: int) -> FloatArray:
        """(n, 7) cells of a solid."""
        solid = self._solids[index]
        low, high = solid.bounds
        area = max(sum(other.area for other in self._solids), 1e-12)
        finest = self._options.protrusions[-1] * self._options.cells_per_protrusion
        # About 1.5 cells lie on an area of one of their faces.
        smallest = 0.5 * max(finest, math.sqrt(1.5 * area / self._options.most_cells))
        extent = 0.5 * float((high - low).max()) * (1.0 + 1e-6)
        half = smallest * 2.0 ** max(math.ceil(math.log2(extent / smallest)), 0)
        edges, length = solid.open_edges
        every, middle = np.arange(len(solid.triangles)), 0.5 * (low + high)
        found = cut_into_cells(
            solid.triangles, solid.balls, solid.grid, every, edges, length, middle, half, smallest, 4.0 * smallest
        )
        return _columns(found, index)

    def _medial_balls(self, index: int, cells: FloatArray) -> FloatArray:
        inside = cells[(cells[:, 4] < 0.0) & (cells[:, 6] == index)]
        if not len(inside):
            return np.empty((0, 4))
        solid = self._solids[index]
        triangles = solid.outermost if len(solid.outermost) else solid.triangles
        # Enough for any mesh, and bounded in time for a large one.
        count = int(min(len(inside), self._options.medial_samples, 1 + 1_500_000 // len(triangles)))
        # Cells near the surface, which are the smallest, see every part of it.
        weights = 1.0 / inside[:, 3]
        points = inside[self._rng.choice(len(inside), count, replace=False, p=weights / weights.sum()), :3]
        return medial_balls(np.ascontiguousarray(points), triangles, balls_around(triangles), 1e-4)

    def sharpen(self, node: Node, protrusion: float) -> None:
        """`refine`, with cells that are small enough for a protrusion finer than those of the options."""
        if node.children:
            return
        finest = 0.5 * protrusion * self._options.cells_per_protrusion * (1.0 + 1e-6)
        coarse = node.cells[:, 3] > finest
        parts = [node.cells[~coarse]]
        for index, solid in enumerate(self._solids):
            own = np.ascontiguousarray(node.cells[coarse & (node.cells[:, 6] == index)])
            if len(own):
                found = recut_cells(
                    own, node.ball, solid.triangles, solid.balls, solid.grid, *solid.open_edges, finest, 4.0 * finest
                )
                parts.append(_columns(found, index))
        node.cells = np.concatenate(parts)
        node.cells = node.cells[self._rng.permutation(len(node.cells))]
        self.refine(node, protrusion)

    def refine(self, node: Node, protrusion: float) -> None:
        """Give a leaf children that stand out of the bodies by less; nothing happens if it is a single cell."""
        if node.children or len(node.cells) < 2:
            return
        near = np.linalg.norm(self._medial[:, :3] - node.ball[:3], axis=1) < node.ball[3]
        some = self._rng.permutation(len(node.cells))[: self._options.node_candidates]
        own = np.concatenate([node.cells[some, :3], -node.cells[some, 4:5]], axis=1)
        medial = self._medial[near]
        medial = medial[self._rng.permutation(len(medial))[: 3 * self._options.node_candidates]]
        candidates = np.concatenate([medial, own])
        candidates[:, 3] += protrusion
        candidates = candidates[candidates[:, 3] > 0.0]
        balls = cover_greedily(node.cells, candidates, protrusion, self._options.sample)
        owners = assign_cells(node.cells, balls)
        children = []
        for index, ball in enumerate(balls):
            cells = np.ascontiguousarray(node.cells[owners == index])
            if len(cells):
                children.append(Node(_exact(cells) if len(cells) == 1 else shrunk_ball(cells, ball), cells, protrusion))
        if len(children) > 1:
            node.children = children
        elif children and children[0].ball[3] < node.ball[3]:
            node.ball = children[0].ball
        node.protrusion = min(node.protrusion, protrusion) if not node.children else node.protrusion

    def leaves(self) -> list[Node]:
        """The leaves of the tree, in the order in which `cover` gives them."""
        found, stack = [], [self.root]
        while stack:
            node = stack.pop()
            if node.children:
                stack.extend(reversed(node.children))
            else:
                found.append(node)
        return found

    def build(self) -> None:
        """The whole tree."""
        leaves = [self.root]
        before = math.inf
        for protrusion in self._options.protrusions:
            # A surface takes about that many more balls. Large ones are left coarse.
            if math.isfinite(before) and len(leaves) * (before / protrusion) ** 2 > self._options.most_leaves:
                break
            before = protrusion
            for leaf in leaves:
                self.refine(leaf, protrusion)
            leaves = [below for leaf in leaves for below in (leaf.children or [leaf])]

    def inner_balls(self) -> FloatArray:
        """(k, 4) balls inside the bodies, which fill as much of them as so many can."""
        options = self._options
        found = [self._balls]
        if len(self._inner_cells) and len(self._medial):
            sample = self._inner_cells[self._rng.permutation(len(self._inner_cells))[:1500]]
            tried = self._medial[self._rng.permutation(len(self._medial))[:800]]
            weights = sample[:, 3] ** 3
            inside = np.linalg.norm(sample[:, None, :3] - tried[None, :, :3], axis=2) < tried[:, 3]
            left = np.ones(len(sample), dtype=bool)
            for _ in range(options.inner_balls):
                gains = (weights * left) @ inside
                best = int(np.argmax(gains))
                if gains[best] < options.inner_gain * weights.sum():
                    break
                left &= ~inside[:, best]
                ball = tried[best].copy()
                for solid in self._solids:
                    radius = ball[3] - solid.gap - 1e-6
                    if radius > 1e-4 and solid.holds(ball[:3], radius):
                        found.append(np.append(ball[:3], radius)[None])
                        break
        return np.concatenate(found)

    def cover(self) -> Cover:
        """The tree as it is, and balls inside."""
        outer, ends = _depth_first(self.root)
        if self._inner is None:
            self._inner = self.inner_balls()
        return Cover(outer, ends, self._inner)


def _extent(solid: Solid) -> float:
    """Its longest edge, along the axes [m]."""
    low, high = solid.bounds
    return float((high - low).max())


def _exact(cells: FloatArray) -> FloatArray:
    """The ball around a single cell."""
    return np.append(cells[0, :3], (np.sqrt(3.0) * cells[0, 3]) * (1.0 + 1e-9) + cells[0, 5])


def _columns(found: FloatArray, index: int) -> FloatArray:
    """(n, 7) cells of a solid, from those of `cut_into_cells`."""
    cells = np.zeros((len(found), 7))
    cells[:, :CELL_SIZE] = found
    cells[:, 6] = index
    return cells


def _depth_first(root: Node) -> tuple[FloatArray, np.ndarray]:
    """Balls (m, 4) and ends (m,) of a tree."""
    balls: list[FloatArray] = []
    ends: list[int] = []

    def visit(node: Node) -> None:
        index = len(balls)
        balls.append(node.ball)
        ends.append(0)
        for child in node.children:
            visit(child)
        ends[index] = len(balls)

    visit(root)
    return np.array(balls), np.array(ends, dtype=np.int64)
