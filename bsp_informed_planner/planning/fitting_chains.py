"""Guidance from elsewhere is not trusted: chains that do not fit a problem are dropped."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import Guidance
from bsp_informed_planner.scene.pose import FloatArray

logger = logging.getLogger(__name__)


def with_fitting_chains(guidance: Guidance, robot: Robot, start: FloatArray, goals: FloatArray) -> Guidance:
    """Guidance without the chains that do not lead, within limits, from the start to a goal, with the reason.

    Args:
        guidance: from wherever.
        robot: gives the limits.
        start: (n,).
        goals: (k, n).
    """

    def fits(configurations: FloatArray) -> bool:
        first, last = configurations[0], configurations[-1]
        ends = np.array_equal(first, start) and (last == goals).all(axis=1).any()
        inside = (configurations >= robot.lower) & (configurations <= robot.upper)
        return bool(ends and inside.all())

    chains = tuple(chain for chain in guidance.chains if fits(chain.configurations))
    if len(chains) == len(guidance.chains):
        return guidance
    foreign = len(guidance.chains) - len(chains)
    why = "a chain starts elsewhere, ends at no goal, or leaves the limits"
    reason = f"{foreign} of {len(guidance.chains)} chains dropped: {why}"
    logger.warning(reason)
    return replace(guidance, chains=chains, fallback_reason="; ".join(filter(None, (guidance.fallback_reason, reason))))
