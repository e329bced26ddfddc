"""Samples for a search: uniform where a better path can still lie, or from elsewhere (Gammell et al., 2014)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.planning.neighbour_kernels import distance
from bsp_informed_planner.planning.random_kernels import RandomState, normal, uniform

#: Draws from the informed subset before a sample is moved into the box instead.
_TRIES = 20


class Space(NamedTuple):
    """Where a search draws samples, and how it measures.

    Attributes:
        box: (2, n) lower and upper corner of the box of uniform samples.
        weights: (n,) of the joints in lengths.
        ends: (1 + g, n) the start, and the goals.
        bound: (1,) only paths shorter than this are of interest; infinite at first. Searches of several threads may
            share it.
        random: state of the generator.
    """

    box: Floats
    weights: Floats
    ends: Floats
    bound: Floats
    random: RandomState


class Supply(NamedTuple):
    """Samples from elsewhere, one batch at a time.

    Attributes:
        samples: (k, n) the batch.
        used: (1,) how many of it have been drawn.
        uniform_fraction: chance of a uniform sample instead; at 1 the batch may be empty.
    """

    samples: Floats
    used: Indices
    uniform_fraction: float


@kernel
def to_goals(space: Space, configuration: Floats) -> float:
    """Distance to the nearest goal."""
    best = np.inf
    for g in range(space.ends.shape[0] - 1):
        best = min(best, distance(configuration, space.ends[1 + g], space.weights))
    return best


@kernel
def may_improve(space: Space, configuration: Floats) -> bool:
    """Whether a path shorter than the bound can pass through a configuration."""
    if space.bound[0] == np.inf:
        return True
    from_start = distance(space.ends[0], configuration, space.weights)
    return from_start < space.bound[0] and from_start + to_goals(space, configuration) < space.bound[0]


@kernel
def _uniform_in_box(space: Space, sample: Floats) -> None:
    for i in range(sample.shape[0]):
        sample[i] = space.box[0, i] + (space.box[1, i] - space.box[0, i]) * uniform(space.random)


@kernel(inline="always")
def _uniform_in_subset(space: Space, goal: Floats, sample: Floats) -> None:
    """Uniform in the prolate hyperspheroid whose foci are start and goal.

    The first axis is turned onto the direction of the foci by a reflection; a ball does not mind.
    """
    n = sample.shape[0]
    bound = space.bound[0]
    foci = distance(space.ends[0], goal, space.weights)
    across = 0.5 * math.sqrt(max(bound * bound - foci * foci, 0.0))
    squared = 0.0
    for i in range(n):
        sample[i] = normal(space.random)
        squared += sample[i] * sample[i]
    scale = uniform(space.random) ** (1.0 / n) / math.sqrt(max(squared, 1e-300))
    for i in range(n):
        sample[i] *= scale * (0.5 * bound if i == 0 else across)
    if foci > 0.0:
        mirror = np.empty(n)
        length, along = 0.0, 0.0
        for i in range(n):
            mirror[i] = (1.0 if i == 0 else 0.0) - space.weights[i] * (goal[i] - space.ends[0, i]) / foci
            length += mirror[i] * mirror[i]
            along += mirror[i] * sample[i]
        if length > 1e-24:
            for i in range(n):
                sample[i] -= 2.0 * along / length * mirror[i]
    for i in range(n):
        sample[i] = 0.5 * (space.ends[0, i] + goal[i]) + sample[i] / space.weights[i]


@kernel(inline="always")
def draw_uniform(space: Space, sample: Floats) -> None:
    """A uniform sample where a better path can lie, into `sample` (n,)."""
    if space.bound[0] == np.inf:
        _uniform_in_box(space, sample)
        return
    for attempt in range(_TRIES):
        # A wide subset lies mostly outside of the box, a narrow one fills little of it: both ways, in turn.
        if attempt % 2 == 1:
            _uniform_in_box(space, sample)
            if may_improve(space, sample):
                return
            continue
        # Any of the goals that are near enough, with equal chance.
        near = 0
        chosen = 0
        for g in range(space.ends.shape[0] - 1):
            if distance(space.ends[0], space.ends[1 + g], space.weights) < space.bound[0]:
                near += 1
                if uniform(space.random) * near < 1.0:
                    chosen = g
        _uniform_in_subset(space, space.ends[1 + chosen], sample)
        inside = True
        for i in range(sample.shape[0]):
            inside = inside and space.box[0, i] <= sample[i] <= space.box[1, i]
        if inside:
            return
    for i in range(sample.shape[0]):
        sample[i] = min(max(sample[i], space.box[0, i]), space.box[1, i])


@kernel
def is_empty(supply: Supply) -> bool:
    """Whether another batch is needed before the next sample."""
    return supply.uniform_fraction < 1.0 and supply.used[0] == supply.samples.shape[0]


@kernel
def draw(space: Space, supply: Supply, sample: Floats) -> None:
    """The next sample, into `sample` (n,). What the supply holds outside the informed subset is replaced."""
    fraction = supply.uniform_fraction
    if fraction < 1.0 and (fraction == 0.0 or uniform(space.random) >= fraction):
        row = supply.used[0]
        supply.used[0] = row + 1
        for i in range(sample.shape[0]):
            sample[i] = supply.samples[row, i]
        if may_improve(space, sample):
            return
    draw_uniform(space, sample)
