"""Checks of a decomposition against its obstacles. Each counts violations, by code of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np

from bsp_informed_planner.collision.geometry import obstacle_geometries
from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.scene.polytopes import ConvexPolytope, polytopes_of_obstacle
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

# Rounding of corners of cells, and how far out of its cells a portal may stick [m].
ROUNDING, ON_BORDER = 2e-6, 1e-5
# Volumes of cells must add up to the workspace, relatively, up to this.
VOLUME = 1e-5
# Facets move by up to 0.1 mm inwards and 1 mm outwards (`BspOptions`), and no further than rounding beyond that.
INWARDS, OUTWARDS = 1.05e-4, 1.01e-3
# Where two moved facets meet at a sharp edge, or at the tip of a cone, the edge moves further.
DEPTH = 1e-3
# Radius of the capsules that stand for edges, and how far they are moved aside where coal fails [m].
THIN, ASIDE = 1e-6, 1e-5
# No distance is below this, negative [m].
FAILED = 1e6


@dataclass(frozen=True)
class CellCounts:
    """Violations among cells.

    Attributes:
        not_convex: cells with a corner beyond one of their planes, or with negative volume.
        overlapping: cells one of whose inner points belongs to another cell.
        not_filling: 1 if the volumes of all cells do not add up to the workspace.
        slivers: free cells that are too thin to have a polytope (about 1 um); no violation.
    """

    not_convex: int
    overlapping: int
    not_filling: int
    slivers: int


def check_cells(decomposition: Decomposition, rng: np.random.Generator) -> CellCounts:
    """Convex, disjoint, and filling the workspace."""
    not_convex, slivers, total = 0, 0, 0.0
    owners, points = [], []
    polytopes = []
    for cell in decomposition.leaves.tolist():
        polytope = decomposition.cell_polytope(cell)
        if polytope is None:
            slivers += not decomposition.node_solid[cell]
            continue
        volume = polytope.volume
        total += volume
        not_convex += bool(polytope.distance(polytope.vertices).max() > ROUNDING) or volume < -1e-12
        inner = rng.dirichlet(np.ones(len(polytope.vertices)), 3) @ polytope.vertices
        inner = inner[polytope.distance(inner) < -ROUNDING]
        owners.append(np.full(len(inner), cell))
        points.append(inner)
        polytopes.append(polytope)
    size = decomposition.bounds.upper - decomposition.bounds.lower
    inside = np.concatenate([np.empty((0, 3)), *points])
    owner = np.concatenate([np.empty(0, np.int64), *owners])
    misplaced = np.unique(owner[decomposition.locate(inside) != owner])
    # The tree alone could hide an overlap: random points must lie in one polytope each.
    somewhere = rng.uniform(decomposition.bounds.lower, decomposition.bounds.upper, (30, 3))
    holders = sum(polytope.contains(somewhere, -ROUNDING).astype(int) for polytope in polytopes)
    overlapping = len(misplaced) + int((np.asarray(holders) > 1).sum())
    return CellCounts(not_convex, overlapping, int(abs(total / float(np.prod(size)) - 1.0) > VOLUME), slivers)


def bodies_of(scene: Scene) -> list[ConvexPolytope]:
    """The polytopes of all obstacles, which for curved ones are circumscribed."""
    return [part for obstacle in scene.obstacles.values() for part in polytopes_of_obstacle(obstacle, scene.bounds)]


def points_to_check(
    decomposition: Decomposition, bodies: Sequence[ConvexPolytope], rng: np.random.Generator, count: int
) -> FloatArray:
    """(m, 3) points all over the workspace, and as many again in obstacles and next to their surfaces [m].

    In the plane all have the height of the section.
    """
    lower, upper = decomposition.bounds.lower, decomposition.bounds.upper
    groups = [rng.uniform(lower, upper, (count, 3))]
    for body in bodies:
        each = max(2, count // (2 * len(bodies)))
        groups.append(rng.dirichlet(np.full(len(body.vertices), 0.5), each) @ body.vertices)
        face = body.faces[int(rng.integers(len(body.faces)))]
        on_face = rng.dirichlet(np.ones(len(face)), each) @ body.vertices[face]
        groups.append(on_face + rng.normal(0.0, 2e-3, on_face.shape))
    points = np.concatenate(groups)
    if decomposition.dimension == 2:
        points[:, 2] = decomposition.section_height
    return points[decomposition.bounds.contains(points)]


def check_flags(
    decomposition: Decomposition, bodies: Sequence[ConvexPolytope], points: FloatArray, solid_too: bool
) -> tuple[int, int]:
    """Points (m, 3) in an obstacle whose cell is free, and points beyond all obstacles whose cell is not.

    Args:
        decomposition: of the scene.
        bodies: its obstacles.
        points: [m].
        solid_too: whether to count the second; distances in space say nothing of sections of tilted bodies.
    """
    free = decomposition.is_free(points)
    distances = np.full(len(points), np.inf)
    for body in bodies:
        distances = np.minimum(distances, body.distance(points))
    in_free = int((free & (distances < -INWARDS)).sum())
    return in_free, int((~free & (distances > OUTWARDS)).sum()) if solid_too else 0


def check_portals(decomposition: Decomposition) -> int:
    """Portals that do not join two different free cells, or are not on the border of both.

    Of a cell that is too thin to have a polytope the border is not known.
    """
    found: dict[int, ConvexPolytope | None] = {}
    for cell in np.unique(decomposition.portal_cells).tolist():
        found[cell] = decomposition.cell_polytope(cell)
    wrong = 0
    for portal in range(decomposition.portal_count):
        first, second = decomposition.portal_cells[portal].tolist()
        corners = decomposition.portal(portal)
        good = first != second and len(corners) >= 3
        for cell in (first, second):
            polytope = found[cell]
            good &= not decomposition.node_solid[cell]
            good &= polytope is None or bool((np.abs(polytope.distance(corners)) <= ON_BORDER).all())
        wrong += not good
    return wrong


def random_edges(decomposition: Decomposition, rng: np.random.Generator, count: int) -> FloatArray:
    """(m, 2, 3) ends of random edges of the connectivity graph [m], at most so many."""
    edges = decomposition.edges()
    if len(edges) > count:
        edges = edges[rng.choice(len(edges), count, replace=False)]
    return np.asarray(decomposition.candidates[edges])


def colliding_by_clipping(edges: FloatArray, bodies: Sequence[ConvexPolytope]) -> int:
    """Edges (m, 2, 3) that pass deeper than the tolerance through a convex body.

    Exact: a segment is clipped by the planes of a body, moved inwards (Cyrus and Beck 1978).
    """
    hit = np.zeros(len(edges), np.bool_)
    for body in bodies:
        normals, offsets = body.planes[:, :3], body.planes[:, 3] - INWARDS
        at_start, at_end = (edges[:, end] @ normals.T - offsets for end in (0, 1))
        slope = at_end - at_start
        with np.errstate(divide="ignore", invalid="ignore"):
            share = -at_start / slope
        enter = np.where(slope < 0.0, share, -np.inf).max(axis=1, initial=0.0)
        leave = np.where(slope > 0.0, share, np.inf).min(axis=1, initial=1.0)
        beside = ((slope == 0.0) & (at_start >= 0.0)).any(axis=1)
        hit |= ~beside & (leave - enter > 1e-9)
    return int(hit.sum())


class EdgeJudge:
    """A second opinion: coal's distance between obstacles, in their own shapes, and edges as thin capsules.

    Args:
        scene: the obstacles.
    """

    def __init__(self, scene: Scene) -> None:
        self._obstacles = [
            (geometry, coal.Transform3s(placement.rotation, placement.translation))
            for obstacle in scene.obstacles.values()
            for geometry, placement in obstacle_geometries(obstacle)
        ]
        self._request = coal.DistanceRequest()

    def depth(self, start: FloatArray, end: FloatArray) -> float:
        """How deep the segment between two points (3,) lies in an obstacle [m]; negative outside, -inf without any,
        inf if coal finds no distance."""
        along = end - start
        length = float(np.linalg.norm(along))
        axis = along / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
        side = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
        side /= np.linalg.norm(side)
        rotation, middle = np.column_stack((side, np.cross(axis, side), axis)), 0.5 * (start + end)
        capsule = coal.Capsule(THIN, length)
        deepest = -np.inf
        for geometry, placement in self._obstacles:
            for aside in (0.0, ASIDE, -ASIDE, 2.0 * ASIDE):
                pose = coal.Transform3s(rotation, middle + aside * side)
                distance = float(
                    coal.distance(geometry, placement, capsule, pose, self._request, coal.DistanceResult())
                )
                # Where bodies just touch, coal's penetration algorithm may fail and return the lowest number there is.
                if distance > -FAILED:
                    deepest = max(deepest, -distance)
                    break
            else:
                deepest = np.inf
        return deepest

    def colliding(self, edges: FloatArray) -> int:
        """How many edges (m, 2, 3) lie deeper in an obstacle than tolerances explain."""
        return sum(self.depth(start, end) > DEPTH for start, end in edges)
