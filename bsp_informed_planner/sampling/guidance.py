"""What guides a search: keypoint chains in configuration space, and the sampler around them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.sampler import MixtureSampler, Sampler
from bsp_informed_planner.scene.pose import FloatArray


@dataclass(frozen=True, eq=False)
class ConfigurationChain:
    """A chain of keypoints, lifted to configurations: start, keypoints, goal.

    Attributes:
        configurations: (m, n) [rad or m].
        points: (m, 3) its `keypoints`, or what works them out from the configurations: a search does not need them.
    """

    configurations: FloatArray
    points: FloatArray | Callable[[FloatArray], FloatArray]

    @cached_property
    def keypoints(self) -> FloatArray:
        """(m, 3) the chain in the workspace [m]; for the ends, the reference point of the robot."""
        return self.points(self.configurations) if callable(self.points) else self.points


@dataclass(frozen=True, eq=False)
class Guidance:
    """Guidance for one problem.

    Attributes:
        sampler_id: which sampler it came from.
        chains: best first.
        sampler: the mixture of the local samplers along the chains, without the uniform share; None: uniform only.
        fallback_reason: why this is not the sampler that was asked for; empty if it is, or was not needed.
        seconds: time taken to make it [s].
        remark: what else there is to say, e.g. that it was not needed.
    """

    sampler_id: str
    chains: tuple[ConfigurationChain, ...] = ()
    sampler: Sampler | None = None
    fallback_reason: str = ""
    seconds: float = 0.0
    remark: str = ""

    @property
    def keypoints(self) -> FloatArray:
        """(m, 3) keypoints of the best chain, its ends left out [m]."""
        return self.chains[0].keypoints[1:-1] if self.chains else np.empty((0, 3))

    def joined_by(self, other: Guidance) -> Guidance:
        """This guidance with the chains of another one behind its own, and samples of both, in equal parts."""
        samplers = [guidance.sampler for guidance in (self, other) if guidance.sampler is not None]
        return replace(
            self,
            chains=self.chains + other.chains,
            sampler=MixtureSampler(samplers) if len(samplers) > 1 else next(iter(samplers), None),
            seconds=self.seconds + other.seconds,
            remark="; ".join(filter(None, (self.remark, f"{other.sampler_id} joined, since no path had been found"))),
        )


@dataclass(frozen=True)
class KeypointGuideOptions:
    """How keypoints are lifted to configurations.

    Attributes:
        tilts: angles by which the tool is tilted about both of its lateral axes [rad].
        rolls: angles by which it is turned about its approach axis [rad].
        layer_size: most collision-free configurations kept for a keypoint.
        exact_checks: where the bounds prove none of a keypoint's configurations free, so many are checked exactly, the
            nearest ones of those that the bounds leave open.
        chain_count: most chains returned; the second and later ones avoid the edges found in collision.
        repairs: how often the path through the layers is searched again around edges in collision.
        blocked_penalty: factor on the length of an edge found in collision.
        removals: how often a keypoint without any free configuration is removed and the graph searched again
            (RemoveEdge, Algorithm 2, line 8).
        sigma: standard deviation of the tube around the chains [rad; for a point robot see `relative_sigma`].
        relative_sigma: the same for robots of prismatic joints only, as a fraction of the diagonal of their space.
        clearance_weight: weight of the soft clearance term of the graph search; None: its default.
    """

    tilts: tuple[float, ...] = (-0.9, -0.5, 0.5, 0.9)
    rolls: tuple[float, ...] = (-np.pi / 2, np.pi / 2, np.pi)
    layer_size: int = 8
    exact_checks: int = 4
    chain_count: int = 4
    repairs: int = 12
    blocked_penalty: float = 3.0
    removals: int = 20
    sigma: float = 0.2
    relative_sigma: float = 0.02
    clearance_weight: float | None = None

    def tube_sigma(self, robot: Robot) -> float:
        """Standard deviation of the tube for a robot [rad or m]."""
        if robot.revolute.any():
            return self.sigma
        return self.relative_sigma * float(np.linalg.norm(robot.upper - robot.lower))
