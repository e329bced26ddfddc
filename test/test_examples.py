"""Every script in examples/ runs as it is and says what it should."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from suite import running_suite

ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples"


def run(name: str, cwd: Path, *arguments: str, **environment: str) -> str:
    """What a script prints, run from another folder."""
    command = [sys.executable, str(EXAMPLES / name), *arguments]
    variables = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    done = subprocess.run(command, cwd=cwd, env=variables, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def run_beside_suite(name: str, cwd: Path) -> str:
    """What a script prints that talks to the three nodes."""
    with running_suite("ur5") as suite:
        suite.add_all()
        domain = str(100 + os.getpid() % 100)
        return run(name, cwd, "--ros-args", "-r", f"__ns:={suite.namespace}", ROS_DOMAIN_ID=domain)


def test_plan_from_python(tmp_path: Path) -> None:
    printed = run("plan_from_python.py", tmp_path)
    assert "certified free of collision: True" in printed
    assert printed.count("a path of length") >= 1


def test_own_robot(tmp_path: Path) -> None:
    printed = run("own_robot.py", tmp_path)
    assert printed.startswith("note: ")
    assert "5 joints" in printed
    before, after = map(int, re.search(r"(\d+) -> (\d+) pairs", printed).groups())  # type: ignore[union-attr]
    assert after < before
    assert "PlanResult(certified" in printed


def test_own_scene(tmp_path: Path) -> None:
    printed = run("own_scene.py", tmp_path, "--out", "made")
    assert "3 obstacles" in printed
    assert "PlanResult(certified" in printed
    assert (tmp_path / "made" / "own_scene.yaml").is_file()


def test_point_robot(tmp_path: Path) -> None:
    printed = run("point_robot.py", tmp_path)
    assert printed.count("samples to a path") == 2
    assert (tmp_path / "out" / "point_robot.png").stat().st_size > 10_000


def test_publish_points(tmp_path: Path) -> None:
    printed = run_beside_suite("publish_points.py", tmp_path)
    assert re.fullmatch(r"2400 points are an obstacle of revision \d+ of the scene\n", printed)


def test_call_plan_service(tmp_path: Path) -> None:
    printed = run_beside_suite("call_plan_service.py", tmp_path)
    assert printed.startswith("1 path of cost")
    assert "certified: True" in printed


def test_the_node_of_the_readme_is_the_example() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    [shown] = re.findall(r"```python\n(import rclpy.*?)```", readme, re.DOTALL)
    code = (
        (EXAMPLES / "call_plan_service.py")
        .read_text(encoding="utf-8")
        .partition("from __future__ import annotations\n")[2]
    )

    def words(text: str) -> str:
        """Without the alignment of comments, which a formatter has an opinion on."""
        return re.sub(r"\s+", " ", text).strip()

    assert words(code) == words(shown)


@pytest.mark.parametrize("script", sorted(path.name for path in EXAMPLES.glob("*.py")))
def test_every_script_has_a_test(script: str) -> None:
    assert f'"{script}"' in Path(__file__).read_text(encoding="utf-8")
