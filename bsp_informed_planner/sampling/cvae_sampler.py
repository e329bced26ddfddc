"""Samplers made of conditional variational autoencoders."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from bsp_informed_planner.errors import ModelMismatchError
from bsp_informed_planner.networks.cvae import Cvae
from bsp_informed_planner.networks.encoding import PlanarDistances
from bsp_informed_planner.networks.registry import Model
from bsp_informed_planner.networks.segment_frame import SegmentFrames
from bsp_informed_planner.sampling.keypoint_estimation import SceneView
from bsp_informed_planner.scene.encodings import FloatGrid, GridFrame
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.scene.signed_distance import SignedDistance

#: States of the network (k, n), of the local samplers (k,), as configurations.
ToConfigurations = Callable[[FloatArray, NDArray[np.int64]], FloatArray]


class CvaeMixture:
    """The weighted mixture of local samplers that one network is under several conditions (Algorithm 3, line 11).

    All samples of a call are decoded in one pass.

    Args:
        network: draws states.
        conditions: (s, c) one row a local sampler.
        weights: (s,) w_i, not negative, of a positive sum.
        to_configurations: from the coordinates of the network.
        lower, upper: (n,) joint limits, to which samples are clipped.
    """

    def __init__(
        self,
        network: Cvae,
        conditions: FloatGrid,
        weights: FloatArray,
        to_configurations: ToConfigurations,
        lower: FloatArray,
        upper: FloatArray,
    ) -> None:
        self._network = network
        self._conditions = torch.from_numpy(np.ascontiguousarray(conditions))
        self._weights = weights / weights.sum()
        self._to_configurations = to_configurations
        self._lower, self._upper = lower, upper

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """See `Sampler`."""
        members = np.repeat(np.arange(len(self._weights)), rng.multinomial(count, self._weights))
        latents = torch.from_numpy(rng.normal(size=(count, self._network.latent_size)).astype(np.float32))
        with torch.inference_mode():
            decoded = self._network.decode(latents, self._conditions[torch.from_numpy(members)]).double().numpy()
        samples = np.clip(self._to_configurations(decoded, members), self._lower, self._upper)
        rng.shuffle(samples)
        return np.asarray(samples)


def cvae_sampler(
    model: Model,
    scene: Scene,
    view: SceneView | None,
    pairs: Sequence[tuple[FloatArray, FloatArray]],
    lower: FloatArray,
    upper: FloatArray,
) -> CvaeMixture:
    """The mixture of local samplers between pairs of configurations, each weighted by their distance.

    Args:
        model: "segment_cvae", "cvae" or "cvae_shortest_path".
        scene: in which to sample.
        view: of it by this model; None: made if it is needed.
        pairs: (n,) and (n,): neighbouring keypoints, or start and goal for "cvae_shortest_path".
        lower, upper: (n,) joint limits.

    Raises:
        ModelMismatchError: if the model is of another kind.
    """
    network = model.network
    if not isinstance(network, Cvae):
        raise ModelMismatchError(model.card.name, "kind of model", model.card.kind, "a cvae")
    starts, ends = np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])
    # A pair of length zero still has a sampler.
    weights = np.linalg.norm(ends - starts, axis=1) + 1e-6
    if model.card.kind == "segment_cvae":
        if not isinstance(model.encoding, PlanarDistances):
            raise ModelMismatchError(model.card.name, "encoding", model.encoding.kind, PlanarDistances.kind)
        frame = GridFrame.of(scene)
        frames = SegmentFrames.of(frame.to_unit(starts), frame.to_unit(ends))
        conditions = frames.conditions(SignedDistance(scene, model.encoding.section_height), frame)
        return CvaeMixture(
            network,
            conditions,
            weights,
            lambda states, members: frame.to_metres(frames.to_unit(states, members)),
            lower,
            upper,
        )
    view = view or SceneView.of(scene, model)
    both = np.concatenate((view.frame.to_unit(starts), view.frame.to_unit(ends)), axis=1).astype(np.float32)
    flat = np.broadcast_to(view.values.ravel(), (len(pairs), view.values.size))
    frame_of_view = view.frame
    return CvaeMixture(
        network,
        np.concatenate((both, flat), axis=1),
        weights,
        lambda states, members: frame_of_view.to_metres(states),
        lower,
        upper,
    )
