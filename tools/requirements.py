"""Prints the requirements of setup.py and of some of its extras, one a line, as `pip install -r` reads them.

So that the dependencies can be installed without the package, and setup.py stays the one place that names them.
Standard library only: it runs before anything is installed.

    python tools/requirements.py ros test lint
    python tools/requirements.py --extras-only docs
"""

from __future__ import annotations

import argparse
import runpy
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

SETUP = Path(__file__).resolve().parent.parent / "setup.py"


def read_setup(path: Path) -> dict[str, Any]:
    """Keyword arguments that a setup.py gives to `setup`, read by running it against a stand-in for setuptools."""
    arguments: dict[str, Any] = {}
    stand_in = ModuleType("setuptools")
    vars(stand_in).update(setup=arguments.update, find_packages=lambda **_: [])
    original = sys.modules.get("setuptools")
    sys.modules["setuptools"] = stand_in
    try:
        runpy.run_path(str(path))
    finally:
        del sys.modules["setuptools"]
        if original is not None:
            sys.modules["setuptools"] = original
    return arguments


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("extras", nargs="*", help="extras of setup.py")
    parser.add_argument("--extras-only", action="store_true", help="leave out what the package itself needs")
    options = parser.parse_args()
    names = options.extras
    arguments = read_setup(SETUP)
    extras = arguments["extras_require"]
    unknown = sorted(set(names) - set(extras))
    if unknown:
        raise SystemExit(f"setup.py has no extra {', '.join(unknown)}; it has {', '.join(sorted(extras))}")
    runtime = [] if options.extras_only else arguments["install_requires"]
    requirements = set(runtime).union(*(extras[name] for name in names))
    print("\n".join(sorted(requirements, key=str.lower)))


if __name__ == "__main__":
    main()
