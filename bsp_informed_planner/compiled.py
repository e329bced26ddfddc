"""The decorator of all compiled functions (kernels), with an on-disk cache that notices every change.

numba's own cache looks at the file of a function alone: after a change in a jitted function of another file it runs the
outdated machine code, which for a collision check is a safety defect. Here the cache folder of a kernel file is keyed
by a hash of that file and of all files of its package that it imports, directly or through others. Kernels live in
files named `*kernels*.py`, and these take functions and constants from numpy, numba, the standard library and other
kernel files only, by import statements.

The folder is `$NUMBA_CACHE_DIR` if that is set, else `$XDG_CACHE_HOME/bsp_informed_planner` or
`~/.cache/bsp_informed_planner`. If it cannot be written, kernels are compiled in memory at each start.

Only kernel files import this module, since it imports numba.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import inspect
import logging
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, overload

import numba
import numpy as np
from numba.core import config

from bsp_informed_planner.user_cache import user_cache

logger = logging.getLogger(__name__)

Function = TypeVar("Function", bound=Callable[..., Any])

KERNEL_FILES = "*kernels*.py"
# `error_model="numpy"`: no branch for division by zero, so loops vectorise. `no_cfunc_wrapper`: kernels are not passed
# on as values, and a wrapper for that takes time to compile.
_DEFAULTS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_config_lock = threading.Lock()


@overload
def kernel(function: Function) -> Function: ...


@overload
def kernel(**options: Any) -> Callable[[Function], Function]: ...


def kernel(function: Function | None = None, **options: Any) -> Function | Callable[[Function], Function]:
    """Compiles a function with `numba.njit`, without the GIL, cached under a hash of its sources.

    Args:
        function: defined in a file named `*kernels*.py`.
        options: of `numba.njit`, e.g. `fastmath=True`; they override the defaults.

    Raises:
        ValueError: if the function's file is not named so: the tests that look at such files would miss it.
    """
    if function is None:
        return lambda decorated: _compiled(decorated, options)
    return _compiled(function, options)


def _compiled(function: Function, options: dict[str, Any]) -> Function:
    source = _kernel_file(function)
    arguments = {**_DEFAULTS, **options}
    folder = cache_folder(source)
    if folder is not None:
        with _caching_in(folder):
            dispatcher = numba.njit(cache=True, **arguments)(function)
        stats = getattr(dispatcher, "stats", None)
        if stats is None or str(stats.cache_path).startswith(str(folder)):
            return dispatcher
        # NUMBA_CACHE_LOCATOR_CLASSES leads elsewhere, to a cache that could be outdated.
        logger.warning("numba puts its cache into %s: compiling %s in memory", stats.cache_path, function.__qualname__)
    return numba.njit(**arguments)(function)


@contextlib.contextmanager
def _caching_in(folder: Path) -> Iterator[None]:
    """NUMBA_CACHE_DIR is numba's documented way to place a cache. It is read when a function is decorated."""
    with _config_lock:
        previous = config.CACHE_DIR
        config.CACHE_DIR = str(folder)
        try:
            yield
        finally:
            config.CACHE_DIR = previous


class Callback:
    """A function that kernels call by its address, compiled when that is first asked for.

    A kernel's machine code holds that of all kernels it calls, and its compilation takes their time again. A large one
    that many call is therefore better called by address.

    Args:
        function: defined in a file named `*kernels*.py`.
        signature: of numba, of numbers and pointers. An exception inside returns 0.
        options: of `numba.cfunc`.

    Raises:
        ValueError: see `kernel`.
    """

    def __init__(self, function: Callable[..., Any], signature: Any, **options: Any) -> None:
        self._source = _kernel_file(function)
        self._function = function
        self._signature = signature
        self._options = {"error_model": "numpy", **options}
        self._lock = threading.Lock()
        self._compiled: Any = None

    @property
    def address(self) -> int:
        """Of the machine code, which lives as long as this does."""
        with self._lock:
            if self._compiled is None:
                folder = cache_folder(self._source)
                if folder is None:
                    self._compiled = numba.cfunc(self._signature, **self._options)(self._function)
                else:
                    with _caching_in(folder):
                        self._compiled = numba.cfunc(self._signature, cache=True, **self._options)(self._function)
            return int(self._compiled.address)


def _kernel_file(function: Callable[..., Any]) -> Path:
    source = Path(inspect.getfile(function))
    if not source.match(KERNEL_FILES):
        raise ValueError(f"{function.__qualname__} is in {source.name}: kernels belong in files named {KERNEL_FILES}")
    return source


def cache_folder(source: Path) -> Path | None:
    """The writable folder that holds the machine code of a kernel file.

    Args:
        source: a Python file.

    Returns:
        the folder, which exists; None if none can be written.
    """
    return _writable_folder(source.resolve(), config.CACHE_DIR)


def package_root(source: Path) -> Path:
    """The folder of the outermost package around a file; the file's own folder if it is in none."""
    root = source.parent
    while (root / "__init__.py").exists() and (root.parent / "__init__.py").exists():
        root = root.parent
    return root


def sources_of(source: Path) -> tuple[Path, ...]:
    """A file and all files of its package that it imports, directly or through others, sorted."""
    root = package_root(source)
    found = {source}
    new = [source]
    while new:
        for imported in _imported_files(new.pop(), root):
            if imported not in found:
                found.add(imported)
                new.append(imported)
    return tuple(sorted(found))


def source_hash(source: Path) -> str:
    """Hash of a kernel file, of all that it imports of its package, of this module, and of the compiler's version."""
    digest = hashlib.sha256(f"numba {numba.__version__} numpy {np.__version__}".encode())
    for path in (Path(__file__), *sources_of(source)):
        content = _content(path)
        digest.update(f"\0{path}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()[:16]


@functools.cache
def _content(path: Path) -> bytes:
    return path.read_bytes()


@functools.cache
def _imported_files(source: Path, root: Path) -> tuple[Path, ...]:
    """The files below `root` that the import statements of one file name."""
    names: list[str] = []
    for node in ast.walk(ast.parse(_content(source))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            # What is imported from a package may be a module of it.
            package = source.parents[node.level - 1].relative_to(root.parent).parts if node.level else ()
            module = ".".join((*package, *((node.module or "").split(".") if node.module else ())))
            names += [module, *(f"{module}.{alias.name}" for alias in node.names)]
    bases = [root.parent.joinpath(*name.split(".")) for name in names if name.split(".")[0] == root.name]
    files = [file for base in bases for file in (base.with_suffix(".py"), base / "__init__.py")]
    return tuple(file for file in files if file.is_file() and file != Path(__file__))


@functools.cache
def _writable_folder(source: Path, configured: str) -> Path | None:
    try:
        base = Path(configured) if configured else user_cache()
        folder = base / "kernels" / f"{source.stem}-{source_hash(source)}"
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except (OSError, RuntimeError) as error:  # RuntimeError: there is no home directory
        logger.warning("no cache of compiled kernels (%s): they are compiled at each start", error)
        return None
    return folder
