"""Builds the interface package msg_defs against the ROS wheels and installs it into the environment that runs this.

Only for environments made from wheels: on a sourced ROS installation colcon builds msg_defs. Standard library only.

    .venv/bin/python tools/build_messages.py --build-dir .venv/build/msg_defs
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "msg_defs"
TOP_LEVEL_INCLUDE = ROOT / "cmake" / "drop_foreign_python_includes.cmake"


def find_tool(name: str, scripts: Path) -> str:
    """Path of a build tool: that of the environment if it has one, else the one on the PATH."""
    found = shutil.which(name, path=str(scripts)) or shutil.which(name)
    if found is None:
        raise SystemExit(f"{name} is missing: install the environment's dependencies first (make setup)")
    return found


def run(command: list[str], log: Path, environment: dict[str, str]) -> None:
    """Runs a command with its output in `log`; shows the log's end and exits if it fails."""
    with log.open("a", encoding="utf-8") as stream:
        stream.write(f"$ {' '.join(command)}\n")
        stream.flush()
        code = subprocess.run(command, stdout=stream, stderr=subprocess.STDOUT, env=environment, check=False).returncode
    if code != 0:
        tail = "\n".join(log.read_text(encoding="utf-8", errors="replace").splitlines()[-40:])
        raise SystemExit(f"{tail}\nbuilding the messages failed: {command[0]} returned {code}; the whole log is {log}")


def build(build_dir: Path, jobs: int) -> None:
    """Configures, builds and installs msg_defs.

    Args:
        build_dir: folder of the build; made anew, since a cache of another path or Python would mislead CMake.
        jobs: compiler processes.
    """
    prefix = Path(sys.prefix)
    scripts = Path(sysconfig.get_path("scripts"))
    cmake = find_tool("cmake", scripts)
    ninja = find_tool("ninja", scripts)

    manifest = build_dir / "install_manifest.txt"
    installed_before = set(manifest.read_text(encoding="utf-8").splitlines()) if manifest.exists() else set()
    shutil.rmtree(build_dir, ignore_errors=True)
    build_dir.mkdir(parents=True)
    log = build_dir / "build_messages.log"

    environment = dict(os.environ)
    # A sourced workspace must not leak in: the messages would be built against libraries of another installation.
    for name in ("PYTHONPATH", "COLCON_PREFIX_PATH", "ROS_DISTRO"):
        environment.pop(name, None)
    environment["AMENT_PREFIX_PATH"] = str(prefix)
    environment["CMAKE_PREFIX_PATH"] = str(prefix)
    environment["PATH"] = os.pathsep.join([str(scripts), environment.get("PATH", os.defpath)])

    configure = [
        cmake,
        "-S",
        str(SOURCE),
        "-B",
        str(build_dir),
        "-G",
        "Ninja",
        "-Wno-dev",
        f"-DCMAKE_MAKE_PROGRAM={ninja}",
        "-DCMAKE_BUILD_TYPE=Release",
        f"-DCMAKE_INSTALL_PREFIX={prefix}",
        f"-DCMAKE_PREFIX_PATH={prefix}",
        f"-DPython3_EXECUTABLE={sys.executable}",
        f"-DCMAKE_PROJECT_TOP_LEVEL_INCLUDES={TOP_LEVEL_INCLUDE}",
        "-DBUILD_TESTING=OFF",
    ]
    run(configure, log, environment)
    run([cmake, "--build", str(build_dir), "--parallel", str(jobs)], log, environment)
    run([cmake, "--install", str(build_dir)], log, environment)

    # Messages that no longer exist must not stay importable.
    for path in installed_before - set(manifest.read_text(encoding="utf-8").splitlines()):
        Path(path).unlink(missing_ok=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--build-dir", type=Path, default=Path(sys.prefix) / "build" / "msg_defs")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    begin = time.monotonic()
    build(arguments.build_dir.resolve(), arguments.jobs)
    print(f"messages built and installed in {time.monotonic() - begin:.1f} s")


if __name__ == "__main__":
    main()
