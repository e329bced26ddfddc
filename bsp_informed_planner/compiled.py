"""The decorator of all compiled functions (kernels), with an on-disk cache that notices every change.

numba's own cache looks at the file of a function alone: after a change in a jitted function of another file it runs the
outdated machine code, which for a collision check is a safety defect. Here the cache folder is keyed by a hash of all
kernel sources of the package instead. Kernels therefore live in files named `*kernels*.py`, and these take functions
and constants from numpy, numba, the standard library and other kernel files only.

The folder is `$NUMBA_CACHE_DIR` if that is set, else `$XDG_CACHE_HOME/bsp_informed_planner` or
`~/.cache/bsp_informed_planner`. If it cannot be written, kernels are compiled in memory at each start.

Only kernel files import this module, since it imports numba.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import logging
import os
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, overload

import numba
import numpy as np
from numba.core import config

logger = logging.getLogger(__name__)

Function = TypeVar("Function", bound=Callable[..., Any])

KERNEL_FILES = "*kernels*.py"
# `error_model="numpy"`: no branch for division by zero, so loops vectorise.
_DEFAULTS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
_config_lock = threading.Lock()


@overload
def kernel(function: Function) -> Function: ...


@overload
def kernel(**options: Any) -> Callable[[Function], Function]: ...


def kernel(function: Function | None = None, **options: Any) -> Function | Callable[[Function], Function]:
    """Compiles a function with `numba.njit`, without the GIL, cached under a hash of all kernel sources.

    Args:
        function: defined in a file named `*kernels*.py`.
        options: of `numba.njit`, e.g. `fastmath=True`; they override the defaults.

    Raises:
        ValueError: if the function's file is not named so: the hash would not cover it.
    """
    if function is None:
        return lambda decorated: _compiled(decorated, options)
    return _compiled(function, options)


def _compiled(function: Function, options: dict[str, Any]) -> Function:
    source = Path(inspect.getfile(function))
    if not source.match(KERNEL_FILES):
        raise ValueError(f"{function.__qualname__} is in {source.name}: kernels belong in files named {KERNEL_FILES}")
    arguments = {**_DEFAULTS, **options}
    folder = cache_folder(source)
    if folder is not None:
        # NUMBA_CACHE_DIR is numba's documented way to place a cache. A dispatcher reads it when it is made.
        with _config_lock:
            previous = config.CACHE_DIR
            config.CACHE_DIR = str(folder)
            try:
                dispatcher = numba.njit(cache=True, **arguments)(function)
            finally:
                config.CACHE_DIR = previous
        stats = getattr(dispatcher, "stats", None)
        if stats is None or str(stats.cache_path).startswith(str(folder)):
            return dispatcher
        # NUMBA_CACHE_LOCATOR_CLASSES leads elsewhere, to a cache that could be outdated.
        logger.warning("numba puts its cache into %s: compiling %s in memory", stats.cache_path, function.__qualname__)
    return numba.njit(**arguments)(function)


def cache_folder(source: Path) -> Path | None:
    """The writable folder that holds the machine code of the package to which a source file belongs.

    Args:
        source: a Python file.

    Returns:
        the folder, which exists; None if none can be written.
    """
    return _writable_folder(package_root(source.resolve()), config.CACHE_DIR)


def package_root(source: Path) -> Path:
    """The folder of the outermost package around a file; the file's own folder if it is in none."""
    root = source.parent
    while (root / "__init__.py").exists() and (root.parent / "__init__.py").exists():
        root = root.parent
    return root


def source_hash(root: Path) -> str:
    """Hash of all kernel sources below `root`, of this module, and of the versions of numba and numpy."""
    digest = hashlib.sha256(f"numba {numba.__version__} numpy {np.__version__}".encode())
    for path in (Path(__file__), *sorted(root.rglob(KERNEL_FILES))):
        content = path.read_bytes()
        digest.update(f"\0{path.name}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()[:16]


@functools.cache
def _writable_folder(root: Path, configured: str) -> Path | None:
    try:
        folder = _user_folder(configured) / "kernels" / source_hash(root)
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except (OSError, RuntimeError) as error:  # RuntimeError: there is no home directory
        logger.warning("no cache of compiled kernels (%s): they are compiled at each start", error)
        return None
    return folder


def _user_folder(configured: str) -> Path:
    if configured:
        return Path(configured)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "bsp_informed_planner"
