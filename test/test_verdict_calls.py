from __future__ import annotations

import numpy as np
from ball_scene import ROBOT, Balls

from bsp_informed_planner.collision.bounds import bounds_of
from bsp_informed_planner.collision.stored_checks_kernels import empty_checks
from bsp_informed_planner.collision.verdict_calls_kernels import COLLIDING, FREE, UNDECIDED
from bsp_informed_planner.pointer_kernels import type_of

BALLS = Balls(np.array([[0.5, 0.5], [0.2, 0.8]]), np.array([0.2, 0.1]))


def test_stored_checks_have_the_type_of_real_ones() -> None:
    """Else what is called by address would read nonsense."""
    assert type_of(bounds_of(ROBOT).checks(BALLS.scene)) == type_of(empty_checks())


def test_verdicts_are_right() -> None:
    rng = np.random.default_rng(0)
    starts, ends = rng.uniform(size=(2, 400, 2))
    verdicts = BALLS.verdicts()
    codes = verdicts.of_edges(starts, ends)
    truth = np.array([BALLS.is_edge_free(a, b) for a, b in zip(starts, ends, strict=True)])
    assert truth[codes == FREE].all()
    assert not truth[codes == COLLIDING].any()
    assert (codes != UNDECIDED).mean() > 0.95
    states = verdicts.of_states(starts)
    assert states.tolist() == [verdicts.of_state(start) for start in starts]
    assert np.array_equal(states, verdicts.of_edges(starts, starts))


def test_what_is_left_of_an_edge_holds_all_that_is_not_free() -> None:
    verdicts = BALLS.verdicts()
    # Along a tangent, which no sphere can decide on.
    start, end = np.array([0.1, 0.7]), np.array([0.9, 0.7])
    code, left = verdicts.of_edge(start, end)
    assert code != FREE
    if code == UNDECIDED:
        assert (left[:, 0] < left[:, 1]).all()
        assert any(low <= 0.5 <= high for low, high in left)
