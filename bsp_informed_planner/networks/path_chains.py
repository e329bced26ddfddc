"""A network that proposes several whole paths at once."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn


class Proposals(NamedTuple):
    """What the network proposes for each of b problems.

    Attributes:
        shapes: (b, heads, waypoints, n) how far waypoints are from the straight line [rad or m].
        logits: (b, heads) of each head being the best one.
    """

    shapes: Tensor
    logits: Tensor


class PathChains(nn.Module):
    """Proposes chains of waypoints between start and goal, one a head, by a multilayer perceptron.

    Heads are trained so that the best one counts (winner takes all; Guzman-Rivera et al., Multiple Choice Learning,
    2012): where several ways around obstacles are as good, heads share them, and none is an average of two.

    Args:
        condition_size: length c of a condition, see `networks.problem_view`.
        state_size: n.
        heads: number of proposals.
        waypoints: of each, between start and goal.
        hidden: units of each hidden layer.
        layers: number of hidden layers.
        dropout: share of units that rest in a training step.
    """

    mean: Tensor
    scale: Tensor

    def __init__(
        self,
        condition_size: int,
        state_size: int,
        heads: int = 16,
        waypoints: int = 12,
        hidden: int = 512,
        layers: int = 3,
        dropout: float = 0.0,
    ) -> None:
        super().__init__()
        self.output_shape = (heads, waypoints, state_size)
        #: Mean and standard deviation of the conditions trained on.
        self.register_buffer("mean", torch.zeros(condition_size))
        self.register_buffer("scale", torch.ones(condition_size))
        sizes = [condition_size] + [hidden] * layers
        blocks: list[nn.Module] = []
        for before, after in zip(sizes[:-1], sizes[1:], strict=True):
            blocks += [nn.Linear(before, after), nn.ReLU(), nn.Dropout(dropout)]
        self.layers = nn.Sequential(*blocks, nn.Linear(sizes[-1], heads * waypoints * state_size + heads))

    def forward(self, conditions: Tensor) -> Proposals:
        """Proposals under conditions (b, c)."""
        found = self.layers((conditions - self.mean) / self.scale)
        heads = self.output_shape[0]
        return Proposals(found[:, :-heads].reshape(-1, *self.output_shape), found[:, -heads:])
