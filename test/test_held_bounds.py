"""Bounds of robots that hold something: built in the time of the plan, which does not wait longer than it may."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bsp_informed_planner_msgs.msg import AttachedObstacle as AttachedMessage
from bsp_informed_planner_msgs.msg import Obstacle as ObstacleMessage
from shape_msgs.msg import SolidPrimitive
from suite import LONG, PATIENCE, SOON, gap_scene, point_request, running_suite, until

from bsp_informed_planner.collision import bounds
from bsp_informed_planner.collision.bounds import bounds_key, bounds_of
from bsp_informed_planner.collision.holding import HoldingRobot, robot_in_scene
from bsp_informed_planner.errors import PlanningCancelledError, RobotNotReadyError
from bsp_informed_planner.nodes import held_bounds
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.held_bounds import HeldBounds
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.scene import AttachedObstacle, Obstacle
from bsp_informed_planner.scene.shapes import Sphere


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bsp_informed_planner.collision.cover_files.user_cache", lambda: tmp_path)


@pytest.fixture
def held_up() -> Iterator[dict[str, threading.Lock]]:
    """Locks of keys whose bounds another thread seems to build."""
    locks: dict[str, threading.Lock] = {}
    yield locks
    for lock in locks.values():
        if lock.locked():
            lock.release()


def with_disc(radius: float) -> HoldingRobot:
    body = AttachedObstacle(Obstacle.of("disc", Sphere(radius)), "point", frozenset())
    robot = robot_in_scene(PointRobot(), replace(gap_scene(0.8), attached={"disc": body}))
    assert isinstance(robot, HoldingRobot)
    return robot


def hold_up(locks: dict[str, threading.Lock], robot: HoldingRobot) -> threading.Lock:
    lock = threading.Lock()
    lock.acquire()
    bounds._building[bounds_key(robot)] = locks[bounds_key(robot)] = lock
    return lock


def test_who_cannot_wait_is_told_and_the_work_goes_on(held_up: dict[str, threading.Lock]) -> None:
    robot, held = with_disc(0.0211), HeldBounds()
    lock = hold_up(held_up, robot)
    with pytest.raises(RobotNotReadyError, match="holds disc' are being built; ask again"):
        held.of(robot, 0.03)
    with pytest.raises(PlanningCancelledError):
        held.of(robot, LONG, lambda: True)
    # One thread is at it, for all robots that are alike.
    with pytest.raises(RobotNotReadyError):
        held.of(with_disc(0.0211), 0.0)
    assert len([thread for thread in threading.enumerate() if thread.name == "held"]) == 1
    lock.release()
    assert held.of(robot, PATIENCE).robot is robot
    assert held.of(with_disc(0.0211), 0.0).reach == bounds_of(robot).reach
    assert not held._building


def test_there_are_not_any_number_of_threads(held_up: dict[str, threading.Lock]) -> None:
    held = HeldBounds()
    for index in range(held_bounds.MOST_AT_ONCE + 2):
        robot = with_disc(0.022 + 1e-4 * index)
        hold_up(held_up, robot)
        with pytest.raises(RobotNotReadyError):
            held.of(robot, 0.0)
    assert len(held._building) == held_bounds.MOST_AT_ONCE
    for lock in held_up.values():
        lock.release()
    until(lambda: not held._building)


def test_what_goes_wrong_is_raised_where_it_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> None:
        raise MemoryError("no room")

    monkeypatch.setattr(held_bounds, "bounds_of", fail)
    with pytest.raises(MemoryError, match="no room"):
        HeldBounds().of(with_disc(0.0231))


def test_the_time_of_a_plan_has_them_in_it(held_up: dict[str, threading.Lock]) -> None:
    radius = 0.0241
    body = ObstacleMessage(id="disc", primitives=[SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[radius])])
    attached = [AttachedMessage(obstacle=body, link_name="point")]
    lock = hold_up(held_up, with_disc(radius))
    with running_suite("point") as suite:
        suite.add_all(use_inference=False)
        client = suite.client()
        client.wait_for_nodes(PATIENCE)
        client.publish_scene(gap_scene(0.8), PATIENCE)
        suite.settle(client)
        begin = time.monotonic()
        response = client.plan(point_request(attached=attached, allowed_planning_time=0.2), PATIENCE)
        assert response.error_code == ErrorCode.COLLISION_CHECKING_UNAVAILABLE
        assert "are being built" in response.message
        assert time.monotonic() - begin < SOON
        threading.Timer(0.3, lock.release).start()
        response = client.plan(point_request(attached=attached), PATIENCE)
        assert response.error_code == ErrorCode.SUCCESS, response.message
        assert response.statistics.total_seconds > 0.25
        # Once they are there, nobody waits for them again.
        again = client.plan(point_request(attached=attached), PATIENCE)
        assert again.statistics.total_seconds < response.statistics.total_seconds
        assert np.isfinite(again.cost)
