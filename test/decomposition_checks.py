"""What every decomposition must be like."""

from __future__ import annotations

import numpy as np
import pytest
from random_scenes import signed_distance

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.scene.polytopes import ConvexPolytope
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

# Facets move by up to 0.1 mm inwards and 1 mm outwards.
INWARDS, OUTWARDS = 1e-4, 1e-3
# Across a needle, a cell without a polytope.
NEEDLE = 1e-4


def cell_volumes(decomposition: Decomposition) -> list[float]:
    polytopes = [decomposition.cell_polytope(int(cell)) for cell in decomposition.leaves]
    return [0.0 if polytope is None else polytope.volume for polytope in polytopes]


def polytope_of(decomposition: Decomposition, cell: int) -> ConvexPolytope:
    polytope = decomposition.cell_polytope(int(cell))
    assert polytope is not None
    return polytope


def assert_cells_fill_the_workspace(decomposition: Decomposition) -> None:
    bounds = decomposition.bounds
    volumes = cell_volumes(decomposition)
    assert min(volumes) >= -1e-9
    assert sum(volumes) == pytest.approx(np.prod(bounds.upper - bounds.lower), rel=1e-5)


def assert_flags_are_right(decomposition: Decomposition, scene: Scene, points: FloatArray) -> None:
    free = decomposition.is_free(points)
    distance = signed_distance(scene, points)
    assert not (free & (distance < -INWARDS)).any()
    assert not (~free & (distance > OUTWARDS)).any()


def assert_portals_are_between_free_cells(decomposition: Decomposition) -> None:
    polytopes = {int(cell): decomposition.cell_polytope(int(cell)) for cell in np.unique(decomposition.portal_cells)}
    for portal in range(decomposition.portal_count):
        corners = decomposition.portal(portal)
        assert len(corners) >= 3
        for cell in decomposition.portal_cells[portal]:
            assert not decomposition.node_solid[cell]
            polytope = polytopes[int(cell)]
            if polytope is None:
                # A needle, whose ends are too small for faces: so narrow is each of its portals too.
                assert np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)[1] < NEEDLE
            else:
                assert polytope.contains(corners, tolerance=1e-5).all()


def assert_candidates_are_on_their_portals(decomposition: Decomposition, margin: float) -> None:
    for candidate, portal in zip(decomposition.candidates, decomposition.candidate_portals, strict=True):
        corners = decomposition.portal(int(portal))
        centre = corners.mean(axis=0)
        sides = np.roll(corners, -1, axis=0) - corners
        normal = np.cross(sides[0], centre - corners[0])
        inward = np.cross(normal, sides)
        inward /= np.linalg.norm(inward, axis=1, keepdims=True) + 1e-300
        distances = ((candidate - corners) * inward).sum(axis=1)
        alone = np.count_nonzero(decomposition.candidate_portals == portal) == 1
        assert distances.min() >= (0.0 if alone else margin) - 1e-9
        assert abs((candidate - corners[0]) @ normal) <= 1e-6 * np.linalg.norm(normal)


def assert_portals_cover_the_borders_of_free_cells(decomposition: Decomposition, rng: np.random.Generator) -> None:
    """The faces of all free cells are portals, walls of the workspace, or borders of solid cells."""
    for cell in decomposition.free_cells:
        polytope = decomposition.cell_polytope(int(cell))
        if polytope is None:
            continue
        of_cell = (decomposition.portal_cells == cell).any(axis=1)
        polygons = [decomposition.portal(int(portal)) for portal in np.flatnonzero(of_cell)]
        for face, plane in enumerate(polytope.planes):
            corners = polytope.polygon(face)
            point = rng.dirichlet(np.ones(len(corners))) @ corners
            beyond = decomposition.locate((point + 1e-5 * plane[:3])[None])[0]
            if beyond < 0 or decomposition.node_solid[beyond]:
                continue
            inside = [abs((point - p[0]) @ plane[:3]) < 1e-6 and _turns(p, point, plane[:3]) for p in polygons]
            assert any(inside)


def _turns(polygon: FloatArray, point: FloatArray, normal: FloatArray) -> bool:
    """Whether a point of its plane is in a convex polygon, of either direction."""
    turns = np.cross(np.roll(polygon, -1, axis=0) - polygon, point - polygon) @ normal
    return bool((turns > -1e-6).all() or (turns < 1e-6).all())
