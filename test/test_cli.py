from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bsp_informed_planner.cli.app import app
from bsp_informed_planner.cli.node_processes import NodeDiedError, NodeProcesses, _yaml_scalar
from bsp_informed_planner.cli.robots import RobotChoice
from bsp_informed_planner.errors import BspPlannerError, InvalidOptionError, InvalidStateError
from bsp_informed_planner.robots.demo_arms import example_robot_data
from bsp_informed_planner.robots.locked import parse_locked_joints
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.yaml_io import save_scene

runner = CliRunner()


@pytest.fixture
def maze_file(tmp_path: Path) -> Path:
    path = tmp_path / "maze.yaml"
    save_scene(path, random_maze(np.random.default_rng(3)).problem)
    return path


def test_plan_prints_a_path(maze_file: Path) -> None:
    result = runner.invoke(app, ["plan", str(maze_file), "--robot", "point", "--seed", "1", "--first", "--json"])
    assert result.exit_code == 0, result.output
    content = json.loads(result.stdout)
    problem = random_maze(np.random.default_rng(3)).problem
    assert content["success"]
    assert content["certified"]
    assert np.allclose(content["path"][0], problem.start)
    assert np.allclose(content["path"][-1], problem.goals[0])
    assert content["joint_names"] == ["x", "y"]
    assert len(content["trajectory"]["times"]) == len(content["trajectory"]["positions"])


def test_plan_speaks_and_draws(maze_file: Path, tmp_path: Path) -> None:
    png = tmp_path / "path.png"
    goal = ["--start", "0.1,0.1", "--goal-pose", "0.9,0.9,0,0,0,0", "--seconds", "30", "--first"]
    result = runner.invoke(app, ["plan", str(maze_file), "--robot", "point", "--png", str(png), *goal])
    # Whether these two are free is up to the maze; either way it is said in a sentence.
    assert ("path of cost" in result.output) == (result.exit_code == 0)
    assert png.exists() == (result.exit_code == 0)
    if result.exit_code:
        assert "collides with" in result.output


def test_a_value_that_an_option_does_not_take_is_refused_in_one_sentence() -> None:
    result = runner.invoke(app, ["nodes", "--robot", "ur6"])
    assert result.exit_code == 2
    assert "Invalid value for '--robot': 'ur6' is not one of 'ur5', 'point'" in result.stderr


def test_a_sampler_without_a_model_is_warned_of(maze_file: Path) -> None:
    options = ["--robot", "point", "--seed", "1", "--first", "--sampler-id", "learned"]
    result = runner.invoke(app, ["plan", str(maze_file), *options, "--models", str(maze_file.parent)])
    assert result.exit_code == 0, result.output
    assert "warning: learned: no model of kind" in result.stderr


def test_bad_problems_are_sentences(maze_file: Path) -> None:
    result = runner.invoke(app, ["plan", str(maze_file), "--robot", "point", "--goal", "5,5", "--json"])
    assert result.exit_code == 2
    content = json.loads(result.stdout)
    assert content["error"] == "StateOutsideLimitsError"
    assert "joint 'x'" in content["message"]
    for option, error in (("--goal", InvalidOptionError), ("--start", InvalidOptionError)):
        result = runner.invoke(app, ["plan", str(maze_file), "--robot", "point", option, "here"])
        assert isinstance(result.exception, error)
    plain = maze_file.with_name("plain.yaml")
    save_scene(plain, random_maze(np.random.default_rng(3)).scene)
    result = runner.invoke(app, ["plan", str(plain), "--robot", "point", "--goal", "0.5,0.5"])
    assert isinstance(result.exception, InvalidStateError)
    # The wrong robot for the frame, or no scene at all.
    nonsense = maze_file.with_name("nonsense.yaml")
    nonsense.write_text("a: [1, 2")
    result = runner.invoke(app, ["plan", str(nonsense), "--robot", "point"])
    assert isinstance(result.exception, BspPlannerError)
    assert "nonsense.yaml" in str(result.exception)


def test_errors_leave_no_traceback(maze_file: Path) -> None:
    command = [sys.executable, "-m", "bsp_informed_planner.cli.app", "plan", str(maze_file), "--robot", "point"]
    done = subprocess.run([*command, "--goal", "x"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("error: --goal")
    assert "Traceback" not in done.stderr


def test_decompose_counts_and_draws(maze_file: Path, tmp_path: Path) -> None:
    png = tmp_path / "cells.png"
    result = runner.invoke(app, ["decompose", str(maze_file), "--dimension", "2", "--png", str(png)])
    assert result.exit_code == 0, result.output
    assert "free cells" in result.stdout
    assert png.stat().st_size > 10_000
    result = runner.invoke(app, ["decompose", str(maze_file), "--dimension", "2", "--json"])
    content = json.loads(result.stdout)
    table = (Path(__file__).parent.parent / "docs" / "decomposition.md").read_text()
    assert set(content) <= set(re.findall(r"`(\w+)`", table))
    assert content["free_cells"] >= len(content["cells"]) > 0
    assert len(content["portal_polygons"]) == content["portals"]
    assert len(content["candidate_points"]) == content["candidates"]


@pytest.mark.parametrize("command", ["demo", "nodes", "plan", "decompose", "collect"])
def test_every_command_explains_itself(command: str) -> None:
    result = runner.invoke(app, [command, "--help"], env={"COLUMNS": "200"})
    assert result.exit_code == 0
    assert "--" in result.stdout


def test_help_loads_no_robot_no_ros_and_no_kernels() -> None:
    code = (
        "import sys\nfrom bsp_informed_planner.cli.app import app\n"
        "heavy = {'rclpy', 'pinocchio', 'numba', 'matplotlib', 'torch', 'scipy'} & set(sys.modules)\n"
        "sys.exit(', '.join(heavy) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_parameters_are_yaml_scalars() -> None:
    assert _yaml_scalar(True) == "true"
    assert _yaml_scalar("it's 1") == "'it''s 1'"
    assert _yaml_scalar([1.5, "a"]) == "[1.5, 'a']"
    assert RobotChoice("ur5").parameters() == {"robot": "ur5"}
    own = RobotChoice("ur5", Path("a.urdf"), None, (Path("x"), Path("y")), "tip", ("finger=0.01",)).parameters()
    assert own["robot"] == ""
    assert own["tool_frame"] == "tip"
    assert own["locked_joints"] == "finger=0.01"
    assert str(own["package_dirs"]).count(":") == 1
    with pytest.raises(InvalidOptionError, match="--tool-frame"):
        RobotChoice("ur5", tool_frame="gripper")


def test_joints_can_be_locked() -> None:
    assert parse_locked_joints("") == {}
    assert parse_locked_joints("a=0.5, b=-1") == {"a": 0.5, "b": -1.0}
    for nonsense in ("a", "a=", "=1", "a=x"):
        with pytest.raises(InvalidOptionError, match="NAME=VALUE"):
            parse_locked_joints(nonsense)


def test_panda_plans_with_its_fingers_held() -> None:
    share = example_robot_data() / "example-robot-data" / "robots" / "panda_description"
    urdf = ["--urdf", str(share / "urdf" / "panda.urdf"), "--package-dir", str(share.parent.parent.parent)]
    scene = Path(__file__).parent.parent / "examples" / "shelf.yaml"
    refused = runner.invoke(app, ["plan", str(scene), *urdf])
    assert "--lock" in str(refused.exception)
    locked = runner.invoke(app, ["plan", str(scene), *urdf, "--lock", "panda_finger_joint1=0.02"])
    # The shelf of the UR5 is given in another frame, and the answer says what to do.
    assert "panda_link0" in str(locked.exception)
    assert "root link" in str(locked.exception)


def test_the_example_is_planned(tmp_path: Path) -> None:
    scene = Path(__file__).parent.parent / "examples" / "shelf.yaml"
    result = runner.invoke(app, ["plan", str(scene), "--seed", "1", "--first"])
    assert result.exit_code == 0, result.output
    assert "certified path" in result.output
    assert "tool frame tool0" in result.output


def test_nodes_end_with_sigterm_and_with_their_parent() -> None:
    for ending in (signal.SIGTERM, signal.SIGKILL):
        environment = {**os.environ, "ROS_DOMAIN_ID": str(1 + (os.getpid() + 20) % 90), "PYTHONUNBUFFERED": "1"}
        command = [sys.executable, "-m", "bsp_informed_planner.cli.app", "nodes", "--robot", "point"]
        suite = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert suite.stdout is not None
        assert suite.stdout.readline().startswith("robot point")
        suite.stdout.readline()
        children = _children(suite.pid)
        assert len(children) == 3
        suite.send_signal(ending)
        suite.wait(timeout=60.0)
        end = time.monotonic() + 60.0
        while any(Path(f"/proc/{child}/cmdline").exists() and _is_running(child) for child in children):
            assert time.monotonic() < end
            time.sleep(0.1)


def _children(parent: int) -> list[int]:
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = stat.read_text().rsplit(")", 1)[1].split()
            if int(fields[1]) == parent:
                found.append(int(stat.parent.name))
    return found


def _is_running(process: int) -> bool:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    return False


def test_a_node_that_dies_is_named(tmp_path: Path) -> None:
    parameters = {"planner_node": {"robot": "no-such-robot"}}
    environment = {"ROS_DOMAIN_ID": str(1 + os.getpid() % 90)}
    with NodeProcesses(parameters, environment=environment, log_dir=tmp_path) as processes:
        with pytest.raises(NodeDiedError, match=r"planner_node has ended with status 3.*planner_node\.log"):
            processes.wait()
        log = (tmp_path / "planner_node.log").read_text()
        assert "no-such-robot" in log
        assert "Traceback" not in log
    assert all(process.poll() is not None for process in processes.processes.values())


def test_nodes_stop_on_ctrl_c() -> None:
    environment = {**os.environ, "ROS_DOMAIN_ID": str(1 + (os.getpid() + 45) % 90)}
    command = [sys.executable, "-m", "bsp_informed_planner.cli.app", "nodes", "--robot", "point"]
    config = Path(__file__).parent.parent / "config" / "point.yaml"
    suite = subprocess.Popen(
        [*command, "--params-file", str(config)],
        env={**environment, "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert suite.stdout is not None
    assert suite.stdout.readline().startswith("robot point: 2 joints (x, y)")
    assert suite.stdout.readline().startswith("started decomposition_node, inference_node, planner_node")
    time.sleep(2.0)
    assert suite.poll() is None
    suite.send_signal(signal.SIGINT)
    _, errors = suite.communicate(timeout=60.0)
    assert suite.returncode == 0
    assert "Traceback" not in errors


def test_nodes_that_are_told_to_end_before_they_spin_end_quietly() -> None:
    code = (
        "import rclpy; from bsp_informed_planner.nodes.lifecycle import _spin_until_told_to_end as spin; "
        "rclpy.init(); rclpy.shutdown(); spin(None); print('ended')"
    )
    outcome = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60.0, check=False)
    assert (outcome.returncode, outcome.stdout, outcome.stderr) == (0, "ended\n", "")
