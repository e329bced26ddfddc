"""Shapes, obstacles and scenes refuse what is no body, and cannot be changed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bsp_informed_planner.errors import InvalidObstacleError, InvalidWorkspaceError
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cone, ConvexMesh, Cylinder, HalfSpace, Mesh, Sphere

TETRAHEDRON = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
BOUNDS = WorkspaceBounds(np.full(3, -1.0), np.full(3, 1.0))


@pytest.mark.parametrize(
    "make",
    [
        lambda: Box(np.array([1.0, 0.0, 1.0])),
        lambda: Box(np.array([1.0, -1.0, 1.0])),
        lambda: Box(np.array([1.0, np.nan, 1.0])),
        lambda: Box(np.array([1.0, 1.0])),
        lambda: Sphere(0.0),
        lambda: Sphere(np.inf),
        lambda: Cylinder(0.1, -1.0),
        lambda: Cylinder(np.nan, 1.0),
        lambda: Cone(0.0, 1.0),
        lambda: ConvexMesh(TETRAHEDRON[:3]),
        lambda: ConvexMesh(TETRAHEDRON * [1.0, 1.0, 0.0]),
        lambda: ConvexMesh(np.zeros((0, 3))),
        lambda: ConvexMesh(np.full((5, 3), np.nan)),
        lambda: Mesh(TETRAHEDRON, TRIANGLES + 1),
        lambda: Mesh(TETRAHEDRON, TRIANGLES - 1),
        lambda: Mesh(TETRAHEDRON, TRIANGLES[:3]),
        lambda: Mesh(TETRAHEDRON, TRIANGLES[:, :2]),
        lambda: Mesh(TETRAHEDRON * [1.0, 0.0, 1.0], TRIANGLES),
        lambda: HalfSpace(np.zeros(3), 0.0),
        lambda: HalfSpace(np.array([0.0, 0.0, 1.0]), np.nan),
    ],
)
def test_bad_shapes_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - the messages are read by people
        make()


def test_half_space_is_scaled_to_a_unit_normal() -> None:
    plane = HalfSpace(np.array([0.0, 0.0, 2.0]), -1.0)
    np.testing.assert_array_equal(plane.normal, [0.0, 0.0, 1.0])
    assert plane.offset == -0.5
    again = HalfSpace(plane.normal, plane.offset)
    np.testing.assert_array_equal(again.normal, plane.normal)
    assert again.offset == plane.offset


def test_shapes_do_not_share_memory_with_what_they_were_made_from() -> None:
    size = np.ones(3)
    box = Box(size)
    size[0] = 5.0
    assert box.size[0] == 1.0


def test_obstacle_needs_id_and_shapes() -> None:
    with pytest.raises(InvalidObstacleError):
        Obstacle.of("", Sphere(0.1))
    with pytest.raises(InvalidObstacleError) as caught:
        Obstacle("empty", ())
    assert caught.value.obstacle_id == "empty"


def test_placed_shapes_are_in_the_frame_of_the_scene() -> None:
    obstacle = Obstacle(
        "a", ((Sphere(0.1), Pose.from_xyz_rpy([1, 0, 0])),), Pose.from_xyz_rpy([0, 0, 1], [0, 0, np.pi / 2])
    )
    np.testing.assert_allclose(obstacle.placed_shapes()[0][1].position, [0, 1, 1], atol=1e-15)


def test_scene_refuses_a_repeated_id_and_a_wrong_key() -> None:
    with pytest.raises(InvalidObstacleError) as caught:
        Scene.of([Obstacle.of("a", Sphere(0.1)), Obstacle.of("a", Sphere(0.2))], BOUNDS)
    assert caught.value.obstacle_id == "a"
    with pytest.raises(InvalidObstacleError):
        Scene({"b": Obstacle.of("a", Sphere(0.1))}, BOUNDS)


def test_scene_cannot_be_changed() -> None:
    given = {"a": Obstacle.of("a", Sphere(0.1))}
    scene = Scene(given, BOUNDS)
    given.clear()
    assert list(scene.obstacles) == ["a"]
    with pytest.raises(TypeError):
        scene.obstacles["b"] = scene.obstacles["a"]  # type: ignore[index]


@pytest.mark.parametrize("upper", [[1.0, 1.0, -1.0], [1.0, 1.0, -0.9995], [1.0, 1.0, np.nan], [1.0, 1.0]])
def test_bad_bounds_are_refused(upper: list[float]) -> None:
    with pytest.raises(InvalidWorkspaceError):
        WorkspaceBounds(np.full(3, -1.0), np.array(upper))


def test_bounds_contain_their_border() -> None:
    np.testing.assert_array_equal(BOUNDS.contains(np.array([[1.0, 1, 1], [0, 0, 0], [0, 0, 1.1]])), [True, True, False])
