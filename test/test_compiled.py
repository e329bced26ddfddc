"""The decorator of kernels and its on-disk cache."""

from __future__ import annotations

import ast
import gc
import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

import bsp_informed_planner
from bsp_informed_planner import compile_kernels
from bsp_informed_planner.compiled import KERNEL_FILES, kernel, package_root, sources_of

PACKAGE = Path(bsp_informed_planner.__file__).parent
# What kernel files may import: whatever else they read would not be covered by the hash of their sources.
ALLOWED_IMPORTS = {"__future__", "collections.abc", "math", "numpy", "numpy.typing", "typing"}
ALLOWED_IMPORTS |= {"numba", "numba.core", "numba.extending", "numba.np.arrayobj"}
ALLOWED_MODULES = {"bsp_informed_planner.compiled", "bsp_informed_planner.decomposition.array_types"}

SCRIPT = """
from arithmetic.top_kernels import twice_plus
print(twice_plus(10), sum(twice_plus.stats.cache_hits.values()))
"""
TOP = """
from bsp_informed_planner.compiled import kernel
from arithmetic.deep.base_kernels import offset

@kernel
def twice_plus(x):
    return 2 * x + offset(x)
"""
BASE = """
from bsp_informed_planner.compiled import kernel

@kernel
def offset(x):
    return {offset}
"""


def _write_package(folder: Path, offset: int) -> None:
    (folder / "arithmetic" / "deep").mkdir(parents=True, exist_ok=True)
    for part in ("arithmetic", "arithmetic/deep"):
        (folder / part / "__init__.py").touch()
    (folder / "arithmetic" / "top_kernels.py").write_text(TOP)
    (folder / "arithmetic" / "deep" / "base_kernels.py").write_text(BASE.format(offset=offset))


def _run(folder: Path, **environment: str) -> tuple[int, bool]:
    """The value that the package computes, and whether the code came from the cache."""
    variables = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{PACKAGE.parent}", "PYTHONDONTWRITEBYTECODE": "1"}
    for name in ("NUMBA_CACHE_DIR", "NUMBA_CACHE_LOCATOR_CLASSES"):
        variables.pop(name, None)
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        env={**variables, **environment},
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    value, hits = done.stdout.split()
    return int(value), hits != "0"


def test_a_change_in_another_file_is_noticed(tmp_path: Path) -> None:
    """The trap: numba's own cache runs the outdated code here."""
    cache = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    _write_package(tmp_path, offset=1)
    assert _run(tmp_path, **cache) == (21, False)
    assert _run(tmp_path, **cache) == (21, True)
    _write_package(tmp_path, offset=5)
    assert _run(tmp_path, **cache) == (25, False)


def test_the_cache_can_be_placed_by_numbas_variable(tmp_path: Path) -> None:
    _write_package(tmp_path, offset=1)
    assert _run(tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "here"))[0] == 21
    assert list((tmp_path / "here").rglob("*.nbi"))


def test_works_without_a_writable_folder(tmp_path: Path) -> None:
    _write_package(tmp_path, offset=1)
    (tmp_path / "file").touch()  # a folder cannot be made below a file, not even by root
    assert _run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "file")) == (21, False)
    assert not list(tmp_path.rglob("*.nbi"))


def test_a_foreign_cache_locator_is_not_used(tmp_path: Path) -> None:
    _write_package(tmp_path, offset=1)
    cache = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "NUMBA_CACHE_LOCATOR_CLASSES": "InTreeCacheLocator"}
    assert _run(tmp_path, **cache) == (21, False)
    assert not list(tmp_path.rglob("*.nbi"))


def test_kernels_outside_of_kernel_files_are_refused() -> None:
    with pytest.raises(ValueError, match="kernels belong in files named"):

        @kernel
        def half(x: float) -> float:
            return 0.5 * x


def test_hash_covers_what_a_kernel_file_imports_and_no_more(tmp_path: Path) -> None:
    _write_package(tmp_path, offset=1)
    root = tmp_path / "arithmetic"
    top, base = root / "top_kernels.py", root / "deep" / "base_kernels.py"
    assert package_root(base) == root
    assert set(sources_of(top)) == {top, base}
    assert sources_of(base) == (base,)


@pytest.mark.parametrize(
    "statement",
    [
        "from arithmetic.deep.base_kernels import offset",
        "from arithmetic.deep import base_kernels",
        "import arithmetic.deep.base_kernels as base",
        "from .deep.base_kernels import offset",
        "from .deep import base_kernels",
        "def f():\n    from arithmetic.deep import base_kernels",
    ],
)
def test_every_kind_of_import_is_followed(tmp_path: Path, statement: str) -> None:
    _write_package(tmp_path, offset=1)
    top = tmp_path / "arithmetic" / "other_kernels.py"
    top.write_text(statement)
    assert tmp_path / "arithmetic" / "deep" / "base_kernels.py" in sources_of(top)


def _imports(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
    return names


@pytest.mark.parametrize(
    "path", sorted(p for p in PACKAGE.rglob(KERNEL_FILES) if "import kernel" in p.read_text()), ids=lambda p: p.name
)
def test_kernel_files_take_nothing_that_the_hash_does_not_cover(path: Path) -> None:
    for name in _imports(path) - ALLOWED_IMPORTS - ALLOWED_MODULES:
        assert name.startswith("bsp_informed_planner."), name
        assert Path(*name.split(".")).with_suffix(".py").match(KERNEL_FILES), name


def test_importing_the_package_does_not_load_numba() -> None:
    code = "import sys, bsp_informed_planner, bsp_informed_planner.scene.shelf; sys.exit('numba' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_compile_kernels_reports_each_part(monkeypatch: pytest.MonkeyPatch) -> None:
    part = "decomposition"
    monkeypatch.setattr(compile_kernels, "WARM_UPS", {part: compile_kernels.WARM_UPS[part]})
    lines: list[str] = []
    thresholds = gc.get_threshold()
    assert compile_kernels.compile_kernels(lines.append, [part]) > 0.0
    assert [line.split()[0] for line in lines] == [f"{part}:"]
    assert gc.get_threshold() == thresholds


def test_every_part_is_compiled_by_one_process() -> None:
    assert sorted(part for share in compile_kernels.SHARES for part in share) == sorted(compile_kernels.WARM_UPS)


def test_warm_up_functions_exist() -> None:
    for target in compile_kernels.WARM_UPS.values():
        module, function = target.split(":")
        assert callable(getattr(importlib.import_module(module), function))


def test_plans_wait_for_no_compiler() -> None:
    """What the warm-ups do not call would be compiled during somebody's first plan, for a second or two."""
    script = Path(__file__).parent / "kernels_of_plans.py"
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == []
