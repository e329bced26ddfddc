"""What a robot holds: changes of it, files, and collisions of it."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.certifier import EdgeCertifier, Verdict
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.holding import HoldingRobot, robot_in_scene
from bsp_informed_planner.collision.verdict_calls_kernels import FREE
from bsp_informed_planner.errors import (
    InvalidObstacleError,
    SamplesExhaustedError,
    UnknownFrameError,
    UnknownObstacleError,
)
from bsp_informed_planner.planning import Planner, PlanningProblem, PoseGoal
from bsp_informed_planner.planning.problem import JointGoal, PlanOptions
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.attached import AttachmentOperation, CollisionPermission
from bsp_informed_planner.scene.diff import ObstacleOperation, SceneDiff, apply
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import AttachedObstacle, Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cone, Cylinder, HalfSpace, PointCloud, Sphere
from bsp_informed_planner.scene.yaml_io import scene_from_yaml, scene_to_yaml

BOUNDS = WorkspaceBounds(np.array([-1.0, -1.0, -1.0]), np.array([1.0, 1.0, 1.0]))
CUBE = Obstacle.of("cube", Box(np.array([0.1, 0.1, 0.1])), Pose.from_xyz_rpy([0.5, 0.0, 0.0]))
READY = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])


@pytest.fixture(scope="module")
def arm() -> Robot:
    return ur5()


def holding(body: AttachedObstacle, *obstacles: Obstacle, allowed: tuple[frozenset[str], ...] = ()) -> Scene:
    scene = Scene.of(obstacles, BOUNDS)
    return replace(scene, attached={body.id: body}, allowed_collisions=frozenset(allowed))


def stick(length: float = 0.4, link: str = "tool0", touch: frozenset[str] = frozenset()) -> AttachedObstacle:
    """A thin stick along the tool's z axis, from its origin on."""
    shape = Box(np.array([0.02, 0.02, length]))
    return AttachedObstacle(
        Obstacle.of("stick", shape, Pose.from_xyz_rpy([0.0, 0.0, 0.02 + length / 2.0])), link, touch
    )


def test_attach_and_detach() -> None:
    scene = Scene.of([CUBE], BOUNDS)
    grip = Pose.from_xyz_rpy([0.0, 0.0, 0.05])
    held = apply(scene, SceneDiff(attachments=(AttachmentOperation.attach_known("cube", "tool0", grip, ["finger"]),)))
    assert not held.obstacles
    body = held.attached["cube"]
    assert (body.link, body.touch_links, body.obstacle.pose) == ("tool0", frozenset({"finger"}), grip)
    assert body.obstacle.shapes == CUBE.shapes
    again = apply(held, SceneDiff(attachments=(AttachmentOperation.attach_known("cube", "hand", grip),)))
    assert again.attached["cube"].link == "hand"
    there = Pose.from_xyz_rpy([0.0, 0.5, 0.0])
    free = apply(held, SceneDiff(attachments=(AttachmentOperation.detach("cube", there),)))
    assert not free.attached
    assert free.obstacles["cube"].pose == there
    assert not apply(held, SceneDiff(attachments=(AttachmentOperation.remove(),))).attached
    assert not apply(held, SceneDiff.replacing_all([])).attached
    assert scene.obstacles
    assert not scene.attached


def test_changes_that_do_not_fit() -> None:
    scene = Scene.of([CUBE], BOUNDS)
    known = AttachmentOperation.attach_known
    with pytest.raises(UnknownObstacleError, match="ghost"):
        apply(scene, SceneDiff(attachments=(known("ghost", "tool0", Pose.identity()),)))
    with pytest.raises(UnknownObstacleError, match="DETACH: no obstacle 'cube'"):
        apply(scene, SceneDiff(attachments=(AttachmentOperation.detach("cube", Pose.identity()),)))
    with pytest.raises(InvalidObstacleError, match="needs a link"):
        apply(scene, SceneDiff(attachments=(known("cube", "", Pose.identity()),)))
    held = apply(scene, SceneDiff(attachments=(known("cube", "tool0", Pose.identity()),)))
    with pytest.raises(InvalidObstacleError, match="attached to the robot"):
        apply(held, SceneDiff.of(ObstacleOperation.add(CUBE)))
    floor = Obstacle.of("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0))
    with pytest.raises(InvalidObstacleError, match="half-space"):
        AttachedObstacle(floor, "tool0")
    with pytest.raises(InvalidObstacleError, match="two different names"):
        CollisionPermission("cube", "cube")


def test_permissions_come_and_go() -> None:
    scene = Scene.of([CUBE], BOUNDS)
    allowed = apply(scene, SceneDiff(permissions=(CollisionPermission("cube", "hand"), CollisionPermission("a", "b"))))
    assert allowed.allowed_collisions == {frozenset(("hand", "cube")), frozenset(("a", "b"))}
    fewer = apply(allowed, SceneDiff(permissions=(CollisionPermission("hand", "cube", False),)))
    assert fewer.allowed_collisions == {frozenset(("a", "b"))}
    assert not apply(fewer, SceneDiff(permissions=(CollisionPermission.none(),))).allowed_collisions


def test_files_keep_what_is_held() -> None:
    scene = holding(stick(touch=frozenset(("left", "right"))), CUBE, allowed=(frozenset(("stick", "cube")),))
    again = scene_from_yaml(scene_to_yaml(scene))
    body = again.attached["stick"]
    assert (body.link, body.touch_links) == ("tool0", frozenset({"left", "right"}))
    assert body.obstacle.pose == scene.attached["stick"].obstacle.pose
    assert again.allowed_collisions == scene.allowed_collisions


def test_a_held_body_collides_as_the_link_does(arm: Robot) -> None:
    tool = arm.forward_kinematics(READY)
    tip = tool * Pose.from_xyz_rpy([0.0, 0.0, 0.4])
    ball = Obstacle.of("ball", Sphere(0.03), tip)
    assert ExactChecker(arm, Scene.of([ball], BOUNDS)).is_free(READY)
    checker = ExactChecker(arm, holding(stick(), ball))
    assert checker.colliding_bodies(READY) == ("stick", "ball")
    assert ExactChecker(arm, holding(stick(0.2), ball)).is_free(READY)
    permitted = holding(stick(), ball, allowed=(frozenset(("stick", "ball")),))
    assert ExactChecker(arm, permitted).is_free(READY)
    # Not only touching, but wholly inside as well.
    pebble = Obstacle.of("pebble", Sphere(0.001), tool * Pose.from_xyz_rpy([0.0, 0.0, 0.2]))
    assert not ExactChecker(arm, holding(stick(), pebble)).is_free(READY)


def test_a_held_body_collides_with_other_links(arm: Robot) -> None:
    # Backwards from the wrist, through the forearm.
    pose = arm.forward_kinematics(READY).inverse() * arm.forward_kinematics(READY, "forearm_link")
    body = AttachedObstacle(Obstacle.of("bar", Box(np.array([0.3, 0.02, 0.02])), pose), "tool0")
    scene = holding(body)
    assert ExactChecker(arm, Scene.of([], BOUNDS)).is_free(READY)
    assert set(ExactChecker(arm, scene).colliding_bodies(READY) or ()) >= {"bar"}
    touch = frozenset(("forearm_link", "upper_arm_link"))
    assert ExactChecker(arm, holding(AttachedObstacle(body.obstacle, "tool0", touch))).is_free(READY)
    pairs = tuple(frozenset(("bar", link)) for link in touch)
    assert ExactChecker(arm, holding(body, allowed=pairs)).is_free(READY)


def test_pairs_of_links_may_be_allowed(arm: Robot) -> None:
    folded = np.array([0.0, -1.57, 2.9, 0.0, 0.0, 0.0])
    free = ExactChecker(arm, Scene.of([], BOUNDS))
    allowed: set[frozenset[str]] = set()
    while (bodies := free.colliding_bodies(folded)) is not None:
        pair = frozenset(bodies)
        assert pair not in allowed
        allowed.add(pair)
        free = ExactChecker(arm, replace(Scene.of([], BOUNDS), allowed_collisions=frozenset(allowed)))
    assert allowed
    # The robot itself stays as it was.
    assert not ExactChecker(arm, Scene.of([], BOUNDS)).is_free(folded)


def test_motion_bounds_cover_what_is_held(arm: Robot) -> None:
    held = robot_in_scene(arm, holding(stick(1.0)))
    assert isinstance(held, HoldingRobot)
    assert (held.motion_radii >= arm.motion_radii).all()
    rng = np.random.default_rng(0)
    tip = Pose.from_xyz_rpy([0.0, 0.0, 1.02])
    for _ in range(200):
        first = rng.uniform(arm.lower, arm.upper)
        second = first + rng.normal(size=6) * 1e-3
        ends = [(arm.forward_kinematics(state) * tip).position for state in (first, second)]
        assert np.linalg.norm(ends[1] - ends[0]) <= held.motion_radii @ np.abs(second - first) + 1e-9


def test_no_obstacle_slips_through_a_certified_sweep(arm: Robot) -> None:
    """A stick sweeps over a small ball: ends are free, the edge is not."""
    scene = holding(stick(0.5))
    turn = np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    tip = arm.forward_kinematics(READY) * Pose.from_xyz_rpy([0.0, 0.0, 0.45])
    scene = replace(scene, obstacles={"ball": Obstacle.of("ball", Sphere(0.01), tip)})
    checker = ExactChecker(arm, scene)
    assert checker.is_free(READY - turn)
    assert checker.is_free(READY + turn)
    assert not checker.is_edge_free(READY - turn, READY + turn, 0.005)
    assert EdgeCertifier(checker, 0.005).certify(READY - turn, READY + turn) is Verdict.COLLIDING
    bare = ExactChecker(arm, replace(scene, attached={}))
    assert EdgeCertifier(bare, 0.005).certify(READY - turn, READY + turn) is Verdict.CERTIFIED


def test_goals_for_the_held_body(arm: Robot) -> None:
    scene = holding(stick(0.2))
    start = READY + [0.5, 0.0, 0.0, 0.0, 0.0, 0.0]
    pose = robot_in_scene(arm, scene).forward_kinematics(READY, "stick")
    planner = Planner(arm, scene)
    options = PlanOptions(allowed_seconds=5.0, first_solution=True, seed=1)
    result = planner.plan(PlanningProblem(start, [PoseGoal(pose, "stick")]), options)
    reached = planner.robot.forward_kinematics(result.path[-1], "stick")
    assert np.allclose(reached.position, pose.position, atol=1e-6)
    assert result.certified


def test_a_point_that_holds_a_disc_needs_a_wider_gap() -> None:
    bounds = WorkspaceBounds(np.array([0.0, 0.0, -0.05]), np.array([1.0, 1.0, 0.05]))
    walls = [
        Obstacle.of(name, Box(np.array([0.05, high - low, 0.2])), Pose.from_xyz_rpy([0.5, (low + high) / 2.0, 0.0]))
        for name, low, high in (("lower", -0.1, 0.7), ("upper", 0.8, 1.1))
    ]
    problem = PlanningProblem(np.array([0.2, 0.5]), [JointGoal(np.array([0.8, 0.5]))])
    options = PlanOptions(allowed_seconds=2.0, first_solution=True, seed=1, max_samples=2000)

    def plan(radius: float) -> bool:
        disc = AttachedObstacle(Obstacle.of("disc", Sphere(radius)), "point")
        scene = replace(Scene.of(walls, bounds), attached={"disc": disc})
        return Planner(PointRobot(), scene).plan(problem, options).certified

    assert plan(0.04)
    with pytest.raises(SamplesExhaustedError):
        plan(0.06)


def test_what_cannot_be_attached_is_named(arm: Robot) -> None:
    with pytest.raises(UnknownFrameError, match="'stick', to be attached: unknown frame 'hand'"):
        ExactChecker(arm, holding(stick(link="hand")))
    body = AttachedObstacle(Obstacle.of("tool0", Sphere(0.1)), "tool0")
    with pytest.raises(InvalidObstacleError, match="name of a frame"):
        ExactChecker(arm, holding(body))


@pytest.mark.parametrize("size", [1e-300, 1e-9, 1e-4, 20.0, 1e300])
@pytest.mark.parametrize("shape", [Box, Sphere, Cylinder, Cone])
def test_bodies_of_any_size_are_bounded_or_refused(shape: type, size: float) -> None:
    body = shape(np.full(3, size)) if shape is Box else shape(size) if shape is Sphere else shape(size, size)
    scene = replace(Scene.of([], BOUNDS), attached={"it": AttachedObstacle(Obstacle.of("it", body), "point")})
    reason = ""
    if size > 1e3:
        reason = "attached, it reaches"
    elif size < 1e-100 and shape in (Cylinder, Cone):
        reason = "the hull of .* has no volume"
    if reason:
        with pytest.raises(InvalidObstacleError, match=f"'it': {reason}"):
            robot_in_scene(PointRobot(), scene)
        return
    robot = robot_in_scene(PointRobot(), scene)
    state = np.array([[0.5, 0.5]])
    for gap in (-0.02, 0.02, 0.5 + size):
        cube = Obstacle.of("cube", Box(np.full(3, 0.1)), Pose.from_xyz_rpy([0.55 + 0.5 * size + gap, 0.5, 0.0]))
        beside = replace(scene, obstacles={"cube": cube})
        proved = BoundedChecker(robot, beside).verdicts.of_states(state)[0] == FREE
        assert proved <= ExactChecker(robot, beside).is_free(state[0])
        assert proved or gap < 0.5


def test_pickled_scenes_keep_what_the_robot_holds() -> None:
    scene = replace(holding(stick(), CUBE, allowed=(frozenset({"cube", "stick"}),)), frame="base", revision=3)
    again = pickle.loads(pickle.dumps(scene))
    assert list(again.obstacles) == ["cube"]
    assert (again.frame, again.revision) == ("base", 3)
    assert again.attached["stick"].link == "tool0"
    assert again.allowed_collisions == scene.allowed_collisions


def test_holding_robots_are_robots(arm: Robot) -> None:
    scene = holding(stick())
    held = robot_in_scene(arm, scene)
    assert isinstance(held, Robot)
    assert held.joint_names == arm.joint_names
    assert robot_in_scene(held, scene) is held
    assert robot_in_scene(held, Scene.of([], BOUNDS)) is arm
    travelled = pickle.loads(pickle.dumps(holding(stick(), CUBE, allowed=(frozenset(("a", "b")),))))
    assert list(travelled.attached) == ["stick"]
    assert list(travelled.obstacles) == ["cube"]
    assert travelled.allowed_collisions == {frozenset(("a", "b"))}
    again = pickle.loads(pickle.dumps(held))
    assert np.array_equal(again.motion_radii, held.motion_radii)
    assert again.frames == held.frames


def test_a_cloud_that_is_held_keeps_margins_from_half_spaces() -> None:
    rng = np.random.default_rng(0)
    robot = PointRobot(lower=(-1.0, -1.0), upper=(1.0, 1.0))
    checked = 0
    for _ in range(20):
        pose = Pose.from_xyz_rpy(rng.uniform(-0.2, 0.2, 3), rng.uniform(-3.0, 3.0, 3))
        cloud = PointCloud(rng.normal(0.0, 0.05, (3, 3)), 0.03)
        held = AttachedObstacle(Obstacle.of("cloud", cloud, pose), "point")
        # A normal along an axis, in a frame that is turned.
        plane = Pose.from_xyz_rpy(rng.uniform(-0.3, 0.3, 3), rng.uniform(-3.0, 3.0, 3))
        wall = Obstacle.of("wall", HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0), plane)
        scene = holding(held, wall, allowed=(frozenset({"point", "wall"}),))
        motion = ExactChecker(robot, scene).pair_motion
        voxels = cloud.voxels[:, None] + np.argwhere(np.ones((2, 2, 2)))
        corners = pose.apply((voxels * cloud.resolution).reshape(-1, 3))
        pairs = np.arange(len(motion))
        for place in rng.uniform(-1.0, 1.0, (30, 2)):
            distance = float(plane.inverse().apply(corners + np.append(place, 0.0))[:, 2].min())
            half = float(rng.choice([1e-4, 0.01, 0.1]))
            near = motion.near(pairs, place, np.array([1.0, 0.0]), half)
            checked += distance < half
            # Moved by so much along x, it may touch the wall.
            if distance < half - 1e-5:
                assert not all(motion.keeps(pair) for pair in near)
    assert checked > 100
