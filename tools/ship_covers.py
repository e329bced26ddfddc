"""Puts covers of the demo arms into the package: to be run after a change of the code that builds them.

Usage: python tools/ship_covers.py
"""

from __future__ import annotations

import logging

from bsp_informed_planner.collision.bounds import build_covers
from bsp_informed_planner.collision.cover import CoverOptions
from bsp_informed_planner.collision.cover_files import SHIPPED, cover_key, load_covers, save_covers
from bsp_informed_planner.collision.sharpening import SharpeningOptions
from bsp_informed_planner.robots.demo_arms import panda, tiago, ur5

logger = logging.getLogger(__name__)


def main() -> None:
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    robots = [ur5(), panda(), tiago()]
    keys = [cover_key(robot, CoverOptions(), SharpeningOptions()) for robot in robots]
    for path in SHIPPED.glob("*.npz"):
        if path.stem not in keys:
            path.unlink()
    for robot, key in zip(robots, keys, strict=True):
        if (SHIPPED / f"{key}.npz").is_file():
            logger.info("%s: its covers are there", robot.name)
            continue
        saved = save_covers(key, load_covers(key) or build_covers(robot), SHIPPED)
        logger.info("%s: %s", robot.name, saved)


if __name__ == "__main__":
    main()
