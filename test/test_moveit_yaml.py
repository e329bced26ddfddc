"""MoveIt's planning scenes in YAML."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bsp_informed_planner.errors import InvalidObstacleError, SceneFormatError
from bsp_informed_planner.scene.moveit_yaml import DEFAULT_BOUNDS, load_scene, scene_from_moveit_yaml
from bsp_informed_planner.scene.scene import WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cone, Cylinder, HalfSpace, Mesh, Sphere
from bsp_informed_planner.scene.yaml_io import scene_to_yaml

# As MotionBenchMaker writes it: names of types, lists, extra parts of the planning scene.
BENCHMARK = """
name: (noname)
robot_state:
  joint_state:
    name: [shoulder_pan_joint]
    position: [0.0]
robot_model_name: ur5
fixed_frame_transforms:
  - header: {frame_id: world}
    child_frame_id: world
    transform: {translation: [0, 0, 0], rotation: [0, 0, 0, 1]}
allowed_collision_matrix:
  entry_names: [base_link]
world:
  collision_objects:
    - header:
        frame_id: world
      id: Can1
      primitives:
        - type: cylinder
          dimensions: [0.14, 0.03]
      primitive_poses:
        - position: [0.9, 0, 1.08]
          orientation: [0, 0, 0, 1]
    - id: side_cap
      primitives:
        - type: box
          dimensions: [0.7, 0.7, 0.04]
      primitive_poses:
        - position: [0.9, 0, 1.35]
          orientation: [0, 0.383, 0, 0.924]
"""

# As ROS tools print the message: numbers of types, mappings, poses of the object and of its shapes.
MESSAGE = """
is_diff: false
world:
  collision_objects:
  - header:
      stamp: {sec: 0, nanosec: 0}
      frame_id: base_link
    pose:
      position: {x: 1.0, y: 0.0, z: 0.0}
      orientation: {x: 0.0, y: 0.0, z: 1.0, w: 0.0}
    id: mixed
    type: {key: '', db: ''}
    primitives:
    - {type: 1, dimensions: [0.1, 0.2, 0.3]}
    - {type: 2, dimensions: [0.1]}
    - {type: 4, dimensions: [0.2, 0.1]}
    primitive_poses:
    - position: {x: 0.5, y: 0.0, z: 0.0}
      orientation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}
    - position: {x: 0.0, y: 0.0, z: 0.0}
      orientation: {x: 0.0, y: 0.0, z: 0.0, w: 0.0}
    - position: {x: 0.0, y: 0.0, z: 0.0}
      orientation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}
    meshes:
    - triangles:
      - vertex_indices: [0, 2, 1]
      - vertex_indices: [0, 1, 3]
      - vertex_indices: [1, 2, 3]
      - vertex_indices: [0, 3, 2]
      vertices:
      - {x: 0.0, y: 0.0, z: 0.0}
      - {x: 1.0, y: 0.0, z: 0.0}
      - {x: 0.0, y: 1.0, z: 0.0}
      - {x: 0.0, y: 0.0, z: 1.0}
    mesh_poses:
    - position: {x: 0.0, y: 0.0, z: 0.0}
      orientation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}
    planes:
    - coef: [0.0, 0.0, 2.0, 1.0]
    plane_poses:
    - position: {x: 0.0, y: 0.0, z: 0.0}
      orientation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}
    operation: 0
  octomap:
    octomap: {data: []}
"""


def test_benchmark_file(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(BENCHMARK)
    scene = load_scene(path)
    assert list(scene.obstacles) == ["Can1", "side_cap"]
    assert (scene.frame, scene.bounds) == ("world", DEFAULT_BOUNDS)
    can = scene.obstacles["Can1"].placed_shapes()[0]
    assert can[0] == Cylinder(radius=0.03, height=0.14)
    np.testing.assert_array_equal(can[1].position, [0.9, 0, 1.08])
    cap = scene.obstacles["side_cap"].placed_shapes()[0][1]
    assert np.linalg.norm(cap.quaternion) == pytest.approx(1.0)


def test_message() -> None:
    scene = scene_from_moveit_yaml(MESSAGE)
    assert scene.frame == "base_link"
    placed = scene.obstacles["mixed"].placed_shapes()
    assert [type(shape) for shape, _ in placed] == [Box, Sphere, Cone, Mesh, HalfSpace]
    np.testing.assert_allclose(placed[0][1].position, [0.5, 0, 0], atol=1e-15)
    np.testing.assert_allclose(placed[3][1].apply([1.0, 0, 0]), [0, 0, 0], atol=1e-15)
    assert placed[2][0] == Cone(radius=0.1, height=0.2)
    plane = placed[4][0]
    assert isinstance(plane, HalfSpace)
    assert plane.offset == 0.5


def test_what_is_read_can_be_saved_in_our_own_format(tmp_path: Path) -> None:
    scene = scene_from_moveit_yaml(MESSAGE)
    path = tmp_path / "scene.yaml"
    path.write_text(scene_to_yaml(scene))
    assert scene_to_yaml(load_scene(path)) == scene_to_yaml(scene)


def test_given_bounds_win(tmp_path: Path) -> None:
    bounds = WorkspaceBounds(np.zeros(3), np.ones(3))
    own = tmp_path / "own.yaml"
    own.write_text(scene_to_yaml(scene_from_moveit_yaml(BENCHMARK)))
    assert scene_from_moveit_yaml(BENCHMARK, bounds).bounds == bounds
    assert load_scene(own, bounds).bounds == bounds


def test_fixed_frames_are_resolved() -> None:
    text = """
fixed_frame_transforms:
  - header: {frame_id: world}
    child_frame_id: table
    transform: {translation: {x: 1, y: 0, z: 0}, rotation: {x: 0, y: 0, z: 1, w: 0}}
world:
  collision_objects:
    - {header: {frame_id: table}, id: a, primitives: [{type: sphere, dimensions: [0.1]}],
       primitive_poses: [{position: [1, 0, 0], orientation: [0, 0, 0, 1]}]}
"""
    scene = scene_from_moveit_yaml(text)
    assert scene.frame == "world"
    np.testing.assert_allclose(scene.obstacles["a"].placed_shapes()[0][1].position, [0, 0, 0], atol=1e-15)


@pytest.mark.parametrize("wrapper", ["planning_scene", "scene"])
def test_wrapped_scenes(wrapper: str) -> None:
    indented = "\n".join("  " + line for line in BENCHMARK.splitlines())
    assert len(scene_from_moveit_yaml(f"{wrapper}:\n{indented}\n").obstacles) == 2


def one(object_: str) -> str:
    return f"world:\n  collision_objects:\n    - {{id: culprit, {object_}}}\n"


@pytest.mark.parametrize(
    "text",
    [
        one("primitives: [{type: box, dimensions: [0, 1, 1]}]"),
        one("primitives: [{type: sphere, dimensions: [.nan]}]"),
        one("primitives: [{type: sphere, dimensions: [1]}], pose: {position: [.inf, 0, 0]}"),
        one("primitives: [{type: sphere, dimensions: [1]}], primitive_poses: [{orientation: [0, 0, 0, 9]}]"),
        one("planes: [{coef: [0, 0, 0, 1]}]"),
        one("meshes: [{vertices: [[0, 0, 0]], triangles: [[0, 0, 1], [0, 0, 0], [0, 0, 0], [0, 0, 0]]}]"),
        one("primitives: []"),
        one("primitives: [{type: sphere, dimensions: [1]}]") + "    - {id: culprit, planes: [{coef: [0, 0, 1, 0]}]}\n",
    ],
)
def test_bad_bodies_name_the_obstacle(text: str) -> None:
    with pytest.raises(InvalidObstacleError) as caught:
        scene_from_moveit_yaml(text)
    assert caught.value.obstacle_id == "culprit"


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("name: x", "collision_objects"),
        (one("primitives: [{type: prism, dimensions: [1]}]"), "primitives[0].type"),
        (one("primitives: [{type: 7, dimensions: [1]}]"), "primitives[0].type"),
        (one("primitives: [{type: box, dimensions: [1, 1]}]"), "3 dimensions"),
        (one("primitives: [{type: sphere, dimensions: [1]}], primitive_poses: [{}, {}]"), "2 primitive_poses"),
        (one("primitives: [{type: sphere, dimensions: [1]}], operation: 1"), "operation"),
        (one("meshes: [{resource: 'package://a/b.stl'}]"), "resource"),
        (one("primitives: [{type: box}]"), "'dimensions' is missing"),
        (
            (
                "world: {collision_objects: [{id: a, header: {frame_id: x}, planes: [[0, 0, 1, 0]]},"
                " {id: b, header: {frame_id: y}, planes: [[0, 0, 1, 0]]}]}"
            ),
            "obstacle 'b' is in frame 'y'",
        ),
        (BENCHMARK.replace("  joint_state:", "  attached_collision_objects: [{}]\n  joint_state:"), "attached"),
        (MESSAGE.replace("data: []", "data: [1, 2]"), "octomap"),
    ],
)
def test_what_cannot_be_understood_names_the_place(text: str, place: str) -> None:
    with pytest.raises(SceneFormatError) as caught:
        scene_from_moveit_yaml(text)
    assert place in str(caught.value)
