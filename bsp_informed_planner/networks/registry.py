"""Models on disk: NAME.safetensors, the weights, and NAME.json, the card."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import nn

from bsp_informed_planner.errors import BspPlannerError, ModelError
from bsp_informed_planner.networks.card import SHIPPED, ModelCard
from bsp_informed_planner.networks.cvae import Cvae
from bsp_informed_planner.networks.encoding import SceneEncoding, encoding_from_json
from bsp_informed_planner.networks.keypoint_heatmap import KeypointHeatmap
from bsp_informed_planner.networks.keypoint_regression import KeypointRegression
from bsp_informed_planner.networks.path_chains import PathChains
from bsp_informed_planner.networks.runtime import limit_threads
from bsp_informed_planner.whole_files import write_whole

#: Classes of networks by the kind in their cards; architectures are their arguments.
KINDS: dict[str, type[nn.Module]] = {
    "sequential_regression": KeypointRegression,
    "heatmap": KeypointHeatmap,
    "segment_cvae": Cvae,
    "cvae": Cvae,
    "cvae_shortest_path": Cvae,
    "path_chains": PathChains,
}


@dataclass(frozen=True, eq=False)
class Model:
    """A network that is ready to be used.

    Attributes:
        network: in evaluation mode, on the CPU.
        card: of it.
        encoding: of the scenes that it takes.
    """

    network: nn.Module
    card: ModelCard
    encoding: SceneEncoding


def build_network(card: ModelCard) -> nn.Module:
    """The network of a card, its weights random.

    Raises:
        ModelError: if the kind or the architecture does not exist.
    """
    if card.kind not in KINDS:
        raise ModelError(card.name, f"a model of kind '{card.kind}' (known: {', '.join(KINDS)})")
    arguments = {k: tuple(v) if isinstance(v, list) else v for k, v in card.architecture.items()}
    try:
        return KINDS[card.kind](**arguments)
    except TypeError as error:
        raise ModelError(card.name, f"not the architecture of a '{card.kind}': {error}") from error


def save_model(network: nn.Module, card: ModelCard, folder: Path) -> Path:
    """Write weights, rounded to half precision, and card of a model; the number of its parameters is filled in.

    Returns:
        the file of the weights.

    Raises:
        ModelError: if a file cannot be written.
    """
    path = folder / f"{card.name}.safetensors"
    weights = {name: tensor.detach().cpu().half().contiguous() for name, tensor in network.state_dict().items()}
    try:
        write_whole(path, save(weights))
    except (OSError, SafetensorError) as error:
        raise ModelError(str(path), f"cannot be written: {error}") from error
    count = sum(parameter.numel() for parameter in network.parameters())
    replace(card, parameters=count).write(path.with_suffix(".json"))
    return path


def load_model(path: str | Path) -> Model:
    """A model from its files.

    Args:
        path: of the weights, NAME.safetensors, or of the card; or the NAME of a model that comes with the package.

    Raises:
        ModelError: if a file is missing or damaged, or the weights do not fit the card.
    """
    limit_threads()
    path = Path(path)
    if not path.suffix and not path.with_suffix(".json").exists():
        path = SHIPPED / path
    card = ModelCard.read(path.with_suffix(".json"))
    weights_path = path.with_suffix(".safetensors")
    network = build_network(card)
    try:
        network.load_state_dict(load_file(weights_path))
        encoding = encoding_from_json(card.encoding)
    except (OSError, SafetensorError) as error:
        raise ModelError(str(weights_path), f"cannot be read: {error}") from error
    except (RuntimeError, BspPlannerError) as error:
        raise ModelError(str(weights_path), f"does not fit its card: {error}") from error
    if not all(torch.isfinite(parameter).all() for parameter in network.parameters()):
        raise ModelError(str(weights_path), "a weight is not finite")
    network.requires_grad_(False)
    return Model(network.eval(), card, encoding)


def shipped_models() -> tuple[str, ...]:
    """Names of the models that come with the package."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.safetensors")))
