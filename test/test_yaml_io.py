"""Scene files of our own."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bsp_informed_planner.scene.yaml_io as yaml_io
from bsp_informed_planner.errors import InvalidObstacleError, InvalidWorkspaceError, SceneFormatError
from bsp_informed_planner.scene.convex_polytope import box_polytope
from bsp_informed_planner.scene.json_io import scene_from_json, scene_to_json
from bsp_informed_planner.scene.maze import environment
from bsp_informed_planner.scene.moveit_yaml import load_scene
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import (
    Box,
    Cone,
    ConvexMesh,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from bsp_informed_planner.scene.shelf import random_shelf
from bsp_informed_planner.scene.yaml_io import problem_from_yaml, save_scene, scene_from_yaml, scene_to_yaml

BOUNDS = WorkspaceBounds(np.array([-1.0, -0.3, 0.1]), np.array([1.0, 1 / 3, 2e-3 + 0.1]))
TETRAHEDRON = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])

number = st.floats(-1e3, 1e3)
length = st.floats(1e-7, 1e6)
point = st.tuples(number, number, number)
poses = st.builds(Pose.from_xyz_rpy, point, st.tuples(*[st.floats(-4.0, 4.0)] * 3))
tetrahedra = st.tuples(point, st.floats(1e-3, 1e3)).map(lambda drawn: TETRAHEDRON * drawn[1] + drawn[0])
shapes = st.one_of(
    st.builds(Box, st.tuples(length, length, length).map(np.array)),
    st.builds(Sphere, length),
    st.builds(Cylinder, length, length),
    st.builds(Cone, length, length),
    st.builds(ConvexMesh, tetrahedra),
    st.builds(lambda vertices: Mesh(vertices, TRIANGLES), tetrahedra),
    st.builds(HalfSpace, st.tuples(number, number, st.floats(0.1, 9.0)).map(np.array), number),
)
obstacles = st.builds(
    lambda name, placed, pose: Obstacle(name, tuple(placed), pose),
    st.text(min_size=1, max_size=8).filter(str.isprintable),
    st.lists(st.tuples(shapes, poses), min_size=1, max_size=3),
    poses,
)


def same_shape(one: Shape, two: Shape) -> bool:
    assert type(one) is type(two)
    return all(np.array_equal(value, getattr(two, name)) for name, value in vars(one).items())


def same_scene(one: Scene, two: Scene) -> bool:
    assert list(one.obstacles) == list(two.obstacles)
    for a, b in zip(one.obstacles.values(), two.obstacles.values(), strict=True):
        assert a.pose == b.pose
        assert len(a.shapes) == len(b.shapes)
        for (shape_a, pose_a), (shape_b, pose_b) in zip(a.shapes, b.shapes, strict=True):
            assert same_shape(shape_a, shape_b)
            assert pose_a == pose_b
    return (one.bounds, one.frame, one.revision) == (two.bounds, two.frame, two.revision)


@given(st.lists(obstacles, max_size=4, unique_by=lambda obstacle: obstacle.id), st.integers(0, 2**60))
@settings(max_examples=60, deadline=None)
def test_round_trip_is_exact(listed: list[Obstacle], revision: int) -> None:
    scene = Scene.of(listed, BOUNDS, "base link: 1", revision % 2**50)
    assert same_scene(scene_from_json(scene_to_json(scene)), scene)
    assert same_scene(scene_from_yaml(scene_to_yaml(scene)), scene)


def test_generated_scenes_round_trip(tmp_path: Path) -> None:
    scene = random_shelf(np.random.default_rng(1)).scene
    path = tmp_path / "shelf.yaml"
    save_scene(path, scene)
    assert same_scene(load_scene(path), scene)


def test_problem_round_trip() -> None:
    maze = environment(1).problem
    problem = ScenarioProblem(
        maze.scene, maze.start, maze.goals, (Pose.from_xyz_rpy([1, 2, 3], [0.1, 0, 0]),), "ein Weg"
    )
    again = problem_from_yaml(scene_to_yaml(problem))
    assert same_scene(again.scene, problem.scene)
    np.testing.assert_array_equal(again.start, problem.start)
    np.testing.assert_array_equal(again.goals, problem.goals)
    assert again.goal_poses == problem.goal_poses
    assert again.description == "ein Weg"


def test_example_in_the_documentation(tmp_path: Path) -> None:
    """The docstring promises a file; here it is read."""
    documentation = yaml_io.__doc__ or ""
    begin = documentation.index("    format:")
    text = textwrap.dedent(documentation[begin : documentation.index("\nKeys that")])
    (tmp_path / "parts").mkdir()
    write_stl(tmp_path / "parts" / "bracket.stl", 1000.0)
    write_stl(tmp_path / "cloud.ply", 0.5)
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    problem = problem_from_yaml(path)
    scene = problem.scene
    assert (scene.frame, scene.revision) == ("base_link", 3)
    kinds = [type(shape) for shape, _ in scene.obstacles["others"].shapes]
    assert kinds == [Sphere, Cone, HalfSpace, ConvexMesh, Mesh, Mesh]
    measured = [shape for shape, _ in scene.obstacles["measured"].shapes]
    assert [len(cloud.points) for cloud in measured if isinstance(cloud, PointCloud)] == [2, 8]
    from_file = scene.obstacles["others"].shapes[-1][0]
    assert isinstance(from_file, Mesh)
    np.testing.assert_allclose(np.ptp(from_file.vertices, axis=0), [1, 1, 1])
    assert problem.description == "into the shelf"
    np.testing.assert_array_equal(problem.goal_poses[0].position, [0.6, 0, 0.4])


def write_stl(path: Path, scale: float) -> None:
    import trimesh

    box = box_polytope([scale] * 3)
    faces = [[face[0], face[k], face[k + 1]] for face in box.faces for k in (1, 2)]
    written = trimesh.Trimesh(box.vertices, faces, process=False).export(file_type=path.suffix[1:])
    path.write_bytes(written if isinstance(written, bytes) else written.encode())


HEAD = """
format: bsp_informed_planner/scene/1
bounds: {lower: [-1, -1, -1], upper: [1, 1, 1]}
"""


def with_shape(shape: str) -> str:
    return f"{HEAD}obstacles:\n  - id: culprit\n    shapes:\n      - {shape}\n"


def test_numbers_without_a_dot_before_the_exponent_are_numbers() -> None:
    scene = scene_from_yaml(with_shape("box: [1e-3, 1, 2e0]"))
    ((shape, _),) = scene.obstacles["culprit"].shapes
    assert isinstance(shape, Box)
    np.testing.assert_array_equal(shape.size, [0.001, 1, 2])


def test_empty_scene() -> None:
    assert scene_from_yaml(HEAD).is_empty
    assert scene_from_yaml(HEAD + "obstacles:\n").is_empty


@pytest.mark.parametrize(
    ("shape", "place"),
    [
        ("box: [.nan, 1, 1]", "obstacles[0].shapes[0]"),
        ("box: [.inf, 1, 1]", "obstacles[0].shapes[0]"),
        ("box: [0, 1, 1]", "obstacles[0].shapes[0]"),
        ("sphere: {radius: -1}", "obstacles[0].shapes[0]"),
        ("cylinder: {radius: 1, height: 0}", "obstacles[0].shapes[0]"),
        ("cone: {radius: .nan, height: 1}", "obstacles[0].shapes[0]"),
        ("half_space: {normal: [0, 0, 0], offset: 1}", "obstacles[0].shapes[0]"),
        ("half_space: {normal: [0, 0, 1], offset: .nan}", "obstacles[0].shapes[0]"),
        ("convex: {vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]}", "obstacles[0].shapes[0]"),
        ("convex: {vertices: []}", "obstacles[0].shapes[0]"),
        (
            (
                "mesh: {vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "
                "triangles: [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 4]]}"
            ),
            "obstacles[0].shapes[0]",
        ),
        (
            (
                "mesh: {vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], "
                "triangles: [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]}"
            ),
            "obstacles[0].shapes[0]",
        ),
        ("{box: [1, 1, 1], pose: {position: [.nan, 0, 0]}}", "obstacles[0].shapes[0]"),
        ("{box: [1, 1, 1], pose: {orientation: [0, 0, 0, 0]}}", "obstacles[0].shapes[0]"),
        ("{box: [1, 1, 1], pose: {rpy: [.nan, 0, 0]}}", "obstacles[0].shapes[0]"),
    ],
)
def test_numbers_that_make_no_body_name_the_obstacle(shape: str, place: str) -> None:
    with pytest.raises(InvalidObstacleError) as caught:
        scene_from_yaml(with_shape(shape))
    assert caught.value.obstacle_id == "culprit"
    assert place in caught.value.reason


def test_bad_pose_and_missing_shapes_and_repeated_ids_name_the_obstacle() -> None:
    box = "shapes: [{box: [1, 1, 1]}]"
    for text in (
        f"{HEAD}obstacles:\n  - {{id: culprit, {box}, pose: {{position: [0, .inf, 0]}}}}\n",
        f"{HEAD}obstacles:\n  - {{id: culprit, shapes: []}}\n",
        f"{HEAD}obstacles:\n  - {{id: culprit, {box}}}\n  - {{id: culprit, {box}}}\n",
    ):
        with pytest.raises(InvalidObstacleError) as caught:
            scene_from_yaml(text)
        assert caught.value.obstacle_id == "culprit"


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("", "top level"),
        ("[1, 2]", "top level"),
        ("format: other/1", "format"),
        ("format: bsp_informed_planner/scene/1", "bounds"),
        (HEAD + "colour: red", "colour"),
        (HEAD + "revision: -1", "revision"),
        (HEAD + "revision: 1.5", "revision"),
        (HEAD + "frame: [a]", "frame"),
        (HEAD + "obstacles: {}", "obstacles"),
        (HEAD + "obstacles: [1]", "obstacles[0]"),
        (HEAD + "obstacles: [{shapes: []}]", "'id' is missing"),
        (HEAD + "obstacles: [{id: a}]", "'shapes' is missing"),
        (HEAD + "obstacles: [{id: a, shapes: [], shape: 1}]", "unknown key 'shape'"),
        (HEAD + "obstacles: []\nobstacles: []", "repeated"),
        (HEAD + "obstacles: [{id: a, id: b, shapes: []}]", "repeated"),
        (with_shape("box: [1, 1]"), "obstacles[0].shapes[0].box: expected 3 numbers"),
        (with_shape("box: [1, x, 1]"), "obstacles[0].shapes[0].box[1]"),
        (with_shape("box: [1, true, 1]"), "obstacles[0].shapes[0].box[1]"),
        (with_shape("{box: [1, 1, 1], sphere: {radius: 1}}"), "exactly one"),
        (with_shape("{pose: {}}"), "exactly one"),
        (with_shape("{box: [1, 1, 1], pose: {rpy: [0, 0, 0], orientation: [0, 0, 0, 1]}}"), "exclude"),
        (with_shape("sphere: 1"), "obstacles[0].shapes[0].sphere: expected a mapping"),
        (with_shape("mesh: {vertices: [[0, 0]], triangles: []}"), "mesh.vertices[0]"),
        (with_shape("mesh: {vertices: [], triangles: [[0, 1, 0.5]]}"), "mesh.triangles[0]"),
        (with_shape("mesh: {vertices: [], triangles: [[0, 1, .nan]]}"), "mesh.triangles[0]"),
        (with_shape("mesh: {file: a.stl}"), "without a folder"),
        (HEAD + "obstacles: [", "line"),
        (HEAD + "obstacles: !!python/object/apply:os.system [ls]", "python/object"),
        ("[" * 100_000, "nested"),
        ("[" * 100_000 + "]" * 100_000, "nested"),
        ("a: " + "x" * 40_000_000, "larger"),
        ("\x00", "<text>"),
    ],
)
def test_what_is_no_scene_names_the_place(text: str, place: str) -> None:
    with pytest.raises(SceneFormatError) as caught:
        scene_from_yaml(text)
    assert place in str(caught.value)
    assert caught.value.path == "<text>"


def test_aliases_cannot_be_used_to_fill_the_memory() -> None:
    lists = "\n".join(f"      - &l{k} [{', '.join([f'*l{k - 1}'] * 10) if k else '1, ' * 9 + '1'}]" for k in range(12))
    with pytest.raises(SceneFormatError):
        scene_from_yaml(f"{HEAD}obstacles:\n  - id: a\n    shapes:\n{lists}\n")
    row = "[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]"
    many = ", ".join(["*o"] * 3000)
    shape = f"&s {{convex: {{vertices: {row}}}}}"
    text = f"{HEAD}obstacles: [&o {{id: a, shapes: [{shape}, {', '.join(['*s'] * 3000)}]}}, {many}]"
    with pytest.raises((SceneFormatError, InvalidObstacleError)):
        scene_from_yaml(text)


def test_bad_bounds() -> None:
    for upper in ("[1, 1, -1]", "[1, .nan, 1]"):
        with pytest.raises(InvalidWorkspaceError):
            scene_from_yaml(f"format: bsp_informed_planner/scene/1\nbounds: {{lower: [-1, -1, -1], upper: {upper}}}")


def test_problem_errors() -> None:
    with pytest.raises(SceneFormatError, match="problem"):
        problem_from_yaml(HEAD)
    for problem in ("{start: [0, 0]}", "{start: [0, 0], goals: [[1]]}", "{start: [.nan], goals: [[1]]}", "{start: []}"):
        with pytest.raises(SceneFormatError, match="problem"):
            problem_from_yaml(f"{HEAD}problem: {problem}")


def test_mesh_files_are_confined_to_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    write_stl(tmp_path / "outside.stl", 1.0)
    (folder / "link.stl").symlink_to(tmp_path / "outside.stl")
    (folder / "notes.txt").write_text("no mesh")
    (folder / "broken.stl").write_text("no mesh either")
    (folder / "empty.obj").write_text("# nothing\n")
    path = folder / "scene.yaml"
    for name, reason in (
        ("../outside.stl", "outside of the folder"),
        ("link.stl", "outside of the folder"),
        (str(tmp_path / "outside.stl"), "relative"),
        ("file:///outside.stl", "relative"),
        ("missing.stl", "does not exist"),
        ("notes.txt", "expected one of"),
        ("broken.stl", "broken.stl"),
        ("empty.obj", "empty.obj"),
    ):
        path.write_text(with_shape(f"mesh: {{file: '{name}'}}"))
        with pytest.raises(SceneFormatError, match=reason):
            scene_from_yaml(path)


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".off"])
def test_mesh_files(tmp_path: Path, suffix: str) -> None:
    write_stl(tmp_path / f"box{suffix}", 100.0)
    path = tmp_path / "scene.yaml"
    path.write_text(with_shape(f"mesh: {{file: box{suffix}, scale: [0.01, 0.02, 0.03]}}"))
    ((shape, _),) = scene_from_yaml(path).obstacles["culprit"].shapes
    assert isinstance(shape, Mesh)
    np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), [1, 2, 3])
    path.write_text(with_shape(f"mesh: {{file: box{suffix}, scale: 0}}"))
    with pytest.raises(SceneFormatError, match="scale"):
        scene_from_yaml(path)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(SceneFormatError, match=r"nowhere\.yaml"):
        scene_from_yaml(tmp_path / "nowhere.yaml")


def test_json_is_one_line_without_what_is_default() -> None:
    scene = Scene.of([Obstacle.of("a", Sphere(0.5), Pose.from_xyz_rpy([1.0, 0.0, 0.0], [0.0, 0.0, 0.0]))], BOUNDS)
    text = scene_to_json(scene)
    assert "\n" not in text
    assert text.count("pose") == 1
    assert scene_to_json(scene_from_json(text)) == text


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": "bsp_informed_planner/scene/1"}'])
def test_json_of_no_scene_is_refused(text: str) -> None:
    with pytest.raises(SceneFormatError, match="row 7"):
        scene_from_json(text, "row 7")
