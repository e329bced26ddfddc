"""Point clouds: voxels, merged boxes, decomposition, collision, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bsp_informed_planner.collision.certifier import EdgeCertifier, Verdict
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.geometry import octree_voxels, voxel_octree
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import InvalidObstacleError, SceneFormatError
from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.diff import ObstacleOperation, SceneDiff, apply
from bsp_informed_planner.scene.polytopes import polytopes_of_obstacle
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, PointCloud, Sphere
from bsp_informed_planner.scene.voxels import IndexArray, connected_pieces, merge_voxels, merged_boxes
from bsp_informed_planner.scene.yaml_io import scene_from_yaml, scene_to_yaml
from bsp_informed_planner.visualization.shape_triangles import shape_triangles

BOUNDS = WorkspaceBounds(np.full(3, -1.5), np.full(3, 1.5))
# Blocks, some of which touch, with loose voxels around them, far from and across the origin.
voxel_sets = st.builds(
    lambda filled, corner: np.argwhere(filled) + corner,
    hnp.arrays(np.bool_, st.tuples(*3 * [st.integers(1, 7)]), elements=st.booleans(), fill=st.booleans()).filter(
        lambda filled: bool(filled.any())
    ),
    hnp.arrays(np.int64, 3, elements=st.integers(-30000, 30000) | st.integers(-5, 5)),
)


@pytest.fixture(scope="module")
def arm() -> ArmRobot:
    return ur5()


def random_cloud(seed: int = 0, resolution: float = 0.05) -> PointCloud:
    """Two walls, a block and loose points, around the origin."""
    rng = np.random.default_rng(seed)
    walls = rng.uniform(-0.6, 0.6, (2, 4000, 3))
    walls[0, :, 0] = 0.52 + rng.normal(0.0, 0.002, 4000)
    walls[1, :, 2] = -0.31
    block = rng.uniform(0.1, 0.35, (1000, 3))
    return PointCloud(np.concatenate((*walls, block, rng.uniform(-0.6, 0.6, (15, 3)))), resolution)


def box_distances(cloud: PointCloud, points: FloatArray) -> FloatArray:
    """(m,) exact distances of points (m, 3), in the frame of the cloud, from its voxels, 0 inside [m]."""
    lower = cloud.voxels * cloud.resolution
    gaps = np.maximum(lower - points[:, None], points[:, None] - lower - cloud.resolution)
    return np.asarray(np.linalg.norm(np.maximum(gaps, 0.0), axis=2).min(axis=1))


# --- the shape ----------------------------------------------------------------------------------------------------


@given(
    hnp.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.floats(-100, 100)),
    st.floats(0.01, 3.0),
)
def test_every_point_is_in_a_voxel_and_every_voxel_holds_a_point(points: FloatArray, resolution: float) -> None:
    cloud = PointCloud(points, resolution)
    assert len(np.unique(cloud.voxels, axis=0)) == len(cloud.voxels) <= len(points)
    assert box_distances(cloud, cloud.points).max() < 1e-12
    centres = (cloud.voxels + 0.5) * resolution
    nearest = np.abs(centres[:, None] - cloud.points).max(axis=2).min(axis=1)
    assert nearest.max() <= 0.5 * resolution + 1e-12


def test_thinned_keeps_the_body_and_the_first_points() -> None:
    cloud = random_cloud()
    thinned = cloud.thinned()
    np.testing.assert_array_equal(thinned.voxels, cloud.voxels)
    assert len(thinned.points) == len(cloud.voxels) < len(cloud.points)
    np.testing.assert_array_equal(thinned.points[0], cloud.points[0])
    assert thinned.thinned() is thinned


def test_a_cloud_is_frozen() -> None:
    points = np.zeros((2, 3))
    cloud = PointCloud(points, 0.1)
    points[:] = 5.0
    assert not cloud.points.any()
    for array in (cloud.points, cloud.voxels):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


@pytest.mark.parametrize(
    ("points", "resolution", "message"),
    [
        (np.zeros((0, 3)), 0.02, "0 points"),
        (np.zeros((5, 2)), 0.02, "shape"),
        ([[0.0, np.nan, 0.0]], 0.02, "not finite"),
        ([[0.0, np.inf, 0.0]], 0.02, "not finite"),
        (np.zeros((1, 3)), 0.0, "resolution"),
        (np.zeros((1, 3)), float("nan"), "resolution"),
        ([[0.0, 700.0, 0.0]], 0.02, "700 m from the origin"),
        ([[0.0, 1e300, 0.0]], 1e-300, "from the origin"),
    ],
)
def test_bad_clouds(points: object, resolution: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PointCloud(points, resolution)  # type: ignore[arg-type]


def test_clouds_that_are_too_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bsp_informed_planner.scene.shapes.MAX_CLOUD_VOXELS", 10)
    with pytest.raises(ValueError, match="coarser resolution"):
        random_cloud()
    monkeypatch.setattr("bsp_informed_planner.scene.shapes.MAX_CLOUD_POINTS", 100)
    with pytest.raises(ValueError, match="expected 1 to 100"):
        random_cloud()


# --- merged boxes -------------------------------------------------------------------------------------------------


@given(voxel_sets)
def test_merged_boxes_are_disjoint_and_cover_exactly_the_voxels(voxels: IndexArray) -> None:
    lower, upper = merge_voxels(voxels)
    assert (lower < upper).all()
    held = np.concatenate(
        [np.argwhere(np.ones(high - low, dtype=np.bool_)) + low for low, high in zip(lower, upper, strict=True)]
    )
    # As many voxels as given, all different, all of them given: disjoint, and the same set.
    assert len(held) == len(voxels)
    np.testing.assert_array_equal(np.unique(held, axis=0), np.unique(voxels, axis=0))


def test_blocks_become_one_box() -> None:
    block = np.argwhere(np.ones((4, 5, 6), dtype=np.bool_)) - 3
    lower, upper = merge_voxels(block)
    np.testing.assert_array_equal((lower[0], upper[0]), ([-3, -3, -3], [1, 2, 3]))
    assert len(lower) == 1
    # A table: four legs and a board.
    legs = [np.argwhere(np.ones((1, 1, 5), dtype=np.bool_)) + [x, y, -5] for x in (0, 9) for y in (0, 9)]
    board = np.argwhere(np.ones((10, 10, 1), dtype=np.bool_))
    assert len(merge_voxels(np.concatenate((board, *legs)))[0]) == 5


def test_merged_boxes_of_a_cloud() -> None:
    cloud = random_cloud()
    sizes, centres = merged_boxes(cloud)
    assert np.prod(sizes, axis=1).sum() == pytest.approx(len(cloud.voxels) * cloud.resolution**3)
    assert len(sizes) < 0.2 * len(cloud.voxels)
    outside = (np.abs(cloud.points[:, None] - centres) - 0.5 * sizes).max(axis=2).min(axis=1)
    assert outside.max() < 1e-12


@settings(max_examples=50)
@given(voxel_sets)
def test_pieces_hang_together(voxels: IndexArray) -> None:
    pieces = connected_pieces(voxels)
    touching = np.abs(voxels[:, None] - voxels).max(axis=2) <= 1
    reached = np.eye(len(voxels), dtype=np.bool_)
    while True:
        more = (reached.astype(np.float32) @ touching.astype(np.float32)) > 0
        if (more == reached).all():
            break
        reached = more
    np.testing.assert_array_equal(pieces[:, None] == pieces, reached)


# --- decomposition ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pose", [Pose.identity(), Pose.from_xyz_rpy([0.2, -0.1, 0.3], [0.4, -0.3, 1.0])])
def test_free_cells_hold_no_voxel_and_all_else_is_free(pose: Pose) -> None:
    cloud = random_cloud()
    local = Pose.from_xyz_rpy([0.05, 0, 0], [0, 0, 0.3])
    scene = Scene.of([Obstacle("cloud", ((cloud, local),), pose)], BOUNDS)
    decomposition = decompose(scene)
    placed = pose * local
    centres = placed.apply(cloud.voxel_centres)
    assert not decomposition.is_free(centres[BOUNDS.contains(centres)]).any()
    points = np.random.default_rng(1).uniform(BOUNDS.lower, BOUNDS.upper, (3000, 3))
    distances = box_distances(cloud, placed.inverse().apply(points))
    free = decomposition.is_free(points)
    # Facets are moved onto shared planes by up to 1 mm outwards.
    assert free[distances > 2e-3].all()
    nothing = decompose(Scene.of([], BOUNDS))
    assert nothing.is_free(points).all()
    assert len(decomposition.candidates) > 0


def test_points_themselves_are_in_solid_cells() -> None:
    cloud = random_cloud()
    decomposition = decompose(Scene.of([Obstacle.of("cloud", cloud)], BOUNDS))
    # Not those within the tolerances of the surface of the voxels.
    offset = np.abs(cloud.points / cloud.resolution - np.round(cloud.points / cloud.resolution)).min(axis=1)
    assert not decomposition.is_free(cloud.points[offset * cloud.resolution > 2e-4]).any()


def test_a_cloud_decomposes_like_its_boxes() -> None:
    cloud, pose = random_cloud(), Pose.from_xyz_rpy([0.1, 0.2, 0.0], [0, 0, 0.5])
    sizes, centres = merged_boxes(cloud)
    no_turn = np.array([0.0, 0.0, 0.0, 1.0])
    boxes = tuple((Box(size), Pose(centre, no_turn)) for size, centre in zip(sizes, centres, strict=True))
    clouds = Scene.of([Obstacle.of("cloud", cloud, pose), Obstacle.of("ball", Sphere(0.2))], BOUNDS)
    same = Scene.of([Obstacle("cloud", boxes, pose), Obstacle.of("ball", Sphere(0.2))], BOUNDS)
    for options in (DecompositionOptions(), DecompositionOptions(dimension=2, section_height=0.2)):
        first, second = decompose(clouds, options), decompose(same, options)
        np.testing.assert_allclose(first.node_planes, second.node_planes, atol=1e-12)
        np.testing.assert_array_equal(first.node_solid, second.node_solid)
        np.testing.assert_allclose(first.candidates, second.candidates, atol=1e-12)


def test_polytopes_of_a_cloud_in_company() -> None:
    """An obstacle of a cloud and a ball does not go the way of boxes."""
    cloud, pose = random_cloud(), Pose.from_xyz_rpy([0.3, 0, 0.1], [0.5, 0.2, 0.1])
    obstacle = Obstacle("both", ((cloud, Pose.identity()), (Sphere(0.1), Pose.identity())), pose)
    parts = polytopes_of_obstacle(obstacle, BOUNDS)
    assert len(parts) == len(merged_boxes(cloud)[0]) + 1
    points = pose.apply(cloud.points)
    assert np.min([part.distance(points) for part in parts[:-1]], axis=0).max() < 1e-9
    assert decompose(Scene.of([obstacle], BOUNDS)).cell_count > 10


def test_sections_of_a_tilted_cloud() -> None:
    """In 2D a cloud counts where the section cuts its voxels, however the cloud is turned."""
    cloud, pose = random_cloud(), Pose.from_xyz_rpy([0.2, -0.1, 0.3], [0.4, -0.3, 1.0])
    scene = Scene.of([Obstacle.of("cloud", cloud, pose)], BOUNDS)
    points = np.random.default_rng(1).uniform(BOUNDS.lower, BOUNDS.upper, (3000, 3))
    points[:, 2] = 0.2
    free = decompose(scene, DecompositionOptions(dimension=2, section_height=0.2)).is_free(points)
    inside = pose.inverse().apply(points) / cloud.resolution
    depth = 0.5 - np.abs(inside[:, None] - cloud.voxels - 0.5).max(axis=2).min(axis=1)
    assert not free[depth > 0.02].any()
    assert free[depth < -0.1].all()
    assert (depth > 0.02).sum() > 20


def test_moving_a_cloud() -> None:
    cloud = random_cloud()
    scene = Scene.of([Obstacle.of("cloud", cloud)], BOUNDS)
    pose = Pose.from_xyz_rpy([0.0, 0.0, 0.2], [0, 0, 0.4])
    moved = apply(scene, SceneDiff.of(ObstacleOperation.move("cloud", pose)))
    assert moved.obstacles["cloud"].shapes[0][0] is cloud
    centres = pose.apply(cloud.voxel_centres)
    assert not decompose(moved).is_free(centres).any()


# --- collision ----------------------------------------------------------------------------------------------------


@given(voxel_sets, st.floats(0.001, 1.0))
def test_octrees_keep_their_voxels(voxels: IndexArray, resolution: float) -> None:
    np.testing.assert_array_equal(np.unique(octree_voxels(voxel_octree(voxels, resolution)), axis=0), voxels)


@pytest.mark.parametrize("radius", [1e-9, 0.01, 0.12])
@pytest.mark.parametrize("padding", [0.0, 0.03])
@pytest.mark.parametrize("pose", [Pose.identity(), Pose.from_xyz_rpy([0.2, -0.1, 0.05], [0.4, -0.3, 1.0])])
def test_verdicts_of_a_ball_against_brute_force(radius: float, padding: float, pose: Pose) -> None:
    cloud = random_cloud(3)
    robot = PointRobot((-1.0, -1.0), (1.0, 1.0), radius=radius)
    checker = ExactChecker(robot, Scene.of([Obstacle.of("cloud", cloud, pose)], BOUNDS), padding=padding)
    rng = np.random.default_rng(0)
    places = rng.uniform(-1.0, 1.0, (1500, 2))
    # On the grid too, where faces coincide.
    places[:500] = np.round(places[:500] / 0.025) * 0.025
    distances = box_distances(cloud, pose.inverse().apply(np.column_stack((places, np.zeros(1500))))) - radius
    expected = distances > padding
    verdicts = np.array([checker.is_free(place) for place in places])
    clear = np.abs(distances - padding) > 1e-7
    np.testing.assert_array_equal(verdicts[clear], expected[clear])
    assert 15 < verdicts.sum() < 1485
    for place, distance in zip(places[:100], distances[:100], strict=True):
        assert checker.distance(place) == pytest.approx(max(distance, 0.0), abs=1e-6)


@pytest.mark.parametrize("padding", [0.0, 0.02])
def test_verdicts_of_an_arm_are_those_of_the_boxes(arm: ArmRobot, padding: float) -> None:
    cloud, pose = random_cloud(2, 0.04), Pose.from_xyz_rpy([0.15, 0.1, 0.2], [0.1, 0.2, 0.3])
    sizes, centres = merged_boxes(cloud)
    shapes = [(Box(size), Pose.from_xyz_rpy(centre)) for size, centre in zip(sizes, centres, strict=True)]
    as_cloud = ExactChecker(arm, Scene.of([Obstacle.of("cloud", cloud, pose)], BOUNDS), padding=padding)
    as_boxes = ExactChecker(arm, Scene.of([Obstacle("cloud", tuple(shapes), pose)], BOUNDS), padding=padding)
    configurations = np.random.default_rng(0).uniform(-2.0, 2.0, (400, 6))
    verdicts = np.array([as_cloud.is_free(configuration) for configuration in configurations])
    np.testing.assert_array_equal(verdicts, [as_boxes.is_free(configuration) for configuration in configurations])
    assert 20 < verdicts.sum() < 380
    free = configurations[verdicts][:5]
    for configuration in free:
        assert as_cloud.distance(configuration) == pytest.approx(as_boxes.distance(configuration), abs=1e-6)
    hit = configurations[~verdicts]
    assert any("cloud" in (as_cloud.clone().colliding_bodies(configuration) or ()) for configuration in hit[:20])


def test_certified_edges_keep_clear_of_a_cloud(arm: ArmRobot) -> None:
    cloud = random_cloud(2, 0.04)
    scene = Scene.of([Obstacle.of("cloud", cloud, Pose.from_xyz_rpy([0.3, 0.1, 0.3]))], BOUNDS)
    checker = ExactChecker(arm, scene)
    certifier = EdgeCertifier(checker, 0.005)
    rng = np.random.default_rng(4)
    counts = dict.fromkeys(Verdict, 0)
    for start in rng.uniform(-2.0, 2.0, (60, 6)):
        end = start + rng.normal(0.0, 0.2, 6)
        verdict = certifier.certify(start, end)
        counts[verdict] += 1
        if verdict is Verdict.CERTIFIED:
            assert all(checker.is_free(start + share * (end - start)) for share in np.linspace(0.0, 1.0, 50))
    assert counts[Verdict.CERTIFIED] > 3
    assert counts[Verdict.COLLIDING] > 3


def test_a_piece_of_a_cloud_inside_a_link_collides(arm: ArmRobot) -> None:
    configuration = np.array([0.3, -1.0, 0.8, 0.2, 0.1, 0.0])
    place = arm.forward_kinematics(configuration, "upper_arm_link").apply(np.array([0.0, 0.0, 0.2]))
    pose = Pose.from_xyz_rpy(place, [0.1, 0.2, 0.3])
    far = np.argwhere(np.ones((30, 30, 1), dtype=np.bool_)) * 0.02 + [0.0, 0.0, 1.5]
    for crumb in ([[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0], [0.02, 0.0, 0.0]]):
        cloud = PointCloud(np.concatenate((far, crumb)) - 0.005, 0.01)
        checker = ExactChecker(arm, Scene.of([Obstacle.of("cloud", cloud, pose)], BOUNDS))
        for one in (checker, checker.clone()):
            assert not one.is_free(configuration)
            assert one.colliding_bodies(configuration) == ("upper_arm_link", "cloud")
            assert one.distance(configuration) == 0.0
    alone = ExactChecker(arm, Scene.of([Obstacle.of("cloud", PointCloud(far, 0.02), pose)], BOUNDS))
    assert alone.is_free(configuration)
    # No piece of this cloud fits into a link: what is left are the links themselves.
    assert alone._enclosed.candidates == ExactChecker(arm, Scene.of([], BOUNDS))._enclosed.candidates


def test_a_link_inside_a_cloud_collides(arm: ArmRobot) -> None:
    block = (np.argwhere(np.ones((30, 30, 30), dtype=np.bool_)) - 15 + 0.5) * 0.15
    checker = ExactChecker(arm, Scene.of([Obstacle.of("all", PointCloud(block.astype(np.float64), 0.15))], BOUNDS))
    assert not checker.is_free(np.array([0.0, -1.5, 0.3, 0.2, 0.1, 0]))


# --- files and pictures -------------------------------------------------------------------------------------------


def scene_text(cloud: str) -> str:
    return (
        "format: bsp_informed_planner/scene/1\nbounds: {lower: [-1, -1, -1], upper: [1, 1, 1]}\n"
        f"obstacles:\n  - id: seen\n    shapes:\n      - point_cloud: {cloud}\n"
    )


def only_cloud(scene: Scene) -> PointCloud:
    ((shape, _),) = scene.obstacles["seen"].shapes
    assert isinstance(shape, PointCloud)
    return shape


def test_round_trip_through_yaml() -> None:
    cloud = PointCloud(np.random.default_rng(0).normal(size=(100, 3)), 0.03)
    scene = Scene.of([Obstacle.of("seen", cloud, Pose.from_xyz_rpy([1, 2, 3], [0.1, 0.2, 0.3]))], BOUNDS)
    again = scene_from_yaml(scene_to_yaml(scene))
    np.testing.assert_array_equal(only_cloud(again).points, cloud.points)
    assert only_cloud(again).resolution == cloud.resolution
    assert again.obstacles["seen"].pose == scene.obstacles["seen"].pose
    assert only_cloud(scene_from_yaml(scene_text("{points: [[0, 1, 2]]}"))).resolution == 0.02


@pytest.mark.parametrize("suffix", ["npy", "ply", "xyz", "mesh.ply"])
def test_cloud_files(tmp_path: Path, suffix: str) -> None:
    box = trimesh.creation.box((0.5, 0.25, 1.0))
    points = np.asarray(box.vertices)
    if suffix == "npy":
        np.save(tmp_path / "cloud.npy", points)
    elif suffix == "mesh.ply":
        box.export(tmp_path / "cloud.mesh.ply")
    else:
        trimesh.PointCloud(points).export(tmp_path / f"cloud.{suffix}")
    path = tmp_path / "scene.yaml"
    path.write_text(scene_text(f"{{file: cloud.{suffix}, resolution: 0.1}}"))
    np.testing.assert_allclose(only_cloud(scene_from_yaml(path)).points, points, atol=1e-6)


@pytest.mark.parametrize(
    ("cloud", "message"),
    [
        ("{resolution: 0.1}", "either points or a file"),
        ("{points: [[0, 0, 0]], file: a.npy}", "either points or a file"),
        ("{points: [[0, 0, 0]], colour: red}", "unknown key 'colour'"),
        ("{points: [[0, 0]]}", "expected 3 numbers"),
        ("{file: ../a.npy}", "outside of the folder"),
        ("{file: a.txt}", "expected one of .npy"),
        ("{file: missing.npy}", "does not exist"),
        ("{file: objects.npy}", "cannot be read"),
        ("{file: flat.npy}", "shape"),
        ("{file: promise.npy}", "cannot be read"),
        ("{file: broken.ply}", "cannot be read"),
    ],
)
def test_bad_cloud_files(tmp_path: Path, cloud: str, message: str) -> None:
    np.save(tmp_path / "objects.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    np.save(tmp_path / "flat.npy", np.zeros(6))
    np.save(tmp_path / "promise.npy", np.zeros((100, 3)))
    whole = (tmp_path / "promise.npy").read_bytes()
    (tmp_path / "promise.npy").write_bytes(whole[:-100])
    (tmp_path / "broken.ply").write_bytes(b"ply\nnonsense")
    path = tmp_path / "scene.yaml"
    path.write_text(scene_text(cloud))
    with pytest.raises(SceneFormatError, match=message):
        scene_from_yaml(path)
    with pytest.raises(SceneFormatError, match="without a folder"):
        scene_from_yaml(scene_text("{file: a.npy}"))


@pytest.mark.parametrize("cloud", ["{points: []}", "{points: [[0, .nan, 0]]}", "{points: [[0, 0, 0]], resolution: 0}"])
def test_clouds_in_files_that_are_none(cloud: str) -> None:
    with pytest.raises(InvalidObstacleError, match="seen"):
        scene_from_yaml(scene_text(cloud))


def test_triangles_enclose_the_voxels() -> None:
    cloud, pose = random_cloud(), Pose.from_xyz_rpy([0.3, 0, 0.1], [0.5, 0.2, 0.1])
    triangles = shape_triangles(cloud, pose, BOUNDS)
    edges = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    volume = np.einsum("ij,ij->i", triangles[:, 0], edges).sum() / 6.0
    assert volume == pytest.approx(len(cloud.voxels) * cloud.resolution**3)
