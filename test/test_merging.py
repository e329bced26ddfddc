"""Merging of keypoints."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.graph import has_line_of_sight, shortest_chain
from bsp_informed_planner.decomposition.merging import merge_keypoints
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.pose import FloatArray

FLAT = DecompositionOptions(dimension=2)


def line(*x: float) -> FloatArray:
    return np.column_stack((x, np.zeros(len(x)), np.zeros(len(x))))


def paper_merging(keypoints: FloatArray, epsilon: float) -> list[FloatArray]:
    """Algorithm 2, lines 17 to 22, letter by letter."""
    points: list[FloatArray | None] = list(keypoints)
    for i in range(len(points) - 1):
        here, following = points[i], points[i + 1]
        if here is not None and following is not None and np.linalg.norm(following - here) < epsilon:
            points[i + 1] = 0.5 * (following + here)
            points[i] = None
    return [point for point in points if point is not None]


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 8), epsilon=st.floats(0.0, 1.0))
def test_without_a_decomposition_it_is_the_papers(seed: int, count: int, epsilon: float) -> None:
    points = np.random.default_rng(seed).uniform(0.0, 1.0, (count + 2, 3))
    merged = merge_keypoints(points, epsilon)
    expected = [points[0], *paper_merging(points[1:-1], epsilon), points[-1]]
    np.testing.assert_allclose(merged, np.array(expected))


def test_midpoints_follow_each_other() -> None:
    np.testing.assert_allclose(merge_keypoints(line(0.0, 1.0, 1.1, 1.2, 3.0), 0.2)[:, 0], [0.0, 1.125, 3.0])
    np.testing.assert_allclose(merge_keypoints(line(0.0, 1.0, 1.1, 1.5, 3.0), 0.2)[:, 0], [0.0, 1.05, 1.5, 3.0])


def test_ends_stay() -> None:
    np.testing.assert_array_equal(merge_keypoints(line(0.0, 0.01, 0.02), 1.0), line(0.0, 0.01, 0.02))
    np.testing.assert_array_equal(merge_keypoints(line(0.0, 0.01), 1.0), line(0.0, 0.01))
    with pytest.raises(ValueError, match="expected"):
        merge_keypoints(np.zeros((1, 3)), 0.1)


def test_line_of_sight_survives() -> None:
    plain_broken, merged_away = 0, 0
    for seed in range(30):
        maze = random_maze(np.random.default_rng(seed))
        decomposition = decompose(maze.scene, FLAT)
        chain = shortest_chain(decomposition, maze.start, maze.goal)
        checked = merge_keypoints(chain.points, 0.06, decomposition)
        for start, end in zip(checked[:-1], checked[1:], strict=True):
            assert has_line_of_sight(decomposition, start, end)
        merged_away += len(chain.points) - len(checked)
        plain = merge_keypoints(chain.points, 0.06)
        plain_broken += sum(
            not has_line_of_sight(decomposition, start, end) for start, end in zip(plain[:-1], plain[1:], strict=True)
        )
    assert merged_away > 10
    assert plain_broken > 10  # what the check is for


def test_points_that_are_not_finite_are_named() -> None:
    with pytest.raises(ValueError, match="number 1 is not finite"):
        merge_keypoints([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [1.0, 0.0, 0.0]], 0.1)
