"""Every dependency is justified, and everything that is imported is a dependency."""

from __future__ import annotations

import ast
import functools
import importlib.metadata
import re
import runpy
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SETUP = runpy.run_path(str(ROOT / "tools" / "requirements.py"))["read_setup"](ROOT / "setup.py")
# From a ROS installation or the extra `ros`, where they have other names.
ROS = {"rclpy", "launch", "launch_ros", "ament_index_python", "builtin_interfaces", "rcl_interfaces", "std_srvs"}
# Distributions that do not list what they install for import.
OF_MODULE = {"pinocchio": "pin", "coal": "coal"}


def documented() -> dict[str, dict[str, str]]:
    """Justification by requirement, by section of docs/dependencies.md."""
    sections: dict[str, dict[str, str]] = {}
    rows: dict[str, str] = {}
    for line in (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            name = re.search(r"`(\w+)`", line)
            rows = sections.setdefault(name.group(1) if name else line[3:], {})
        elif row := re.fullmatch(r"\| `([^`]+)` \| (.+) \| (.+) \|", line):
            rows[row.group(1)] = row.group(2)
            assert row.group(3).strip(), f"{row.group(1)} has no licence"
    return sections


def test_the_tables_are_those_of_setup_py() -> None:
    expected = {"Runtime": SETUP["install_requires"], **SETUP["extras_require"]}
    tables = documented()
    assert set(tables) == set(expected)
    for section, requirements in expected.items():
        assert sorted(tables[section]) == sorted(requirements), section
        assert all(len(why) > 4 for why in tables[section].values())


def name_of(requirement: str) -> str:
    return re.split(r"[<>=!\[; ]", requirement, maxsplit=1)[0].lower().replace("_", "-")


def imports_of(folder: Path) -> dict[str, list[str]]:
    """Files by the top-level name that they import."""
    found: dict[str, list[str]] = {}
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                names = [node.module]
            for name in names:
                found.setdefault(name.split(".")[0], []).append(str(path.relative_to(ROOT)))
    return found


@pytest.mark.parametrize(
    ("folder", "extras"), [("bsp_informed_planner", ("learning", "baselines", "view")), ("examples", ())]
)
def test_what_is_imported_is_declared(folder: str, extras: tuple[str, ...]) -> None:
    declared = {name_of(r) for r in SETUP["install_requires"]}
    for extra in extras:
        declared |= {name_of(r) for r in SETUP["extras_require"][extra]}
    for name, files in imports_of(ROOT / folder).items():
        if name in sys.stdlib_module_names or name in ROS or name == "bsp_informed_planner" or name.endswith("_msgs"):
            continue
        assert distributions_of(name) & declared, f"{name}: {files[:3]}"


@functools.cache
def _owners() -> Mapping[str, list[str]]:
    return importlib.metadata.packages_distributions()


def distributions_of(module: str) -> set[str]:
    """What may install a module."""
    owners = _owners().get(module, [OF_MODULE.get(module, module)])
    return {name_of(owner) for owner in owners}


def test_every_runtime_dependency_is_imported() -> None:
    used = set().union(*map(distributions_of, imports_of(ROOT / "bsp_informed_planner")))
    found_by_its_name = {"example-robot-data"}
    assert {name_of(r) for r in SETUP["install_requires"]} - used == found_by_its_name


def test_versions_agree() -> None:
    from bsp_informed_planner import __version__

    assert SETUP["version"] == __version__
    for package in (ROOT / "package.xml", ROOT / "msg_defs" / "package.xml"):
        assert f"<version>{__version__}</version>" in package.read_text(encoding="utf-8")
    assert f"\n## {__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
