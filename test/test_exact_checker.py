"""The exact checker: verdicts against plain coal, python-fcl and distances; edges, padding, half-spaces, threads."""

from __future__ import annotations

import concurrent.futures
from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin
import pytest

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.collision.enclosure import triangle_corners
from bsp_informed_planner.collision.exact import ExactChecker, bisection_order
from bsp_informed_planner.collision.geometry import create_geometry_data
from bsp_informed_planner.collision.solid_kernels import solid_angle_winding
from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.robots.arm import ArmRobot, load_arm
from bsp_informed_planner.robots.demo_arms import panda, ur5
from bsp_informed_planner.robots.motion_bound import bounding_points
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cone, ConvexMesh, Cylinder, HalfSpace, Mesh, Shape, Sphere

BOUNDS = WorkspaceBounds(np.full(3, -1.5), np.full(3, 1.5))
CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


@pytest.fixture(scope="module")
def arm() -> ArmRobot:
    return ur5()


def random_pose(rng: np.random.Generator) -> Pose:
    while True:
        position = rng.uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 1.0])
        if np.hypot(position[0], position[1]) > 0.35:
            return Pose.from_xyz_rpy(position, rng.uniform(-3, 3, 3))


def scattered(shapes: Sequence[Shape], rng: np.random.Generator) -> list[Obstacle]:
    return [Obstacle.of(f"o{i}", shape, random_pose(rng)) for i, shape in enumerate(shapes)]


def boxes(count: int, seed: int = 0) -> Scene:
    rng = np.random.default_rng(seed)
    return Scene.of(scattered([Box(rng.uniform(0.05, 0.25, 3)) for _ in range(count)], rng), BOUNDS)


def mixed(seed: int = 1) -> Scene:
    """All kinds of shapes, half-spaces among them."""
    rng = np.random.default_rng(seed)
    tetrahedron = Mesh(
        0.2 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),
        np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
    )
    shapes: list[Shape] = [
        Box(np.array([0.1, 0.2, 0.3])),
        Sphere(0.12),
        Cylinder(0.08, 0.4),
        Cone(0.1, 0.3),
        ConvexMesh(rng.normal(size=(15, 3)) * 0.08),
        tetrahedron,
    ]
    obstacles = scattered(shapes, rng)
    obstacles.append(Obstacle.of("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), 0.05)))
    obstacles.append(
        Obstacle.of("wall", HalfSpace(np.array([1.0, 1.0, 0.1]), 0.9), Pose.from_xyz_rpy([0.1, 0, 0], [0.1, 0.2, 0.3]))
    )
    return Scene.of(obstacles, BOUNDS)


def configurations(robot: ArmRobot, count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi), (count, robot.dof))


def plain_verdict(checker: ExactChecker, data: pin.GeometryData, configuration: np.ndarray) -> bool:
    """Of coal, without a broadphase; but a link inside another, which coal does not see, is taken from the checker."""
    model = checker.robot.model
    if not checker.is_free(configuration) and checker._enclosed.find(configuration) is not None:
        return False
    return not pin.computeCollisions(model, model.createData(), checker.collision_model, data, configuration, False)


@pytest.mark.parametrize("make", [ur5, panda])
@pytest.mark.parametrize("scene", [boxes(15), mixed(1), mixed(2)], ids=["boxes", "mixed", "mixed2"])
@pytest.mark.parametrize("padding", [0.0, 0.04])
def test_the_broadphase_changes_no_verdict(make, scene: Scene, padding: float) -> None:  # type: ignore[no-untyped-def]
    robot = make()
    checker = ExactChecker(robot, scene, padding=padding)
    data = create_geometry_data(checker.collision_model)
    for pair in range(len(robot.collision_model.collisionPairs), len(data.collisionRequests)):
        data.collisionRequests[pair].security_margin = padding
    verdicts = []
    for configuration in configurations(robot, 400):
        verdicts.append(checker.is_free(configuration))
        assert verdicts[-1] == plain_verdict(checker, data, configuration)
    assert 400 <= checker.checks <= 800
    assert 20 < sum(verdicts) < 380


@pytest.mark.parametrize("padding", [0.0, 0.05])
def test_verdicts_agree_with_distances(arm: ArmRobot, padding: float) -> None:
    scene = mixed()
    checker, bare = ExactChecker(arm, scene, padding=padding), ExactChecker(arm, Scene.of([], BOUNDS))
    data, geometry_data = arm.model.createData(), checker.collision_model.createData()
    own = len(arm.collision_model.collisionPairs)
    seen = set()
    for configuration in configurations(arm, 40, seed=4):
        if checker._enclosed.find(configuration) is not None:
            continue  # a link inside another: surfaces are apart
        pin.updateGeometryPlacements(arm.model, data, checker.collision_model, geometry_data, configuration)
        gaps = [
            pin.computeDistance(checker.collision_model, geometry_data, k).min_distance
            for k in range(len(checker.collision_model.collisionPairs))
        ]
        expected = min(gaps[:own]) > 0 and min(gaps[own:]) > padding
        if min(abs(min(gaps[:own])), abs(min(gaps[own:]) - padding)) > 1e-4:
            assert checker.is_free(configuration) == expected
            seen.add(expected)
        assert checker.distance(configuration) == pytest.approx(max(min(gaps), 0.0), abs=1e-6)
        assert bare.distance(configuration) == pytest.approx(max(min(gaps[:own]), 0.0), abs=1e-6)
    assert seen == {True, False}


def test_half_spaces_against_vertices(arm: ArmRobot) -> None:
    """A link is in a half-space exactly if one of its vertices is."""
    pose = Pose.from_xyz_rpy([0.1, 0, 0.2], [0.3, 0.2, 0.1])
    wall = HalfSpace(np.array([0.3, -1.0, 0.2]), 0.4)
    scene = Scene.of([Obstacle.of("wall", wall, pose)], BOUNDS)
    checker, alone = ExactChecker(arm, scene), ExactChecker(arm, Scene.of([], BOUNDS))
    data, geometry_data = arm.model.createData(), arm.collision_model.createData()
    moving = [
        (i, bounding_points(g.geometry)[0]) for i, g in enumerate(arm.collision_model.geometryObjects) if g.parentJoint
    ]
    hits = 0
    for configuration in configurations(arm, 300, seed=5):
        pin.updateGeometryPlacements(arm.model, data, arm.collision_model, geometry_data, configuration)
        inside = False
        for index, points in moving:
            placement = geometry_data.oMg[index]
            local = pose.inverse().apply(points @ placement.rotation.T + placement.translation)
            inside |= bool((local @ wall.normal + wall.offset <= 0).any())
        assert checker.is_free(configuration) == (alone.is_free(configuration) and not inside)
        hits += inside
    assert 30 < hits < 270


def test_python_fcl_agrees(arm: ArmRobot) -> None:
    """Another library, meshes read by another reader, placements from the URDF's chain."""
    fcl = pytest.importorskip("fcl")
    trimesh = pytest.importorskip("trimesh")
    rng = np.random.default_rng(6)
    pose_of = {}
    obstacles = []
    for i in range(10):
        kinds: tuple[Shape, ...] = (Box(rng.uniform(0.05, 0.3, 3)), Sphere(0.1), Cylinder(0.06, 0.4))
        shape = kinds[i % 3]
        pose = random_pose(rng)
        obstacles.append(Obstacle.of(f"o{i}", shape, pose))
        body = {Box: lambda s: fcl.Box(*s.size), Sphere: lambda s: fcl.Sphere(s.radius)}.get(
            type(shape), lambda s: fcl.Cylinder(s.radius, s.height)
        )(shape)
        pose_of[f"o{i}"] = fcl.CollisionObject(body, fcl.Transform(pose.rotation, pose.position))
    checker = ExactChecker(arm, Scene.of(obstacles, BOUNDS))

    objects, links = [], []
    for item in arm.collision_model.geometryObjects:
        links.append(arm.model.frames[item.parentFrame].name)
        if isinstance(item.geometry, coal.Box):
            objects.append(fcl.CollisionObject(fcl.Box(*(2 * item.geometry.halfSide))))
            continue
        mesh = trimesh.load(item.meshPath)
        body = fcl.BVHModel()
        body.beginModel(len(mesh.vertices), len(mesh.faces))
        body.addSubModel(np.asarray(mesh.vertices), np.asarray(mesh.faces))
        body.endModel()
        objects.append(fcl.CollisionObject(body))
    own = [(pair.first, pair.second) for pair in arm.collision_model.collisionPairs]
    verdicts = []
    for configuration in configurations(arm, 250, seed=7):
        for item, link, body in zip(arm.collision_model.geometryObjects, links, objects, strict=True):
            placement = arm.forward_matrix(configuration, link)
            if link == "ee_link":  # its box has an origin of its own
                placement = placement @ pin.SE3(np.eye(3), np.array([-0.01, 0, 0])).homogeneous
            body.setTransform(fcl.Transform(placement[:3, :3], placement[:3, 3]))
            assert item.parentFrame == arm.model.getFrameId(link, pin.FrameType.BODY)
        pairs = [(objects[i], objects[j]) for i, j in own]
        pairs += [
            (body, o)
            for link, body in zip(links, objects, strict=True)
            if link != "base_link"
            for o in pose_of.values()
        ]
        hit = any(fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()) for a, b in pairs)
        # A link inside another: fcl, too, sees surfaces only.
        inside = not hit and checker._enclosed.find(configuration) is not None
        assert checker.is_free(configuration) == (not hit and not inside)
        verdicts.append(hit)
    assert 30 < sum(verdicts) < 270


def test_names_of_colliding_bodies(arm: ArmRobot) -> None:
    ball = Obstacle.of("ball", Sphere(0.1), Pose.from_xyz_rpy([0.425, 0.1, 0.09]))
    checker = ExactChecker(arm, Scene.of([ball], BOUNDS))
    bodies = checker.colliding_bodies(np.zeros(6))
    assert bodies is not None
    assert bodies[0] in ("upper_arm_link", "forearm_link")
    assert bodies[1] == "ball"
    away = np.array([np.pi, -0.5, 0.5, 0, 0, 0])
    assert checker.colliding_bodies(away) is None
    folded = np.array([0.0, -1.0, 3.1, 0, 0, 0])
    own = checker.colliding_bodies(folded)
    assert own is not None
    assert "ball" not in own
    assert own[0].endswith("_link")


def test_what_is_not_checked(arm: ArmRobot) -> None:
    """The base may stand in something, and obstacles may overlap."""
    table = Obstacle.of("table", Box(np.array([1.0, 1.0, 0.1])), Pose.from_xyz_rpy([0, 0, -0.045]))
    under = Obstacle.of("under", Box(np.array([0.5, 0.5, 0.2])), Pose.from_xyz_rpy([0, 0, -0.1]))
    checker = ExactChecker(arm, Scene.of([table, under], BOUNDS))
    assert checker.is_free(np.array([0.0, -np.pi / 2, 0, 0, 0, 0]))


def test_edges(arm: ArmRobot) -> None:
    checker = ExactChecker(arm, boxes(8, seed=3), resolution=0.02)
    free = [q for q in configurations(arm, 300, seed=8) if checker.is_free(q)]
    verdicts = []
    for start, end in zip(free[:60], free[1:61], strict=True):
        end = start + 0.3 * (end - start)
        dense = all(checker.is_free(start + t * (end - start)) for t in np.linspace(0, 1, 400))
        verdict = checker.is_edge_free(start, end)
        verdicts.append(verdict)
        assert verdict or not dense
        before = checker.checks
        assert checker.is_edge_free(start, end, resolution=0.005) <= verdict
        if verdict:
            motion = arm.motion_radii @ np.abs(end - start)
            assert before + 2 <= checker.checks <= before + motion / 0.005 + 2
    assert 5 < sum(verdicts) < 60


def test_spacing_of_edge_states_is_the_resolution(arm: ArmRobot) -> None:
    """No vertex of the robot moves further than the resolution between two neighbouring states."""
    rng = np.random.default_rng(9)
    points = [bounding_points(g.geometry)[0] for g in arm.collision_model.geometryObjects]
    data, geometry_data = arm.model.createData(), arm.collision_model.createData()
    for _ in range(10):
        start, end = rng.uniform(arm.lower, arm.upper, (2, 6))
        intervals = int(np.ceil(arm.motion_radii @ np.abs(end - start) / 0.01))
        fractions = np.sort(np.concatenate([[0, 1], bisection_order(intervals)]))
        places = []
        for fraction in fractions[10:14]:
            pin.updateGeometryPlacements(
                arm.model, data, arm.collision_model, geometry_data, start + fraction * (end - start)
            )
            places.append(
                np.concatenate(
                    [p @ m.rotation.T + m.translation for p, m in zip(points, geometry_data.oMg, strict=True)]
                )
            )
        assert max(np.linalg.norm(b - a, axis=1).max() for a, b in zip(places, places[1:], strict=False)) <= 0.01


@pytest.mark.parametrize("intervals", [1, 2, 3, 7, 8, 100])
def test_bisection_order(intervals: int) -> None:
    order = bisection_order(intervals)
    np.testing.assert_allclose(np.sort(order), np.arange(1, intervals) / intervals)
    if intervals >= 8:
        np.testing.assert_allclose(order[:3], [0.5, 0.25, 0.75], atol=0.02)


def test_collisions_are_found_early(arm: ArmRobot) -> None:
    wall = Obstacle.of("wall", Box(np.array([0.4, 0.02, 0.4])), Pose.from_xyz_rpy([0.6, 0.0, 0.2]))
    checker = ExactChecker(arm, Scene.of([wall], BOUNDS))
    start = np.array([-1.5, -0.3, 0.3, 0, 0, 0])
    end = np.array([1.5, -0.3, 0.3, 0, 0, 0])
    assert checker.is_free(start)
    assert checker.is_free(end)
    before = checker.checks
    assert not checker.is_edge_free(start, end)
    assert checker.checks - before <= 4


def test_clones_in_threads(arm: ArmRobot) -> None:
    checker = ExactChecker(arm, mixed())
    states = configurations(arm, 300, seed=10)
    expected = [checker.is_free(q) for q in states]

    def work(_: int) -> list[bool]:
        other = checker.clone()
        verdicts = [other.is_free(q) for q in states]
        assert other.checks == len(states)
        return verdicts

    with concurrent.futures.ThreadPoolExecutor(3) as pool:
        for verdicts in pool.map(work, range(3)):
            assert verdicts == expected
    assert checker.checks == len(states)
    as_protocol: CollisionChecker = checker.clone()
    assert as_protocol.checks == 0


def test_bad_input(arm: ArmRobot) -> None:
    scene = boxes(1)
    for arguments in ({"resolution": 0.0}, {"resolution": float("nan")}, {"padding": -0.1}, {"padding": float("inf")}):
        with pytest.raises(InvalidOptionError):
            ExactChecker(arm, scene, **arguments)
    checker = ExactChecker(arm, scene)
    with pytest.raises(InvalidOptionError):
        checker.is_edge_free(np.zeros(6), np.ones(6), resolution=-1.0)
    bad = np.array([0, 0, np.nan, 0, 0, 0])
    for call in (checker.is_free, checker.colliding_bodies, checker.distance, lambda q: checker.is_edge_free(q, q)):
        with pytest.raises(ValueError, match="not finite"):
            call(bad)
        with pytest.raises(ValueError, match=r"size|shape|dimension"):
            call(np.zeros(5))


def test_empty_scene(arm: ArmRobot) -> None:
    checker = ExactChecker(arm, Scene.of([], BOUNDS))
    assert checker.is_free(np.array([0.0, -1.0, 1.0, 0, 0, 0]))


# --- solids -------------------------------------------------------------------------------------------------------


def test_a_link_inside_an_obstacle_collides(arm: ArmRobot) -> None:
    corners = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    corners += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    shapes: list[Shape] = [
        Box(np.full(3, 4.0)),
        Sphere(3.0),
        Cylinder(3.0, 5.0),
        Cone(5.0, 12.0),
        ConvexMesh(2.0 * CUBE),
        Mesh(2.0 * CUBE, np.array(corners)),
    ]
    for shape in shapes:
        checker = ExactChecker(arm, Scene.of([Obstacle.of("all", shape)], BOUNDS))
        assert not checker.is_free(np.array([0.0, -1.5, 0.3, 0.2, 0.1, 0]))


def test_an_obstacle_inside_a_link_collides(arm: ArmRobot) -> None:
    configuration = np.array([0.3, -1.0, 0.8, 0.2, 0.1, 0.0])
    surface = triangle_corners(arm.collision_model.geometryObjects[2].geometry)
    inner = np.array([0.0, 0.0, 0.2])
    assert solid_angle_winding(inner, surface) == pytest.approx(1.0, abs=0.01)
    assert solid_angle_winding(inner + [0.2, 0, 0], surface) == pytest.approx(0.0, abs=0.01)
    place = arm.forward_kinematics(configuration, "upper_arm_link")
    for shape in (Sphere(0.01), Box(np.full(3, 0.02)), Cylinder(0.01, 0.02), ConvexMesh(0.01 * CUBE), Cone(0.01, 0.02)):
        inside = Obstacle.of("crumb", shape, Pose(place.apply(inner), place.quaternion))
        checker = ExactChecker(arm, Scene.of([inside], BOUNDS))
        assert not checker.is_free(configuration)
        assert not checker.is_edge_free(configuration, configuration + 0.001)
        assert checker.colliding_bodies(configuration) == ("upper_arm_link", "crumb")
        assert checker.distance(configuration) == 0.0
        assert checker.clone().colliding_bodies(configuration) == ("upper_arm_link", "crumb")
        # In the link's bounding box, but beside its surface.
        corner = place.apply(np.array([0.057, -0.063, 0.25]))
        outside = ExactChecker(
            arm, Scene.of([Obstacle.of("crumb", Sphere(0.001), Pose(corner, place.quaternion))], BOUNDS)
        )
        assert outside.is_free(configuration)
    # Large obstacles cost nothing.
    large = ExactChecker(arm, Scene.of([Obstacle.of("b", Box(np.full(3, 0.5)))], BOUNDS))
    assert large._enclosed.candidates == ExactChecker(arm, Scene.of([], BOUNDS))._enclosed.candidates


def test_a_link_inside_a_link_collides(arm: ArmRobot) -> None:
    """The flange of a folded arm inside the hollow of the forearm: no surface touches another."""
    checker = ExactChecker(arm, Scene.of([], BOUNDS))
    data = create_geometry_data(checker.collision_model)
    names = set()
    for configuration in configurations(arm, 4000, seed=11):
        if checker.touches(configuration) or checker.is_free(configuration):
            continue
        model = arm.model
        assert not pin.computeCollisions(model, model.createData(), checker.collision_model, data, configuration, False)
        bodies = checker.colliding_bodies(configuration)
        assert bodies is not None
        names.add(bodies)
        assert checker.clone().colliding_bodies(configuration) == bodies
        # It is really in there.
        outer, inner = (arm.forward_matrix(configuration, name) for name in bodies)
        item = arm.collision_model.geometryObjects[arm.collision_model.getGeometryId(f"{bodies[0]}_0")]
        place = arm.model.frames[item.parentFrame].placement.actInv(item.placement).homogeneous
        point = np.linalg.inv(outer @ place) @ inner @ np.array([-0.01, 0.0, 0.0, 1.0])
        assert solid_angle_winding(point[:3], triangle_corners(item.geometry)) > 0.5
    assert ("forearm_link", "ee_link") in names


def test_a_concave_mesh_leaves_its_opening_free(arm: ArmRobot) -> None:
    """An L of two boxes as one mesh: the arm fits into its corner, which a hull would fill."""
    trimesh = pytest.importorskip("trimesh")
    floor = trimesh.creation.box((0.8, 0.4, 0.1))
    back = trimesh.creation.box((0.1, 0.4, 0.8))
    back.apply_translation([0.35, 0, 0.45])
    both = trimesh.util.concatenate([floor, back])
    mesh = Mesh(np.asarray(both.vertices), np.asarray(both.faces))
    pose = Pose.from_xyz_rpy([0.75, 0.0, -0.3])
    checker = ExactChecker(arm, Scene.of([Obstacle.of("L", mesh, pose)], BOUNDS))
    reached = arm.inverse_kinematics(Pose.from_xyz_rpy([0.75, 0.0, 0.1], [np.pi, 0, 0]))
    assert any(checker.is_free(q) for q in reached)
    inside = arm.inverse_kinematics(Pose.from_xyz_rpy([0.75, 0.0, -0.29], [np.pi, 0, 0]))
    assert len(inside)
    assert not any(checker.is_free(q) for q in inside)


def test_robot_of_primitives() -> None:
    urdf = (
        '<robot name="p"><link name="l0"/><link name="l1"><collision><origin xyz="0 0 0.5"/><geometry>'
        '<cylinder radius="0.05" length="1"/></geometry></collision></link><joint name="a" type="continuous">'
        '<parent link="l0"/><child link="l1"/><axis xyz="0 1 0"/></joint></robot>'
    )
    robot = load_arm(urdf)
    checker = ExactChecker(
        robot, Scene.of([Obstacle.of("b", Box(np.full(3, 0.2)), Pose.from_xyz_rpy([0.8, 0, 0]))], BOUNDS)
    )
    assert checker.is_free(np.array([0.0]))
    assert not checker.is_free(np.array([np.pi / 2]))
    assert not checker.is_edge_free(np.array([0.0]), np.array([np.pi]))
    assert checker.is_edge_free(np.array([0.0]), np.array([-np.pi]))


def test_aligned_primitives() -> None:
    """coal overlooks overlaps of exactly aligned convex shapes unless it is asked for contacts."""
    seen = []
    for geometry in ('<cylinder radius="0.05" length="1"/>', '<box size="0.1 0.1 1"/>', '<sphere radius="0.2"/>'):
        robot = load_arm(
            f'<robot name="p"><link name="l0"/><link name="l1"><collision><origin xyz="0 0 0.5"/><geometry>{geometry}'
            '</geometry></collision></link><joint name="a" type="revolute"><parent link="l0"/><child link="l1"/>'
            '<axis xyz="0 1 0"/><limit lower="-7" upper="7" velocity="1" effort="1"/></joint></robot>'
        )
        shapes: list[Shape] = [Box(np.full(3, 0.2)), Cylinder(0.1, 0.2), Cone(0.1, 0.3), ConvexMesh(0.1 * CUBE)]
        for shape in shapes:
            for x, z in ((0.8, 0.0), (0.5, 0.0), (0.4, 0.1), (0.0, 0.5), (0.0, 0.6), (0.05, 0.5)):
                obstacle = Obstacle.of("o", shape, Pose.from_xyz_rpy([x, 0, z]))
                checker = ExactChecker(robot, Scene.of([obstacle], BOUNDS))
                for angle in (0.0, np.pi / 2, np.pi):
                    state = np.array([angle])
                    gap = checker.distance(state)
                    if gap == 0.0 or gap > 1e-6:
                        assert checker.is_free(state) == (gap > 0)
                        seen.append(gap > 0)
    assert 30 < sum(seen) < len(seen) - 30
