"""Runs the network `networks.path_chains` without torch: a few products of matrices."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file

from bsp_informed_planner.errors import ModelError
from bsp_informed_planner.networks.card import ModelCard
from bsp_informed_planner.scene.encodings import FloatGrid
from bsp_informed_planner.scene.pose import FloatArray

#: Name of the kind in cards.
KIND = "path_chains"


@dataclass(frozen=True, eq=False)
class PathProposals:
    """The network of a card, ready to be used.

    Attributes:
        card: of it.
        weights: of each layer, (inputs, outputs) and (outputs,).
        mean, scale: (c,) of conditions.
    """

    card: ModelCard
    weights: tuple[tuple[FloatGrid, FloatGrid], ...]
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
        return PathProposals(card, weights, mean, scale)

    def propose(self, conditions: FloatGrid) -> tuple[FloatArray, FloatGrid]:
        """Shapes (b, heads, waypoints, n) and logits (b, heads) under conditions (b, c), see `Proposals`."""
        values: FloatGrid = (conditions - self.mean) / self.scale
        for weight, bias in self.weights[:-1]:
            values = np.maximum(values @ weight + bias, 0.0)
        weight, bias = self.weights[-1]
        values = values @ weight + bias
        heads, waypoints, state = (self.card.architecture[key] for key in ("heads", "waypoints", "state_size"))
        shapes = values[:, :-heads].reshape(-1, heads, waypoints, state).astype(np.float64)
        return shapes, np.asarray(values[:, -heads:], dtype=np.float32)
