"""Which facets may be in what is partitioned anew."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bsp_informed_planner.decomposition.fate_kernels import BOX_MARGIN, cut_box, is_near_box


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, -1.0]))
def test_a_cut_box_holds_all_that_is_beyond_the_plane(seed: int, side: float) -> None:
    rng = np.random.default_rng(seed)
    lower = rng.uniform(-2.0, 1.0, 3)
    boxes = np.array([[lower, lower + rng.uniform(0.01, 2.0, 3)], np.zeros((2, 3))])
    normal = np.eye(3)[rng.integers(3)] if rng.random() < 0.3 else rng.normal(size=3)
    normal = normal / np.linalg.norm(normal)
    points = rng.uniform(boxes[0, 0], boxes[0, 1], (500, 3))
    plane = np.append(normal, normal @ points[0])
    cut_box(boxes, 0, 1, plane[None], 0, side)
    beyond = points[side * (points @ normal - plane[3]) >= 0.0]
    assert ((beyond >= boxes[1, 0] - 1e-9) & (beyond <= boxes[1, 1] + 1e-9)).all()
    assert (boxes[1, 0] >= boxes[0, 0]).all()
    assert (boxes[1, 1] <= boxes[0, 1]).all()


def test_a_cut_along_an_axis_is_exact() -> None:
    boxes = np.array([[[0.0, 0, 0], [1, 1, 1]], np.zeros((2, 3))])
    cut_box(boxes, 0, 1, np.array([[0.0, -1.0, 0.0, -0.25]]), 0, 1.0)
    np.testing.assert_allclose(boxes[1], np.array([[0.0, 0.0, 0.0], [1.0, 0.25, 1.0]]))


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32 - 1))
def test_a_facet_that_meets_a_box_is_near_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(4, 3))
    corners[3] = corners[0] + corners[2] - corners[1]
    centre = corners.mean(axis=0)
    sphere = np.append(centre, np.linalg.norm(corners - centre, axis=1).max())
    on_it = rng.dirichlet(np.ones(4)) @ corners
    box = np.array([[on_it - rng.uniform(0.0, 0.1, 3), on_it + rng.uniform(0.0, 0.1, 3)]])
    assert is_near_box(corners, 0, 4, sphere[None], 0, box, 0)
    away = box + (corners.max(axis=0) - box[0, 0] + BOX_MARGIN)
    assert not is_near_box(corners, 0, 4, sphere[None], 0, away, 0)
