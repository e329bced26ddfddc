"""The paper's keypoint network: regression of the next keypoint (Section IV-A, Algorithm 1, line 2)."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class KeypointRegression(nn.Module):
    """Estimates the next keypoint from scene, current keypoint and target, by a multilayer perceptron.

    As in the paper, "we enforce the initial and target states in the data as the size of them becomes equal to the size
    of environment information": both states are repeated until they are as long as the scene's encoding, so that the
    input is three vectors of one size. The paper says nothing of the layers.

    Args:
        scene_size: length s of the flat encoding of a scene.
        state_size: length n of a state.
        hidden: units of each hidden layer.
        layers: number of hidden layers.
    """

    def __init__(self, scene_size: int, state_size: int, hidden: int = 256, layers: int = 3) -> None:
        super().__init__()
        self.scene_size = scene_size
        self.state_size = state_size
        sizes = [3 * scene_size] + [hidden] * layers
        blocks: list[nn.Module] = []
        for before, after in zip(sizes[:-1], sizes[1:], strict=True):
            blocks += [nn.Linear(before, after), nn.ReLU()]
        self.layers = nn.Sequential(*blocks, nn.Linear(sizes[-1], state_size))

    def forward(self, scenes: Tensor, currents: Tensor, targets: Tensor) -> Tensor:
        """The next keypoints (b, n).

        Args:
            scenes: (b, s); currents, targets: (b, n), in the unit coordinates of the model.
        """
        inputs = torch.cat((scenes, self.tiled(currents), self.tiled(targets)), dim=1)
        return torch.as_tensor(self.layers(inputs))

    def tiled(self, states: Tensor) -> Tensor:
        """States (b, n), repeated up to the size of the scene: (b, s)."""
        repeats = -(-self.scene_size // self.state_size)
        return states.repeat(1, repeats)[:, : self.scene_size]
