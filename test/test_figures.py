"""Pictures: files of the right size that show what they should."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.graph import shortest_chain
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.planning.grown_tree import GrownTree
from bsp_informed_planner.planning.growth import Growth
from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.maze import environment
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Cone, Cylinder, HalfSpace, Sphere
from bsp_informed_planner.scene.shelf import ShelfScene, random_shelf
from bsp_informed_planner.visualization import palette, plane_figure
from bsp_informed_planner.visualization.figures import draw_arm_plan, draw_decomposition, draw_point_plan
from bsp_informed_planner.visualization.overlay import spread
from bsp_informed_planner.visualization.plane_figure import plane_panel
from bsp_informed_planner.visualization.search_figure import draw_plane_samples, draw_plane_trees, tree_edges

SIZE = (800, 450)
PATH = np.array([[0.3, -1.6, 1.2, 0.4, 1.2, 0.0], [0.0, -1.4, 1.6, -0.2, 1.5, 0.0], [-0.4, -0.9, 1.3, -0.4, 1.5, 0.3]])


@pytest.fixture(scope="module")
def arm() -> ArmRobot:
    return ur5()


@pytest.fixture(scope="module")
def shelf() -> ShelfScene:
    return random_shelf(np.random.default_rng(3), frame="world")


def read(path: Path) -> FloatArray:
    assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    return np.asarray(imread(path)[..., :3], dtype=np.float64)


def pixels_of(image: FloatArray, colour: palette.Colour, tolerance: float = 0.03) -> int:
    return int((np.abs(image - colour).max(axis=-1) < tolerance).sum())


def test_arm_plan_shows_start_goal_keypoints_and_portals(tmp_path: Path, arm: ArmRobot, shelf: ShelfScene) -> None:
    decomposition = decompose(shelf.scene)
    ends = [arm.forward_kinematics(PATH[0]).position, shelf.pose.apply([0.15, 0.0, 0.45])]
    chain = shortest_chain(decomposition, *ends)
    file = tmp_path / "new" / "plan.png"
    keypoints = chain.points[1:-1]
    draw_arm_plan(file, arm, shelf.scene, PATH, keypoints, decomposition=decomposition, title="to a shelf", size=SIZE)
    image = read(file)
    assert image.shape == (SIZE[1], SIZE[0], 3)
    # Both panels show the arm in the hues of start and goal, and the yellow badges.
    for panel in (image[84:-62, : SIZE[0] // 2], image[84:-62, SIZE[0] // 2 :]):
        red, green, blue = np.moveaxis(panel, -1, 0)
        assert ((blue > 0.35) & (blue > 2.0 * red)).sum() > 300
        assert ((red > 0.35) & (red > 2.0 * blue) & (red > 2.0 * green)).sum() > 300
        assert pixels_of(panel, palette.KEYPOINT) > 50
        # The border of the panel is free: nothing is clipped.
        assert panel[5:-5, 25:-25].std() > 0.05
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 1000


def test_arm_plan_without_keypoints_in_an_open_scene(tmp_path: Path, arm: ArmRobot) -> None:
    bounds = WorkspaceBounds(np.full(3, -1.0), np.full(3, 1.0))
    scene = Scene.of([Obstacle.of("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), 0.02))], bounds)
    file = tmp_path / "plan.png"
    draw_arm_plan(file, arm, scene, PATH[:2], np.empty((0, 3)), intermediate_poses=0, size=SIZE)
    assert pixels_of(read(file), palette.KEYPOINT) == 0


def test_arm_plan_of_a_single_state_among_all_shapes(tmp_path: Path, arm: ArmRobot) -> None:
    obstacles = [
        Obstacle.of("ball", Sphere(0.1), Pose.from_xyz_rpy([0.6, 0.3, 0.2])),
        Obstacle.of("can", Cylinder(0.05, 0.4), Pose.from_xyz_rpy([0.6, -0.3, 0.2])),
        Obstacle.of("cone", Cone(0.1, 0.3), Pose.from_xyz_rpy([-0.6, 0.3, 0.2])),
    ]
    scene = Scene.of(obstacles, WorkspaceBounds(np.full(3, -1.0), np.full(3, 1.0)))
    file = tmp_path / "plan.png"
    draw_arm_plan(file, arm, scene, PATH[:1], np.array([[0.3, 0.0, 0.5]]), size=SIZE)
    assert pixels_of(read(file), palette.KEYPOINT) > 50


def test_arm_plan_refuses_nonsense(tmp_path: Path, arm: ArmRobot, shelf: ShelfScene) -> None:
    with pytest.raises(ValueError, match="empty"):
        draw_arm_plan(tmp_path / "a.png", arm, shelf.scene, np.empty((0, 6)), np.empty((0, 3)))
    with pytest.raises(ValueError, match="pixels"):
        draw_arm_plan(tmp_path / "a.png", arm, shelf.scene, PATH, np.empty((0, 3)), size=(100, 100))


def test_point_plan_has_equal_axes_and_can_be_drawn_in_a_thread(tmp_path: Path) -> None:
    maze = environment(2)
    decomposition = decompose(maze.scene, DecompositionOptions(dimension=2))
    chain = shortest_chain(decomposition, maze.start, maze.goal)
    files = [tmp_path / f"{k}.png" for k in range(2)]

    def draw(file: Path) -> None:
        draw_point_plan(
            file,
            PointRobot(),
            maze.scene,
            chain.points[:, :2],
            chain.points[1:-1],
            decomposition=decomposition,
            title="maze, " * 40,
        )

    threads = [threading.Thread(target=draw, args=(file,)) for file in files]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    image = read(files[0])
    assert np.array_equal(image, read(files[1]))
    assert pixels_of(image, palette.KEYPOINT) > 200
    assert pixels_of(image, palette.PORTAL) > 200
    # The area of the walls in pixels: both axes have the same scale.
    dark = np.abs(image - palette.WALL).max(axis=-1) < 0.02
    rows, columns = np.flatnonzero(dark[90:-130].sum(axis=1) > 5), np.flatnonzero(dark[90:-130].sum(axis=0) > 5)
    assert abs(np.ptp(rows) - np.ptp(columns)) <= 4
    # The long title was made to fit.
    assert (image[:84, -10:] > 0.99).all()


def test_point_plan_without_decomposition(tmp_path: Path) -> None:
    maze = environment(1)
    path = np.stack((maze.start, maze.goal))
    draw_point_plan(tmp_path / "plan.png", PointRobot(), maze.scene, path, np.empty((0, 2)))
    image = read(tmp_path / "plan.png")
    assert pixels_of(image, palette.PORTAL) == 0
    assert pixels_of(image, palette.START) > 50


def test_samples_in_the_plane(tmp_path: Path) -> None:
    maze = environment(1)
    chain = np.stack((maze.start, 0.5 * (maze.start + maze.goal), maze.goal))
    samples = np.random.default_rng(0).uniform(0.0, 1.0, (200, 2))
    for count in (0, 200):
        draw_plane_samples(tmp_path / f"{count}.png", maze.scene, chain, samples[:count], title="samples")
    none, many = read(tmp_path / "0.png"), read(tmp_path / "200.png")
    assert pixels_of(many, palette.GRAPH) > pixels_of(none, palette.GRAPH) + 1000
    assert pixels_of(many, palette.KEYPOINT) > 100


def test_trees_in_the_plane(tmp_path: Path) -> None:
    maze = environment(1)
    start = GrownTree(np.array([maze.start, maze.start + [0.0, 0.1], maze.start + [0.1, 0.0]]), np.array([-1, 0, 0]))
    goal = GrownTree(np.array([maze.goal]), np.array([-1]))
    np.testing.assert_allclose(tree_edges(start), [[start.nodes[1], start.nodes[0]], [start.nodes[2], start.nodes[0]]])
    assert tree_edges(goal).shape == (0, 2, 2)
    pixels = {}
    for name, tree in (("root", goal), ("grown", start)):
        draw_plane_trees(tmp_path / f"{name}.png", maze.scene, Growth(tree, goal, None, 3), title="trees")
        pixels[name] = pixels_of(read(tmp_path / f"{name}.png"), palette.START)
    assert pixels["grown"] > pixels["root"] + 100


def test_decomposition_in_2d(tmp_path: Path) -> None:
    maze = environment(1)
    decomposition = decompose(maze.scene, DecompositionOptions(dimension=2))
    plain, with_chain = tmp_path / "plain.png", tmp_path / "chain.png"
    draw_decomposition(plain, maze.scene, decomposition)
    draw_decomposition(
        with_chain, maze.scene, decomposition, shortest_chain(decomposition, maze.start, maze.goal), title="maze"
    )
    assert pixels_of(read(plain), palette.KEYPOINT) == 0
    assert pixels_of(read(with_chain), palette.KEYPOINT) > 200


def test_names_of_axes_and_legends_fit(tmp_path: Path) -> None:
    """Numbers with a sign and two digits leave the axis's name on the picture; only what is drawn is named."""
    bounds = WorkspaceBounds(np.array([-0.9, -0.9, -0.5]), np.array([1.1, 0.9, 1.1]))
    figure, axes = plane_panel(Scene.of([], bounds), "plane", [])
    figure.draw_without_rendering()
    assert axes.yaxis.label.get_window_extent().x0 >= 0.0
    empty = decompose(Scene.of([], bounds), DecompositionOptions(dimension=2))
    assert empty.portal_count == 0
    named = [handle.get_label() for handle in plane_figure._handles(False, empty)]
    assert named == ["free cells", "obstacles"]


def test_decomposition_in_3d(tmp_path: Path, shelf: ShelfScene) -> None:
    decomposition = decompose(shelf.scene)
    chain = shortest_chain(decomposition, shelf.pose.apply([0.15, 0.0, 0.1]), shelf.pose.apply([0.15, 0.0, 0.45]))
    plain, with_chain = tmp_path / "plain.png", tmp_path / "chain.png"
    draw_decomposition(plain, shelf.scene, decomposition, size=SIZE)
    draw_decomposition(with_chain, shelf.scene, decomposition, chain, size=SIZE)
    assert read(plain).shape == (SIZE[1], SIZE[0], 3)
    assert pixels_of(read(plain), palette.KEYPOINT) == 0
    assert pixels_of(read(with_chain), palette.KEYPOINT) > 50
    with pytest.raises(ValueError, match="pixels"):
        draw_decomposition(plain, shelf.scene, decomposition, size=(10, 10))


def test_badges_part_and_stay_in_the_frame() -> None:
    anchors = np.array([[50.0, 50.0], [50.0, 50.0], [52.0, 50.0], [0.0, 0.0], [100.0, 100.0]])
    places = spread(anchors, 10.0, (5.0, 5.0, 95.0, 95.0))
    distances = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(5, 1)]
    assert distances.min() > 9.0
    assert places.min() >= 5.0
    assert places.max() <= 95.0
    assert np.linalg.norm(places[:3] - anchors[:3], axis=1).max() < 15.0
    assert spread(np.empty((0, 2)), 10.0, (0, 0, 1, 1)).shape == (0, 2)
