"""The wheel and the source archive hold what they should, and the wheel works without the checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
NAME = "bsp_informed_planner"
VERSION = "0.1.0"


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A wheel and a source archive, built from a copy: a build leaves files beside the sources."""
    source = tmp_path_factory.mktemp("source") / "checkout"
    junk = shutil.ignore_patterns(".*", "__pycache__", "build", "dist", "out", "*.egg-info", "install", "log")
    shutil.copytree(ROOT, source, ignore=junk)
    out = tmp_path_factory.mktemp("dist")
    quiet = {"cwd": source, "check": True, "capture_output": True, "text": True}
    wheel = [
        "wheel",
        "--no-deps",
        "--no-build-isolation",
        "--no-input",
        "--disable-pip-version-check",
        "-w",
        str(out),
        ".",
    ]
    subprocess.run([sys.executable, "-m", "pip", *wheel], **quiet)  # type: ignore[call-overload]
    subprocess.run([sys.executable, "setup.py", "-q", "sdist", "-d", str(out)], **quiet)  # type: ignore[call-overload]
    return next(out.glob("*.whl")), next(out.glob("*.tar.gz"))


@pytest.fixture(scope="module")
def unpacked(archives: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, as in site-packages."""
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(archives[0]) as wheel:
        wheel.extractall(folder)
    return folder


def run(unpacked: Path, cwd: Path, *command: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Python with the unpacked wheel before everything else, far from the checkout."""
    return subprocess.run(
        [sys.executable, "-P", *command] if sys.version_info >= (3, 11) else [sys.executable, *command],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(unpacked), **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_wheel_holds_the_package_and_its_data(unpacked: Path) -> None:
    sources = {path.relative_to(ROOT) for path in (ROOT / NAME).rglob("*.py")}
    packed = {path.relative_to(unpacked) for path in (unpacked / NAME).rglob("*.py")}
    assert packed == sources
    for data in (ROOT / NAME).rglob("*"):
        if data.suffix in (".safetensors", ".json", ".yaml", ".typed"):
            assert (unpacked / data.relative_to(ROOT)).is_file(), data
    share = unpacked / f"{NAME}-{VERSION}.data" / "data" / "share"
    for kind in ("launch", "config"):
        installed = {path.relative_to(share / NAME) for path in (share / NAME / kind).rglob("*.*")}
        there = {path.relative_to(ROOT) for path in (ROOT / kind).rglob("*") if path.suffix in (".py", ".yaml", ".xml")}
        assert installed == there
    assert (share / NAME / "package.xml").is_file()
    assert (share / "ament_index" / "resource_index" / "packages" / NAME).is_file()
    info = unpacked / f"{NAME}-{VERSION}.dist-info"
    scripts = (info / "entry_points.txt").read_text()
    for script in ("bsp-planner", "decomposition_node", "inference_node", "planner_node"):
        assert f"\n{script} = {NAME}." in scripts
    assert any(info.rglob("LICENSE"))
    metadata = (info / "METADATA").read_text(encoding="utf-8")
    assert "Description-Content-Type: text/markdown" in metadata
    assert not any("test" in path.parts for path in packed)


def test_the_source_archive_can_be_built_and_tested(archives: tuple[Path, Path]) -> None:
    with tarfile.open(archives[1]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for name in ("Makefile", "constraints.txt", "CHANGELOG.md", "LICENSE", "package.xml", "msg_defs/srv/Plan.srv"):
        assert name in names
    for folder in ("test", "tools", "examples", "config", "launch", "cmake", "docs"):
        missing = {str(path.relative_to(ROOT)) for path in (ROOT / folder).glob("*.*") if path.is_file()} - names
        assert not missing
    assert "bsp_informed_planner/scene/scene.py" in names


EVERYTHING = f"""
import importlib, pkgutil, sys
import {NAME}
from {NAME}.cli.app import main
for module in pkgutil.walk_packages({NAME}.__path__, "{NAME}."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
for name, module in sys.modules.items():
    if name.split(".")[0] == "{NAME}":
        print(module.__file__)
main()
"""


def test_the_wheel_works_without_the_checkout(unpacked: Path, tmp_path: Path) -> None:
    """All modules come from it, and the command answers."""
    # Kernels are not compiled: their cache is kept by path, and this one is new.
    done = run(unpacked, tmp_path, "-c", EVERYTHING, "--help", NUMBA_DISABLE_JIT="1")
    assert done.returncode == 0, done.stderr
    files = [line for line in done.stdout.splitlines() if line.endswith(".py")]
    assert len(files) > 100
    assert all(Path(file).is_relative_to(unpacked) for file in files)
    assert "decompose" in done.stdout


def test_import_is_quick(unpacked: Path, tmp_path: Path) -> None:
    code = f"import time; t = time.perf_counter(); import {NAME}; print(time.perf_counter() - t)"
    assert min(float(run(unpacked, tmp_path, "-c", code).stdout) for _ in range(3)) < 0.3
