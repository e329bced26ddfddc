"""The benchmark of the nodes: its requests, its figures, and small runs of its parts."""

from __future__ import annotations

import numpy as np
import pytest

from bsp_informed_planner.benchmarks.nodes import cancels, overhead, soak, stress, updates
from bsp_informed_planner.benchmarks.nodes.benchmark import nodes_benchmark
from bsp_informed_planner.benchmarks.nodes.random_requests import gap_message, good_request, random_request
from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.errors import SceneError
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.plan_conversions import options_from_msg, problem_from_msg
from bsp_informed_planner.nodes.scene_keeper import SceneKeeper
from bsp_informed_planner.nodes.size_limits import SizeLimits
from bsp_informed_planner.planning.problem import PlanOptions
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.scene import WorkspaceBounds

RNG = np.random.default_rng(0)


def lines(section: Section) -> list[str]:
    return [number.line() for number in section.numbers]


def test_about_half_of_the_requests_are_good() -> None:
    first, second = np.random.default_rng(1), np.random.default_rng(1)
    good = 0
    for _ in range(2000):
        request = random_request(first)
        assert str(request) == str(random_request(second))
        good += request.planner_id == "" and len(request.goal_states) == 1 and request.padding == 0.0
    assert 800 < good < 1900
    request = good_request(first)
    problem_from_msg(request, PointRobot(), {})
    options_from_msg(request, PlanOptions(), 60.0)


def test_a_few_scenes_are_bad() -> None:
    rng = np.random.default_rng(2)
    keeper = SceneKeeper("world", WorkspaceBounds(np.zeros(3) - 1.0, np.ones(3)), "points")
    refused = 0
    for _ in range(200):
        try:
            keeper.take_scene(gap_message(rng), SizeLimits())
        except SceneError:
            refused += 1
    assert 2 <= refused <= 25


def test_growth_is_a_slope_of_the_later_part() -> None:
    plans = np.arange(0.0, 1000.0, 10.0)
    filling = np.minimum(plans, 200.0)
    assert soak.growth(plans.tolist(), filling.tolist()) == pytest.approx(0.0, abs=1e-9)
    assert soak.growth(plans.tolist(), (filling + 0.002 * plans).tolist()) == pytest.approx(20.0)
    assert np.isnan(soak.growth([5.0, 5.0], [1.0, 2.0]))


def test_updates_in_this_process() -> None:
    row = updates.measure({"where": "one process", "updates": 2}, np.random.default_rng(3))
    assert row["boxes"] == 20
    assert len(row["seconds"]) == 2
    assert 0.0 < min(row["seconds"]) < 30.0
    section = Section("updates")
    updates.summarise([row], section, RNG)
    assert "scene of 20 boxes to first plan, one process" in lines(section)[0]


def test_cancels_in_this_process() -> None:
    row = cancels.measure({"where": "one process", "problems": 1, "repeats": 3}, np.random.default_rng(5))
    assert len(row["seconds"]) == len(row["codes"]) == 3
    assert 0.0 < max(row["seconds"]) < 20.0
    assert set(row["codes"]) == {ErrorCode.PREEMPTED}
    section = Section("cancels")
    cancels.summarise([row], section, RNG)
    assert "cancel of plan_motion, longest, one process" in lines(section)[1]
    assert "(at most 50 ms)" in lines(section)[1]


def test_figures_of_the_other_parts() -> None:
    section = Section("overhead")
    row = {
        "where": "one process",
        "library": [0.010, 0.012],
        "service": [0.011, 0.0135],
        "empty": [0.0005, 0.0005],
        "points": [30, 40],
        "difference": [0.001, 0.0015],
        "different_paths": 0,
    }
    overhead.summarise([row], section, RNG)
    assert "plan service over the library, one process: 1.25" in lines(section)[0]
    assert lines(section)[0].endswith("holds")
    assert "empty service round trip, one process: 0.5" in lines(section)[1]
    section = Section("stress")
    stress.summarise(
        [
            {
                "requests": 8,
                "answers": 7,
                "codes": {"SUCCESS": 6, "CRASH": 1},
                "latencies": [0.1] * 7,
                "scenes": 3,
                "seconds": 1.0,
                "answering_seconds": 0.5,
                "died": [],
                "grown_mib": {"planner_node": 3.0},
            }
        ],
        section,
        RNG,
    )
    said = lines(section)
    assert "requests without an answer: 1" in said[0]
    assert said[0].endswith("falls short")
    assert said[1].endswith("falls short")
    assert said[2].endswith("holds")
    assert "14" in said[3]
    assert [part.name for part in nodes_benchmark(True).parts] == ["overhead", "updates", "cancels", "stress"]
