"""Parameter files are for the nodes that are started, or refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from bsp_informed_planner.cli.node_processes import NODE_NAMES
from bsp_informed_planner.cli.nodes import run_nodes
from bsp_informed_planner.cli.parameter_files import require_known_nodes
from bsp_informed_planner.cli.robots import RobotChoice
from bsp_informed_planner.errors import UnknownNodeError

CONFIG = Path(__file__).resolve().parent.parent / "config"


def written(folder: Path, *sections: str) -> Path:
    path = folder / "parameters.yaml"
    path.write_text("".join(f"{section}:\n  ros__parameters:\n    workers: 2\n" for section in sections))
    return path


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.yaml")), ids=lambda path: str(path.name))
@pytest.mark.parametrize("namespace", ["", "cell", "/factory/cell"])
def test_files_that_come_with_the_package_are_for_any_namespace(path: Path, namespace: str) -> None:
    require_known_nodes(path, NODE_NAMES, namespace)


@pytest.mark.parametrize(
    ("section", "namespace"),
    [
        ("/**", ""), ("/**", "a/b"), ("/**/planner_node", "a/b"), ("/**/planner_node", ""), ("planner_node", ""),
        ("/planner_node", ""), ("/*/planner_node", "a"), ("/a/**", "a/b"), ("/a/*/planner_node", "/a/b"), ("/*", ""),
        ("/a/planner_node", "a"), ("a:\n planner_node", "a"),
    ],
)  # fmt: skip
def test_what_ros_matches_is_accepted(tmp_path: Path, section: str, namespace: str) -> None:
    path = tmp_path / "parameters.yaml"
    path.write_text(f"{section}:\n  ros__parameters:\n    workers: 2\n")
    require_known_nodes(path, NODE_NAMES, namespace)


@pytest.mark.parametrize(
    ("section", "namespace", "meant"),
    [
        ("/**/planer_node", "", "'/**/planner_node'"),
        ("planer_node", "", "'/planner_node'"),
        ("/planner_node", "cell", "'/cell/planner_node'"),
        ("/*/planner_node", "", "'/planner_node'"),
        ("/cell/inferencenode", "cell", "'/cell/inference_node'"),
        ("/driver", "", ""),
    ],
)
def test_a_section_for_nobody_is_refused(tmp_path: Path, section: str, namespace: str, meant: str) -> None:
    path = written(tmp_path, "/**/decomposition_node", section)
    with pytest.raises(UnknownNodeError) as caught:
        require_known_nodes(path, NODE_NAMES, namespace)
    assert str(path) in str(caught.value)
    assert caught.value.section.endswith(section.strip("/"))
    assert str(caught.value).endswith(f"(did you mean {meant}?)") if meant else "did you mean" not in str(caught.value)


def test_what_is_no_parameter_file_is_left_to_ros(tmp_path: Path) -> None:
    for text in ("[1, 2", "- a", "", "ros__parameters:\n  a: 1\n", "planer_node:\n  workers: 2\n"):
        path = tmp_path / "parameters.yaml"
        path.write_text(text)
        require_known_nodes(path, NODE_NAMES)


def test_nodes_are_not_started_with_it(tmp_path: Path) -> None:
    with pytest.raises(UnknownNodeError, match="planer_node"):
        run_nodes(RobotChoice("point"), "", written(tmp_path, "/**/planer_node"), restart=False)
