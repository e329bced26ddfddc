"""Conditional variational autoencoders that draw states (Ichter, Harrison and Pavone, 2018; paper, Section III-C)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn


class CvaeLoss(NamedTuple):
    """Terms of the negative evidence lower bound, means over a batch.

    Attributes:
        reconstruction: half the squared error, summed over coordinates.
        divergence: of the encoder's distribution from the prior [nat].
    """

    reconstruction: Tensor
    divergence: Tensor


class Cvae(nn.Module):
    """Encoder q(z | x, condition) and decoder x(z, condition), each of fully connected ReLU layers; prior N(0, I).

    Defaults are those of the authors: two layers of 512 units each, and a latent vector of 3 for states of 6 numbers.

    Args:
        state_size: length n of a state.
        condition_size: length c of a condition: two keypoints (or start and goal) and the scene, flat.
        latent_size: length of z.
        hidden: units of each hidden layer.
        layers: number of hidden layers of encoder and decoder each.
    """

    def __init__(
        self, state_size: int, condition_size: int, latent_size: int = 3, hidden: int = 512, layers: int = 2
    ) -> None:
        super().__init__()
        self.state_size = state_size
        self.latent_size = latent_size
        self.encoder = _perceptron(state_size + condition_size, hidden, layers, 2 * latent_size)
        self.decoder = _perceptron(latent_size + condition_size, hidden, layers, state_size)

    def forward(self, states: Tensor, conditions: Tensor, noise: Tensor) -> CvaeLoss:
        """The loss on states (b, n) under conditions (b, c), given standard normal noise (b, latent_size)."""
        mean, log_variance = self.encoder(torch.cat((states, conditions), dim=1)).chunk(2, dim=1)
        latents = mean + torch.exp(0.5 * log_variance) * noise
        decoded = self.decode(latents, conditions)
        divergence = 0.5 * (mean**2 + log_variance.exp() - 1.0 - log_variance).sum(dim=1)
        return CvaeLoss(0.5 * ((decoded - states) ** 2).sum(dim=1).mean(), divergence.mean())

    def decode(self, latents: Tensor, conditions: Tensor) -> Tensor:
        """States (b, n) of latent vectors (b, latent_size) under conditions (b, c)."""
        return torch.as_tensor(self.decoder(torch.cat((latents, conditions), dim=1)))


def _perceptron(inputs: int, hidden: int, layers: int, outputs: int) -> nn.Sequential:
    sizes = [inputs] + [hidden] * layers
    blocks: list[nn.Module] = []
    for before, after in zip(sizes[:-1], sizes[1:], strict=True):
        blocks += [nn.Linear(before, after), nn.ReLU()]
    return nn.Sequential(*blocks, nn.Linear(sizes[-1], outputs))
