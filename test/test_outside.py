"""Obstacles outside of the workspace are pointed out, not refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from suite import PATIENCE, running_suite, spin_until
from typer.testing import CliRunner

from bsp_informed_planner.cli.app import app
from bsp_informed_planner.nodes.decomposition_node import DecompositionNode
from bsp_informed_planner.scene.outside import obstacles_outside, outside_warning
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, HalfSpace, Sphere
from bsp_informed_planner.scene.yaml_io import save_scene

BOUNDS = WorkspaceBounds(np.zeros(3), np.ones(3))
CUBE = Box(np.full(3, 0.2))


def at(name: str, x: float) -> Obstacle:
    return Obstacle.of(name, CUBE, Pose.from_xyz_rpy([x, 0.5, 0.5]))


def test_only_what_lies_wholly_outside_is_named() -> None:
    both = Obstacle("both", ((CUBE, Pose.from_xyz_rpy([5, 0, 0])), (CUBE, Pose.from_xyz_rpy([0.5, 0.5, 0.5]))))
    floor = Obstacle.of("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.1))
    deep = Obstacle.of("deep", HalfSpace(np.array([0.0, 0.0, 1.0]), 3.0))
    scene = Scene.of([at("in", 0.5), at("border", 1.05), at("out", 1.2), both, floor, deep], BOUNDS)
    assert obstacles_outside(scene) == ("out", "deep")
    assert outside_warning(scene).startswith("'out', 'deep' wholly outside the workspace bounds [0., 0., 0.] to [1.")
    assert outside_warning(Scene.of([at("in", 0.5)], BOUNDS)) == ""
    many = Scene.of([Obstacle.of(f"o{i}", Sphere(0.1), Pose.from_xyz_rpy([9, 0, 0])) for i in range(7)], BOUNDS)
    assert "'o4' and 2 more" in outside_warning(many)


def test_the_command_line_warns_and_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    save_scene(path, Scene.of([at("in", 0.5), at("millimetres", 500.0)], BOUNDS))
    done = CliRunner().invoke(app, ["decompose", str(path), "--json"])
    assert done.exit_code == 0
    assert "warning: 'millimetres'" in done.stderr
    assert len(json.loads(done.stdout)["warnings"]) == 1
    ends = ["--start", "0.1,0.1", "--goal", "0.9,0.9", "--seed", "1", "--first"]
    done = CliRunner().invoke(app, ["plan", str(path), "--robot", "point", *ends])
    assert done.exit_code == 0
    assert "warning: 'millimetres'" in done.stderr


def test_the_decomposition_node_warns_and_goes_on() -> None:
    with running_suite("point") as suite:
        suite.add(DecompositionNode)
        client = suite.client()
        spin_until(client, lambda: client._publisher.get_subscription_count() > 0)
        assert client.publish_scene(Scene.of([at("in", 0.5), at("out", 5.0)], BOUNDS), PATIENCE) == 1
        assert client._status is not None
        assert client._status.message.startswith("2 obstacles; warning: 'out' wholly outside")


def test_a_folder_is_made_for_a_picture_or_the_option_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    save_scene(path, Scene.of([at("in", 0.5)], BOUNDS))
    ends = ["--robot", "point", "--start", "0.1,0.1", "--goal", "0.9,0.9", "--seed", "1", "--first"]
    for command in (["decompose", str(path), "--dimension", "2"], ["plan", str(path), *ends]):
        picture = tmp_path / "new" / command[0] / "picture.png"
        done = CliRunner().invoke(app, [*command, "--png", str(picture)])
        assert done.exit_code == 0, done.output
        assert picture.stat().st_size > 1000
        done = CliRunner().invoke(app, [*command, "--png", str(path / "below" / "a file.png")])
        assert "--png" in str(done.exception)
        done = CliRunner().invoke(app, [*command, "--png", str(tmp_path)])
        assert "not a folder" in str(done.exception)
