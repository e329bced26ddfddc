"""Markers: namespaces, ids, frames, counts and places."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("visualization_msgs")

from builtin_interfaces.msg import Time
from visualization_msgs.msg import Marker, MarkerArray

from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.planning.grown_tree import GrownTree
from bsp_informed_planner.planning.path import path_length
from bsp_informed_planner.planning.problem import CostHistory, PlanResult, Trajectory
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.sampling.guidance import ConfigurationChain, Guidance
from bsp_informed_planner.sampling.tube import tube_sampler
from bsp_informed_planner.scene.maze import environment
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cone, ConvexMesh, Cylinder, HalfSpace, Mesh, Sphere
from bsp_informed_planner.visualization.cell_edges import cell_edges
from bsp_informed_planner.visualization.markers import decomposition_markers, plan_markers
from bsp_informed_planner.visualization.shape_triangles import RobotMeshes
from bsp_informed_planner.visualization.swept_arm import GRID, CoarseRobot

BOUNDS = WorkspaceBounds(np.full(3, -1.0), np.full(3, 1.0))
TETRAHEDRON = 0.1 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TETRAHEDRON_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def by_namespace(array: MarkerArray) -> dict[str, list[Marker]]:
    namespaces = defaultdict(list)
    for marker in array.markers[1:]:
        namespaces[marker.ns].append(marker)
    return namespaces


def xyz(marker: Marker) -> FloatArray:
    return np.array([(point.x, point.y, point.z) for point in marker.points])


def check_array(array: MarkerArray, frame: str) -> None:
    assert array.markers[0].action == Marker.DELETEALL
    assert {marker.header.frame_id for marker in array.markers} == {frame}
    added = array.markers[1:]
    assert all(marker.action == Marker.ADD for marker in added)
    assert len({(marker.ns, marker.id) for marker in added}) == len(added)
    for marker in added:
        assert min(marker.scale.x, marker.scale.y, marker.scale.z) > 0.0
        assert 0.0 < marker.color.a <= 1.0
        orientation = marker.pose.orientation
        assert np.isclose(orientation.x**2 + orientation.y**2 + orientation.z**2 + orientation.w**2, 1.0)
        assert len(marker.colors) in (0, len(marker.points))


def plan(path: FloatArray, keypoints: FloatArray) -> PlanResult:
    chain = ConfigurationChain(np.zeros((len(keypoints) + 2, path.shape[1])), np.vstack([[0] * 3, keypoints, [1] * 3]))
    return PlanResult(
        path=path,
        trajectory=Trajectory(np.array([0.0, 1.0]), path[[0, -1]], path[[0, -1]], path[[0, -1]]),
        cost=path_length(path),
        cost_history=CostHistory(),
        planner_id="anytime",
        guidance=Guidance(
            "keypoint_tube",
            (chain,) if len(keypoints) else (),
            tube_sampler([path], 0.1, path.min(axis=0) - 1.0, path.max(axis=0) + 1.0) if len(keypoints) else None,
        ),
        verification_resolution=0.005,
        scene_revision=1,
        certified=False,
    )


def test_decomposition_markers_have_a_marker_for_each_shape_and_list() -> None:
    shelf = Obstacle(
        "shelf",
        (
            (Box(np.array([0.4, 0.2, 0.02])), Pose.identity()),
            (Box(np.array([0.02, 0.2, 0.4])), Pose.from_xyz_rpy([0.2, 0, 0.2])),
        ),
        Pose.from_xyz_rpy([0.3, 0.3, 0.0], [0, 0, 0.5]),
    )
    scene = Scene.of(
        [
            shelf,
            Obstacle.of("ball", Sphere(0.1), Pose.from_xyz_rpy([-0.5, 0, 0])),
            Obstacle.of("can", Cylinder(0.05, 0.3), Pose.from_xyz_rpy([-0.5, 0.5, 0])),
            Obstacle.of("cone", Cone(0.1, 0.2), Pose.from_xyz_rpy([-0.5, -0.5, 0])),
            Obstacle.of("hull", ConvexMesh(TETRAHEDRON), Pose.from_xyz_rpy([0.5, -0.5, 0])),
            Obstacle.of("mesh", Mesh(TETRAHEDRON, TETRAHEDRON_FACES), Pose.from_xyz_rpy([0.5, -0.5, 0.5])),
            Obstacle.of("floor", HalfSpace(np.array([0.0, 0, 1]), 0.8)),
            Obstacle.of("far floor", HalfSpace(np.array([0.0, 0, 1]), 5.0)),
        ],
        BOUNDS,
        frame="base",
    )
    decomposition = decompose(scene)
    array = decomposition_markers(scene, decomposition, Time(sec=3, nanosec=7))
    check_array(array, "base")
    assert all((marker.header.stamp.sec, marker.header.stamp.nanosec) == (3, 7) for marker in array.markers)
    namespaces = by_namespace(array)
    assert set(namespaces) == {"obstacles", "cells", "portals", "keypoint_candidates"}

    obstacles = {marker.id: marker for marker in namespaces["obstacles"]}
    kinds = [obstacles[index].type for index in range(8)]
    assert kinds == [Marker.CUBE, Marker.CUBE, Marker.SPHERE, Marker.CYLINDER, *[Marker.TRIANGLE_LIST] * 4]
    assert len(obstacles) == 8  # the far floor has no surface in the workspace
    board = obstacles[1]
    expected = shelf.placed_shapes()[1][1]
    assert np.allclose([board.pose.position.x, board.pose.position.y, board.pose.position.z], expected.position)
    assert np.allclose([board.pose.orientation.z, board.pose.orientation.w], expected.quaternion[2:])
    assert np.allclose([board.scale.x, board.scale.y, board.scale.z], [0.02, 0.2, 0.4])
    can = obstacles[3]
    assert np.allclose([can.scale.x, can.scale.y, can.scale.z], [0.1, 0.1, 0.3])
    assert len(obstacles[6].points) == 3 * len(TETRAHEDRON_FACES)
    assert np.allclose(xyz(obstacles[7])[:, 2].max(), -0.8)

    (cells,), (portals,), (candidates,) = (namespaces[name] for name in ("cells", "portals", "keypoint_candidates"))
    assert (cells.type, portals.type, candidates.type) == (Marker.LINE_LIST, Marker.TRIANGLE_LIST, Marker.SPHERE_LIST)
    assert np.allclose(xyz(cells).reshape(-1, 2, 3), cell_edges(decomposition))
    corners = np.diff(decomposition.portal_offsets)
    assert len(portals.points) == 3 * int((corners - 2).sum())
    assert portals.color.a < 0.5
    assert np.allclose(xyz(candidates), decomposition.candidates)


def test_empty_lists_are_left_out() -> None:
    scene = Scene.of([], BOUNDS)
    namespaces = by_namespace(decomposition_markers(scene, decompose(scene), Time()))
    assert set(namespaces) == {"cells"}
    assert len(namespaces["cells"][0].points) == 2 * 12


def test_cell_edges_are_within_bounds_and_there_once() -> None:
    maze = environment(2)
    decomposition = decompose(maze.scene, DecompositionOptions(dimension=2))
    edges = cell_edges(decomposition)
    assert BOUNDS.contains(edges.reshape(-1, 3)).all()
    keys = {frozenset((tuple(np.round(a, 5)), tuple(np.round(b, 5)))) for a, b in edges}
    assert len(keys) == len(edges)


def test_plan_markers_of_an_arm() -> None:
    robot = ur5()
    path = np.array([[0.0, -1.2, 1.0, 0.0, 0.5, 0.0], [0.4, -1.0, 1.2, 0.1, 0.5, 0.0], [0.9, -0.7, 1.3, 0.1, 0.2, 0.3]])
    keypoints = np.array([[0.4, 0.1, 0.3], [0.5, 0.2, 0.4]])
    array = plan_markers(robot, plan(path, keypoints))
    check_array(array, robot.root_frame)
    namespaces = by_namespace(array)
    assert set(namespaces) == {"path", "waypoints", "keypoints", "start", "goal", "samples", "swept_robot"}
    assert len(namespaces["samples"][0].points) == 200
    (swept,) = namespaces["swept_robot"]
    assert swept.type == Marker.TRIANGLE_LIST
    # Light, and where the robot is: at both ends, within the step of the grid.
    triangles = xyz(swept).reshape(-1, 3, 3)
    assert len(triangles) < 2000
    meshes = RobotMeshes(robot)
    for state in path[[0, -1]]:
        low, high = (bound(meshes.at(state).points, axis=0) for bound in (np.min, np.max))
        own = CoarseRobot(robot).at(state)
        assert np.abs(own.min(axis=(0, 1)) - low).max() < 2 * GRID
        assert np.abs(own.max(axis=(0, 1)) - high).max() < 2 * GRID
        assert all((np.abs(triangles - triangle).max(axis=(1, 2)) < 1e-9).any() for triangle in own[:5])
    line = namespaces["path"][0]
    assert line.type == Marker.LINE_STRIP
    assert len(line.colors) == len(line.points)
    way = xyz(line)
    assert np.linalg.norm(np.diff(way, axis=0), axis=1).max() < 0.05
    waypoints = np.array([robot.forward_kinematics(state).position for state in path])
    assert np.allclose(way[[0, -1]], waypoints[[0, -1]])
    assert np.allclose(xyz(namespaces["waypoints"][0]), waypoints)
    assert np.allclose(xyz(namespaces["keypoints"][0]), keypoints)
    for name, expected in (("start", waypoints[0]), ("goal", waypoints[-1])):
        (marker,) = namespaces[name]
        assert marker.type == Marker.SPHERE
        assert np.allclose([marker.pose.position.x, marker.pose.position.y, marker.pose.position.z], expected)


def test_plan_markers_without_keypoints_and_of_a_long_path() -> None:
    robot = PointRobot(upper=(100.0, 100.0))
    path = np.array([[0.0, 0.0], [100.0, 100.0], [0.0, 100.0]])
    namespaces = by_namespace(plan_markers(robot, plan(path, np.empty((0, 3)))))
    assert set(namespaces) == {"path", "waypoints", "start", "goal"}
    assert len(namespaces["path"][0].points) < 1100


def test_trees_are_shown_from_nodes_to_their_parents() -> None:
    robot = PointRobot()
    path = np.array([[0.0, 0.0], [1.0, 1.0]])
    small = GrownTree(np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.5]]), np.array([-1, 0, 1]))
    large = GrownTree(np.linspace((1.0, 1.0), (0.0, 1.0), 5000), np.arange(-1, 4999))
    result = replace(plan(path, np.empty((0, 3))), trees=(small, large))
    (marker,) = by_namespace(plan_markers(robot, result))["trees"]
    assert marker.type == Marker.LINE_LIST
    edges = xyz(marker).reshape(-1, 2, 3)[:, :, :2]
    assert np.allclose(edges[:2], [[[0.0, 0.0], [0.5, 0.0]], [[0.5, 0.0], [0.5, 0.5]]])
    # A viewer stands no more than so many.
    assert 1000 < len(edges) < 3000
    assert "trees" not in by_namespace(plan_markers(robot, replace(result, trees=())))
