"""The default keypoint network of planar robots: a distribution over the next keypoint, on a grid.

The scene and the target go through a U-Net once. For each cell of the grid it gives a key, a query, where within the
cell a keypoint would lie, and the cost to go from there. The distribution over the next keypoint from anywhere is a
softmax of the products of the query there with the keys of all cells. So a whole chain, or many, take one pass of the
network, and in training one pass learns from many current keypoints at once; a target is the keypoint that the exact
chain from there has next.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

#: Lengths over which distances count, in edges of the grid: of the sharp, the soft and the wide map of the scene.
_SHARP, _SOFT, _WIDE = 0.008, 0.03, 0.15
#: Width of the bump at the target, in edges of the grid.
_BUMP = 0.03


class HeatmapFields(NamedTuple):
    """What one pass of the network gives, for a batch of b problems and c x c cells.

    Attributes:
        fine: (b, f, c, c) and coarse: (b, g, c / 2, c / 2) features.
        keys: (b, d, c * c).
        offsets: (b, 2, c * c) of keypoints from the centres of their cells, in cells, within +-0.75.
        costs: (b, c * c) cost to go, in edges of the grid.
    """

    fine: Tensor
    coarse: Tensor
    keys: Tensor
    offsets: Tensor
    costs: Tensor


class KeypointHeatmap(nn.Module):
    """See the module. All coordinates are those of the unit square of the grid.

    Args:
        cells: c, along each edge of the grid; a multiple of 4. The encoding of the scene has twice as many.
        channels: of the U-Net at c, c / 2 and c / 4 cells; multiples of 8.
        embedding: length d of keys and queries.
        attention: number of self-attention layers at c / 4 cells, each followed by a convolution block.
    """

    #: Offsets reach so far, so that a keypoint on the border of two cells can be put into either.
    REACH = 0.75

    def __init__(
        self, cells: int = 32, channels: tuple[int, int, int] = (32, 64, 96), embedding: int = 64, attention: int = 2
    ) -> None:
        super().__init__()
        first, second, third = channels
        self.cells = cells
        self.embedding = embedding
        # Three maps of the scene, each of 2 x 2 values a cell; target: relative position (2), distance, bump.
        self.stem = nn.Conv2d(3 * 4 + 4, first, 3, padding=1)
        self.down_fine = _Residual(first, first)
        self.down_middle = _Residual(first, second)
        self.down_coarse = _Residual(second, third)
        self.positions = nn.Parameter(0.02 * torch.randn(1, (cells // 4) ** 2, third))
        self.attention = nn.ModuleList(_Attention(third) for _ in range(attention))
        self.blocks = nn.ModuleList(_Residual(third, third) for _ in range(attention))
        self.up_middle = _Up(third, second, second)
        self.up_fine = _Up(second, first, first)
        self.keys = nn.Conv2d(first, embedding, 1)
        self.query = nn.Sequential(nn.Linear(first + second + 2, 128), nn.SiLU(), nn.Linear(128, embedding))
        self.offset = nn.Conv2d(first, 2, 1)
        self.cost = nn.Conv2d(first, 1, 1)
        along = (torch.arange(cells) + 0.5) / cells
        self.register_buffer("centres", torch.stack(torch.meshgrid(along, along, indexing="ij")), persistent=False)
        self.centres: Tensor
        # The layout in which convolutions of few channels are fast.
        for parameter in self.parameters():
            if parameter.ndim == 4:
                parameter.data = parameter.data.contiguous(memory_format=torch.channels_last)

    def forward(self, distances: Tensor, targets: Tensor) -> HeatmapFields:
        """The fields of problems.

        Args:
            distances: (b, 2 c, 2 c) signed distances, in edges of the grid.
            targets: (b, 2).
        """
        maps = (torch.tanh(distances / _SOFT), torch.sigmoid(distances / _SHARP), (distances / _WIDE).clamp(-1.0, 1.0))
        scene = functional.pixel_unshuffle(torch.stack(maps, dim=1), 2)
        relative = self.centres[None] - targets[:, :, None, None]
        distance = relative.norm(dim=1, keepdim=True)
        inputs = torch.cat((scene, relative, distance, torch.exp(-((distance / _BUMP) ** 2))), dim=1)
        fine = self.down_fine(self.stem(inputs.contiguous(memory_format=torch.channels_last)))
        middle = self.down_middle(functional.max_pool2d(fine, 2))
        coarse = self.down_coarse(functional.max_pool2d(middle, 2))
        for attention, block in zip(self.attention, self.blocks, strict=True):
            tokens = attention(coarse.flatten(2).transpose(1, 2) + self.positions)
            coarse = block(tokens.transpose(1, 2).reshape(coarse.shape))
        middle = self.up_middle(coarse, middle)
        fine = self.up_fine(middle, fine)
        return HeatmapFields(
            fine,
            middle,
            self.keys(fine).flatten(2),
            self.REACH * torch.tanh(self.offset(fine)).flatten(2),
            self.cost(fine).flatten(1),
        )

    def logits(self, fields: HeatmapFields, currents: Tensor) -> Tensor:
        """Unnormalised log-probabilities (b, m, c * c) of the cell of the next keypoint.

        Args:
            fields: of b problems.
            currents: (b, m, 2) current keypoints.
        """
        # grid_sample wants the last axis of the image first.
        places = (2.0 * currents - 1.0).flip(-1)[:, :, None]
        features = [
            functional.grid_sample(image, places, align_corners=False, padding_mode="border")[..., 0].transpose(1, 2)
            for image in (fields.fine, fields.coarse)
        ]
        within = (self.cells * currents) % 1.0
        queries = self.query(torch.cat((*features, within), dim=2)) * self.embedding**-0.5
        return queries @ fields.keys

    def keypoints(self, fields: HeatmapFields) -> Tensor:
        """Where a keypoint in each cell would lie: (b, c * c, 2)."""
        return (self.centres.flatten(1) + fields.offsets / self.cells).transpose(1, 2)

    def cells_of(self, points: Tensor) -> Tensor:
        """The index (...) of the cell that holds each point (..., 2); those outside belong to the border."""
        index = (points * self.cells).floor().long().clamp(0, self.cells - 1)
        return index[..., 0] * self.cells + index[..., 1]


class _Residual(nn.Module):
    """Two 3 x 3 convolutions with group normalisation, around which the input goes too."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(inputs, outputs, 3, padding=1)
        self.first_norm = nn.GroupNorm(8, outputs)
        self.second = nn.Conv2d(outputs, outputs, 3, padding=1)
        self.second_norm = nn.GroupNorm(8, outputs)
        self.skip = nn.Conv2d(inputs, outputs, 1) if inputs != outputs else nn.Identity()

    def forward(self, image: Tensor) -> Tensor:
        hidden = functional.silu(self.first_norm(self.first(image)))
        return functional.silu(self.second_norm(self.second(hidden)) + self.skip(image))


class _Up(nn.Module):
    """The coarser image, enlarged, joined with the finer one."""

    def __init__(self, coarse: int, fine: int, outputs: int) -> None:
        super().__init__()
        self.reduce = nn.Conv2d(coarse, fine, 1)
        self.block = _Residual(2 * fine, outputs)

    def forward(self, coarse: Tensor, fine: Tensor) -> Tensor:
        enlarged = functional.interpolate(self.reduce(coarse), scale_factor=2)
        return torch.as_tensor(self.block(torch.cat((enlarged, fine), dim=1)))


class _Attention(nn.Module):
    """A transformer layer with normalisation first: what joins places far from each other."""

    def __init__(self, width: int, heads: int = 4) -> None:
        super().__init__()
        self.heads = heads
        self.first_norm = nn.LayerNorm(width)
        self.projection = nn.Linear(width, 3 * width)
        self.output = nn.Linear(width, width)
        self.second_norm = nn.LayerNorm(width)
        self.mlp = nn.Sequential(nn.Linear(width, 2 * width), nn.SiLU(), nn.Linear(2 * width, width))

    def forward(self, tokens: Tensor) -> Tensor:
        batch, count, width = tokens.shape
        projected = self.projection(self.first_norm(tokens)).view(batch, count, 3, self.heads, width // self.heads)
        query, key, value = projected.permute(2, 0, 3, 1, 4)
        attended = functional.scaled_dot_product_attention(query, key, value)
        tokens = tokens + self.output(attended.transpose(1, 2).reshape(batch, count, width))
        return torch.as_tensor(tokens + self.mlp(self.second_norm(tokens)))
