"""What the numbers were measured on."""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import platform
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from bsp_informed_planner.networks.card import SHIPPED

PACKAGE = Path(__file__).resolve().parents[1]
LIBRARIES = ("numpy", "scipy", "numba", "coal", "ompl")


def describe_machine() -> dict[str, str]:
    """Processor, operating system and versions."""
    return {
        "processor": _processor(),
        "logical processors": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        **{name: _version(name) for name in LIBRARIES},
        PACKAGE.name: _version(PACKAGE.name),
    }


def processors() -> list[int]:
    """Those that this process may run on; none where the system does not tell."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []


def pin_to(processor: int, pids: Sequence[int] = (0,)) -> None:
    """Keep processes, by default this one and those that it starts from now on, on one processor, where that can be."""
    if hasattr(os, "sched_setaffinity"):
        for pid in pids:
            os.sched_setaffinity(pid, {processor})


@contextmanager
def pinned(pids: Sequence[int] = ()) -> Iterator[None]:
    """Keeps this process and others meanwhile on one processor, the last one that they may run on."""
    before = {pid: os.sched_getaffinity(pid) for pid in (0, *pids)} if processors() else {}
    try:
        if before:
            pin_to(processors()[-1], tuple(before))
        yield
    finally:
        for pid, allowed in before.items():
            with suppress(ProcessLookupError):
                os.sched_setaffinity(pid, allowed)


def describe_load() -> str:
    """How busy the machine is: times are worth less where others use it."""
    try:
        minute = os.getloadavg()[0]
    except (AttributeError, OSError):
        return "unknown"
    return f"{minute:.1f} processes on average when the last run began"


def source_hash(folders: tuple[str, ...]) -> str:
    """Hash of the Python sources in some folders of the package."""
    digest = hashlib.sha256(sys.version.encode())
    for folder in folders:
        for path in sorted((PACKAGE / folder).rglob("*.py")):
            content = path.read_bytes()
            digest.update(f"\0{path.relative_to(PACKAGE)}\0{len(content)}\0".encode())
            digest.update(content)
    return digest.hexdigest()[:16]


def models_hash(folders: tuple[str | None, ...]) -> str:
    """Hash of the weights in some folders of models; None: of those that come with the package."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted((SHIPPED if folder is None else Path(folder)).glob("*.safetensors")):
            digest.update(f"\0{path.name}\0".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:16]


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed as a package"


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"
