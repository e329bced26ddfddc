"""Changes of scenes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bsp_informed_planner.errors import InvalidObstacleError, UnknownObstacleError
from bsp_informed_planner.scene.diff import ObstacleOperation, OperationKind, SceneDiff, apply
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Sphere

BOUNDS = WorkspaceBounds(np.full(3, -1.0), np.full(3, 1.0))
ids = st.sampled_from(["a", "b", "c", "d"])
poses = st.builds(Pose.from_xyz_rpy, st.tuples(*[st.floats(-2.0, 2.0)] * 3), st.tuples(*[st.floats(-4.0, 4.0)] * 3))
obstacles = st.builds(Obstacle.of, ids, st.builds(Sphere, st.floats(0.01, 1.0)), poses)


def scene_of(*obstacles: Obstacle, revision: int = 5) -> Scene:
    return Scene.of(obstacles, BOUNDS, "base", revision)


@given(st.lists(obstacles, unique_by=lambda obstacle: obstacle.id), obstacles)
def test_adding_and_removing_gives_the_same(present: list[Obstacle], new: Obstacle) -> None:
    scene = scene_of(*present)
    after = apply(scene, SceneDiff.of(ObstacleOperation.add(new)))
    assert after.obstacles[new.id] is new
    assert after.revision == 6
    assert (after.frame, after.bounds) == (scene.frame, scene.bounds)
    removed = apply(after, SceneDiff.of(ObstacleOperation.remove(new.id)))
    expected = {key: value for key, value in scene.obstacles.items() if key != new.id}
    assert dict(removed.obstacles) == expected
    assert list(removed.obstacles) == list(expected)


def test_replacing_keeps_the_order() -> None:
    scene = scene_of(Obstacle.of("a", Sphere(0.1)), Obstacle.of("b", Sphere(0.1)))
    new = Obstacle.of("a", Sphere(0.2))
    after = apply(scene, SceneDiff.of(ObstacleOperation.add(new)))
    assert list(after.obstacles.values()) == [new, scene.obstacles["b"]]


@given(obstacles, poses)
def test_moving_keeps_the_shapes(obstacle: Obstacle, pose: Pose) -> None:
    moved = apply(scene_of(obstacle), SceneDiff.of(ObstacleOperation.move(obstacle.id, pose))).obstacles[obstacle.id]
    assert moved.pose == pose
    assert moved.shapes is obstacle.shapes


@given(poses, poses, poses)
def test_appended_shapes_are_where_they_were_said_to_be(place: Pose, other: Pose, local: Pose) -> None:
    scene = scene_of(Obstacle.of("a", Sphere(0.1), place))
    addition = Obstacle("a", ((Box(np.ones(3)), local),), other)
    after = apply(scene, SceneDiff.of(ObstacleOperation.append(addition))).obstacles["a"]
    assert after.pose == place
    (first, second) = after.placed_shapes()
    assert first[1] == scene.obstacles["a"].placed_shapes()[0][1]
    np.testing.assert_allclose(second[1].matrix, (other * local).matrix, atol=1e-9)


def test_removing_all() -> None:
    scene = scene_of(Obstacle.of("a", Sphere(0.1)), Obstacle.of("b", Sphere(0.1)))
    new = Obstacle.of("c", Sphere(0.1))
    after = apply(scene, SceneDiff.replacing_all([new]))
    assert dict(after.obstacles) == {"c": new}
    assert apply(after, SceneDiff.of(ObstacleOperation.remove())).is_empty


def test_bounds_can_change() -> None:
    bounds = WorkspaceBounds(np.zeros(3), np.ones(3))
    assert apply(scene_of(), SceneDiff(bounds=bounds)).bounds is bounds


@pytest.mark.parametrize(
    ("operation", "name"),
    [
        (ObstacleOperation.remove("z"), "REMOVE"),
        (ObstacleOperation.move("z", Pose.identity()), "MOVE"),
        (ObstacleOperation.append(Obstacle.of("z", Sphere(0.1))), "APPEND"),
    ],
)
def test_failed_change_has_no_effect(operation: ObstacleOperation, name: str) -> None:
    scene = scene_of(Obstacle.of("a", Sphere(0.1)))
    before = dict(scene.obstacles)
    diff = SceneDiff.of(ObstacleOperation.remove("a"), ObstacleOperation.add(Obstacle.of("b", Sphere(0.1))), operation)
    with pytest.raises(UnknownObstacleError) as caught:
        apply(scene, diff)
    assert (caught.value.obstacle_id, caught.value.operation, caught.value.known) == ("z", name, ("b",))
    assert dict(scene.obstacles) == before
    assert scene.revision == 5


def test_operations_see_those_before_them() -> None:
    new = Obstacle.of("n", Sphere(0.1))
    diff = SceneDiff.of(ObstacleOperation.add(new), ObstacleOperation.move("n", Pose.from_xyz_rpy([1, 0, 0])))
    np.testing.assert_array_equal(apply(scene_of(), diff).obstacles["n"].pose.position, [1, 0, 0])


@pytest.mark.parametrize(
    "arguments",
    [
        (OperationKind.ADD, "a", None, None),
        (OperationKind.ADD, "b", Obstacle.of("a", Sphere(0.1)), None),
        (OperationKind.ADD, "a", Obstacle.of("a", Sphere(0.1)), Pose.identity()),
        (OperationKind.MOVE, "a", None, None),
        (OperationKind.MOVE, "", None, Pose.identity()),
        (OperationKind.REMOVE, "a", None, Pose.identity()),
        (OperationKind.REMOVE, "a", Obstacle.of("a", Sphere(0.1)), None),
    ],
)
def test_operations_whose_parts_do_not_fit_are_refused(arguments: tuple) -> None:
    with pytest.raises(InvalidObstacleError):
        ObstacleOperation(*arguments)
