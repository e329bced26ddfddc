"""`python -m bsp_informed_planner.nodes NAME ...` runs a node; Ctrl-C while it is still loading is no traceback."""

from __future__ import annotations

import importlib
import sys

NAMES = ("decomposition_node", "inference_node", "planner_node", "moveit_bridge")


def main() -> None:
    """Run the node that the first argument names with the rest of them."""
    if len(sys.argv) < 2 or sys.argv[1] not in NAMES:
        sys.exit(f"usage: python -m bsp_informed_planner.nodes {{{','.join(NAMES)}}} [--ros-args ...]")
    try:
        importlib.import_module(f"bsp_informed_planner.nodes.{sys.argv.pop(1)}").main()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
