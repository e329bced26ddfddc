"""What every convex polytope has to satisfy."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.scene.convex_polytope import ConvexPolytope


def assert_valid(polytope: ConvexPolytope, tolerance: float = 1e-8) -> None:
    """Planes contain all vertices and their own face; faces are convex, ordered and closed (Euler's formula)."""
    vertices, planes = polytope.vertices, polytope.planes
    np.testing.assert_allclose(np.linalg.norm(planes[:, :3], axis=1), 1.0, atol=1e-12)
    assert len(polytope.faces) == len(planes)
    assert polytope.distance(vertices).max() <= tolerance
    directed: set[tuple[int, int]] = set()
    for face, plane in zip(polytope.faces, planes, strict=True):
        corners = vertices[face]
        assert len(face) >= 3
        np.testing.assert_allclose(corners @ plane[:3], plane[3], atol=tolerance)
        sides = np.roll(corners, -1, axis=0) - corners
        turns = np.cross(sides, np.roll(sides, -1, axis=0)) @ plane[:3]
        assert (turns > 0.0).all(), "not convex, or not counter-clockwise seen from outside"
        for pair in zip(face.tolist(), np.roll(face, -1).tolist(), strict=True):
            assert pair not in directed
            directed.add(pair)
    assert {(b, a) for a, b in directed} == directed
    assert len(polytope.edges) == len(directed) // 2
    assert len(vertices) - len(polytope.edges) + len(planes) == 2
    assert set(np.concatenate(polytope.faces).tolist()) == set(range(len(vertices)))
