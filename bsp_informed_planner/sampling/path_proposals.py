"""Runs the network `networks.path_chains` without torch: a few products of matrices."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file

from bsp_informed_planner.errors import ModelError
from bsp_informed_planner.networks.card import ModelCard
from bsp_informed_planner.sampling.network_kernels import dense
from bsp_informed_planner.scene.encodings import FloatGrid
from bsp_informed_planner.scene.pose import FloatArray

#: Name of the kind in cards.
KIND = "path_chains"


@dataclass(frozen=True, eq=False)
class PathProposals:
    """The network of a card, ready to be used.

    Attributes:
        card: of it.
        weights: of each layer but the last, (inputs, outputs) and (outputs,).
        heads: the last layer of each head, (heads, inputs, waypoints * n) and (heads, waypoints * n).
        gate: that of their logits, (inputs, heads) and (heads,).
        mean, scale: (c,) of conditions.
    """

    card: ModelCard
    weights: tuple[tuple[FloatGrid, FloatGrid], ...]
    heads: tuple[FloatGrid, FloatGrid]
    gate: tuple[FloatGrid, FloatGrid]
    mean: FloatGrid
    scale: FloatGrid

    @staticmethod
    def load(path: Path) -> PathProposals:
        """A model of the kind "path_chains".

        Args:
            path: of the card or of the weights.

        Raises:
            ModelError: if a file is missing or damaged, or they do not fit together.
        """
        card = ModelCard.read(path.with_suffix(".json"))
        file = path.with_suffix(".safetensors")
        try:
            arrays = {name: array.astype(np.float32) for name, array in load_file(file).items()}
        except (OSError, SafetensorError) as error:
            raise ModelError(str(file), f"cannot be read: {error}") from error
        names = sorted((name for name in arrays if name.endswith(".weight")), key=lambda name: int(name.split(".")[1]))
        try:
            weights = tuple(
                (np.ascontiguousarray(arrays[name].T), arrays[name.replace("weight", "bias")]) for name in names
            )
            mean, scale = arrays["mean"], arrays["scale"]
            heads, waypoints, state = (card.architecture[key] for key in ("heads", "waypoints", "state_size"))
        except KeyError as error:
            raise ModelError(str(file), f"does not fit its card: it has no {error}") from error
        inputs = [len(mean), *(bias.shape[0] for _, bias in weights)]
        fits = bool(weights) and [weight.shape[0] for weight, _ in weights] == inputs[:-1]
        if not fits or inputs[-1] != heads * waypoints * state + heads or card.robot.dof != state:
            raise ModelError(str(file), "does not fit its card: layers of other sizes")
        if not all(np.isfinite(array).all() for array in arrays.values()):
            raise ModelError(str(file), "a weight is not finite")
        (last, bias), size = weights[-1], waypoints * state
        own = last[:, :-heads].reshape(-1, heads, size).swapaxes(0, 1), bias[:-heads].reshape(heads, size)
        gate = np.ascontiguousarray(last[:, -heads:]), bias[-heads:]
        return PathProposals(card, weights[:-1], (np.ascontiguousarray(own[0]), own[1]), gate, mean, scale)

    def propose(self, conditions: FloatGrid, count: int) -> tuple[FloatArray, FloatGrid]:
        """The likeliest of the network's `Proposals` under each of some conditions.

        Args:
            conditions: (b, c).
            count: how many are wanted; of no more heads the last layer is looked at, which is most of the weights.

        Returns:
            shapes (b, k, waypoints, n) and logits (b, k), the highest first; k <= count.
        """
        # Not by BLAS: its threads wait for each other, which takes several times as long on a machine that is busy.
        values: FloatGrid = np.ascontiguousarray((conditions - self.mean) / self.scale, dtype=np.float32)
        for weight, bias in self.weights:
            values = dense(values, weight, bias)
            np.maximum(values, 0.0, out=values)
        logits = dense(values, *self.gate)
        best = np.argsort(-logits, axis=1, kind="stable")[:, :count]
        weights, biases = self.heads
        shapes = np.empty((*best.shape, biases.shape[1]), dtype=np.float32)
        for row, heads in enumerate(best.tolist()):
            for place, head in enumerate(heads):
                shapes[row, place] = dense(values[row : row + 1], weights[head], biases[head])[0]
        waypoints, state = (self.card.architecture[key] for key in ("waypoints", "state_size"))
        return shapes.reshape(*best.shape, waypoints, state).astype(np.float64), np.take_along_axis(logits, best, 1)
