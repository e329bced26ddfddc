"""Convex parts of meshes cover the mesh."""

from __future__ import annotations

import numpy as np
import pytest

from bsp_informed_planner.scene.convex_polytope import box_polytope, hull_polytope
from bsp_informed_planner.scene.mesh_parts import SLAB_THICKNESS, convex_parts
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.shapes import Mesh

# A square bracket: an L of unit width, extruded by 1. Its solid has volume 3.
_L = np.array([[0.0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]])


def bracket() -> Mesh:
    vertices = np.concatenate([np.column_stack((_L, np.full(6, z))) for z in (0.0, 1.0)])
    cap = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    triangles = [triangle[::-1] for triangle in cap] + [[corner + 6 for corner in triangle] for triangle in cap]
    for k in range(6):
        after = (k + 1) % 6
        triangles += [[k, after, after + 6], [k, after + 6, k + 6]]
    return Mesh(vertices, np.array(triangles))


def box_mesh(size: FloatArray, invert: bool = False, without: int | None = None) -> Mesh:
    box = box_polytope(size)
    triangles = [
        [face[0], face[k], face[k + 1]] for index, face in enumerate(box.faces) if index != without for k in (1, 2)
    ]
    array = np.array(triangles)
    return Mesh(box.vertices, array[:, ::-1] if invert else array)


def outside_by(mesh: Mesh, points: FloatArray) -> float:
    return float(np.min([hull_polytope(part).distance(points) for part in convex_parts(mesh)], axis=0).max())


@pytest.mark.parametrize("invert", [False, True])
def test_convex_mesh_is_one_part(invert: bool) -> None:
    mesh = box_mesh(np.array([1.0, 2.0, 3.0]), invert)
    (part,) = convex_parts(mesh)
    assert len(part) == 8
    assert hull_polytope(part).volume == pytest.approx(6.0)


def test_repeated_vertices_of_an_stl_file_do_not_matter() -> None:
    mesh = box_mesh(np.ones(3))
    soup = Mesh(mesh.vertices[mesh.triangles.ravel()], np.arange(mesh.triangles.size).reshape(-1, 3))
    (part,) = convex_parts(soup)
    assert hull_polytope(part).volume == pytest.approx(1.0)


@pytest.mark.parametrize("inverted", [False, True])
def test_repeated_triangles_do_not_matter(inverted: bool) -> None:
    """A surface that is drawn twice, or from both sides, still encloses a solid."""
    mesh = box_mesh(np.ones(3))
    again = mesh.triangles[:, ::-1] if inverted else mesh.triangles
    (part,) = convex_parts(Mesh(mesh.vertices, np.concatenate((mesh.triangles, again))))
    assert hull_polytope(part).volume == pytest.approx(1.0)


def test_concave_mesh_is_covered_and_not_filled() -> None:
    mesh = bracket()
    parts = convex_parts(mesh)
    assert len(parts) >= 2
    volume = sum(hull_polytope(part).volume for part in parts)
    assert 3.0 - 1e-3 <= volume <= 3.3
    inside = np.random.default_rng(0).uniform(0.0, 1.0, (4000, 3)) * [2.0, 2.0, 1.0]
    inside = inside[(inside[:, 0] < 1.0) | (inside[:, 1] < 1.0)]
    assert outside_by(mesh, np.concatenate((mesh.vertices, inside))) <= 1e-5
    notch = np.array([[1.5, 1.5, 0.5]])
    assert outside_by(mesh, notch) > 0.3


def test_decomposition_is_deterministic_and_kept() -> None:
    first, second = convex_parts(bracket()), convex_parts(bracket())
    assert all(a is b for a, b in zip(first, second, strict=True))  # kept by content, not by identity
    moved = Mesh(bracket().vertices + 1e-3, bracket().triangles)
    assert convex_parts(moved)[0] is not first[0]


def test_separate_pieces_are_decomposed_separately() -> None:
    one, two = box_mesh(np.ones(3)), box_mesh(np.full(3, 0.5))
    both = Mesh(
        np.concatenate((one.vertices, two.vertices + [3.0, 0, 0])), np.concatenate((one.triangles, two.triangles + 8))
    )
    assert sorted(round(hull_polytope(part).volume, 9) for part in convex_parts(both)) == [0.125, 1.0]


def test_open_surface_is_a_shell_of_slabs() -> None:
    # A tray: a box without its upper face (+z). Its inside must stay free.
    mesh = box_mesh(np.array([0.4, 0.4, 0.2]), without=5)
    parts = convex_parts(mesh)
    assert len(parts) == 10
    assert outside_by(mesh, mesh.vertices) <= 0.0
    assert outside_by(mesh, np.array([[0.0, 0.0, 0.0]])) == pytest.approx(0.1 - 0.5 * SLAB_THICKNESS)


def test_parts_are_read_only() -> None:
    for part in convex_parts(box_mesh(np.ones(3))):
        assert not part.flags.writeable
