"""Sequential estimation of keypoints by networks (Algorithm 3, lines 1 to 7)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from bsp_informed_planner.errors import InvalidOptionError, ModelMismatchError
from bsp_informed_planner.networks.encoding import StateFrame
from bsp_informed_planner.networks.keypoint_heatmap import KeypointHeatmap
from bsp_informed_planner.networks.keypoint_regression import KeypointRegression
from bsp_informed_planner.networks.registry import Model
from bsp_informed_planner.scene.encodings import FloatGrid
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene


@dataclass(frozen=True)
class EstimationOptions:
    """How chains are estimated.

    Attributes:
        delta: a keypoint closer to the target than this ends the chain, in unit coordinates.
        max_keypoints: chains that are not at the target after so many keypoints are given up.
        temperature: of sampling: 1 draws from the network's distribution, less is more careful.
    """

    delta: float = 0.05
    max_keypoints: int = 20
    temperature: float = 1.0

    def __post_init__(self) -> None:
        for name in ("delta", "temperature"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InvalidOptionError(name, getattr(self, name), "a positive number")
        if self.max_keypoints < 1:
            raise InvalidOptionError("max_keypoints", self.max_keypoints, "at least 1")


@dataclass(frozen=True, eq=False)
class EstimatedChain:
    """A chain that a network has estimated; nothing of it has been checked.

    Attributes:
        configurations: (m, n) start, keypoints, and the target if it was reached [rad or m].
        reached: whether it ends at the target.
    """

    configurations: FloatArray
    reached: bool

    @property
    def length(self) -> float:
        """Joint-space length [rad or m]."""
        return float(np.linalg.norm(np.diff(self.configurations, axis=0), axis=1).sum())


@dataclass(frozen=True, eq=False)
class SceneView:
    """A scene as a model sees it; made once for all problems in it.

    Attributes:
        values: the encoding.
        frame: coordinates of states beside it.
    """

    values: FloatGrid
    frame: StateFrame

    @staticmethod
    def of(scene: Scene, model: Model) -> SceneView:
        """Encode a scene."""
        return SceneView(model.encoding.encode(scene), model.encoding.state_frame(scene))


class KeypointEstimator(Protocol):
    """Estimates chains of keypoints from start to target."""

    def chains(
        self, view: SceneView, start: FloatArray, target: FloatArray, count: int, rng: np.random.Generator
    ) -> list[EstimatedChain]:
        """Up to `count` chains, the most probable one first; estimators without randomness give one.

        Args:
            view: of the scene, by the estimator's model.
            start, target: (n,) [rad or m].
            count: at least 1.
            rng: for all chains but the first.
        """
        ...


def sequential_chains(
    next_keypoints: Callable[[FloatArray, NDArray[np.int64]], FloatArray],
    start: FloatArray,
    target: FloatArray,
    count: int,
    options: EstimationOptions,
) -> list[tuple[FloatArray, bool]]:
    """The loop of Algorithm 3, for several chains at once.

    Args:
        next_keypoints: the next keypoints of current ones, (k, n) each, in unit coordinates, of some chains, whose
            numbers (k,) it is told.
        start, target: (n,) in unit coordinates.
        count: of chains.
        options: when a chain ends.

    Returns:
        for each chain its keypoints (m, n) with start, and with the target in place of the keypoint that came within
        delta of it; and whether that happened.
    """
    currents = np.repeat(start[None], count, axis=0)
    history = [currents]
    ends = np.full(count, -1)
    if np.linalg.norm(target - start) < options.delta:
        return [(np.stack((start, target)), True)] * count
    for step in range(1, options.max_keypoints + 1):
        going = np.flatnonzero(ends < 0)
        if not len(going):
            break
        reached = next_keypoints(currents[going], going)
        arrived = np.linalg.norm(reached - target, axis=1) < options.delta
        ends[going[arrived]] = step
        currents = np.broadcast_to(target, currents.shape).copy()
        currents[going[~arrived]] = reached[~arrived]
        history.append(currents)
    points = np.stack(history, axis=1)
    return [(points[k, : ends[k] + 1] if ends[k] >= 0 else points[k], bool(ends[k] >= 0)) for k in range(count)]


class HeatmapEstimator:
    """Draws chains from the distribution of a heatmap network; the first one takes the likeliest keypoint each time.

    Args:
        model: of kind "heatmap".
        options: see there.

    Raises:
        ModelMismatchError: if the model is of another kind.
    """

    def __init__(self, model: Model, options: EstimationOptions | None = None) -> None:
        if not isinstance(model.network, KeypointHeatmap):
            raise ModelMismatchError(model.card.name, "kind of model", model.card.kind, "heatmap")
        self._network = model.network
        self._options = options or EstimationOptions()

    def chains(
        self, view: SceneView, start: FloatArray, target: FloatArray, count: int, rng: np.random.Generator
    ) -> list[EstimatedChain]:
        """See `KeypointEstimator`."""
        network, options = self._network, self._options
        unit_start, unit_target = view.frame.to_unit(start), view.frame.to_unit(target)
        with torch.inference_mode():
            fields = network(torch.from_numpy(view.values)[None], _tensor(unit_target)[None])
            places = network.keypoints(fields)[0].double().numpy()

            def next_keypoints(currents: FloatArray, numbers: NDArray[np.int64]) -> FloatArray:
                logits = network.logits(fields, _tensor(currents)[None])[0].double().numpy()
                # A keypoint where one is already makes no progress.
                along, across = (places[:, axis] - currents[:, axis, None] for axis in (0, 1))
                logits[along**2 + across**2 < network.cells**-2.0] = -np.inf
                drawn = _drawn(logits / options.temperature, rng)
                return np.asarray(places[np.where(numbers == 0, logits.argmax(axis=1), drawn)])

            found = sequential_chains(next_keypoints, unit_start, unit_target, count, options)
        return [_chain(view.frame, points, start, target, reached) for points, reached in found]


class RegressionEstimator:
    """Chains of a regression network, as in the paper: one only.

    Args:
        model: of kind "sequential_regression".
        options: see there.

    Raises:
        ModelMismatchError: if the model is of another kind.
    """

    def __init__(self, model: Model, options: EstimationOptions | None = None) -> None:
        if not isinstance(model.network, KeypointRegression):
            raise ModelMismatchError(model.card.name, "kind of model", model.card.kind, "sequential_regression")
        self._network = model.network
        self._options = options or EstimationOptions()

    def chains(
        self,
        view: SceneView,
        start: FloatArray,
        target: FloatArray,
        count: int,
        rng: np.random.Generator,
    ) -> list[EstimatedChain]:
        """See `KeypointEstimator`."""
        unit_start, unit_target = view.frame.to_unit(start), view.frame.to_unit(target)
        scene, goal = torch.from_numpy(view.values.ravel())[None], _tensor(unit_target)[None]

        def next_keypoints(currents: FloatArray, numbers: NDArray[np.int64]) -> FloatArray:
            return np.asarray(self._network(scene, _tensor(currents), goal).double().numpy())

        with torch.inference_mode():
            found = sequential_chains(next_keypoints, unit_start, unit_target, 1, self._options)
        return [_chain(view.frame, points, start, target, reached) for points, reached in found]


_ESTIMATORS: dict[str, type[HeatmapEstimator] | type[RegressionEstimator]] = {
    "heatmap": HeatmapEstimator,
    "sequential_regression": RegressionEstimator,
}


def estimator_of(model: Model, options: EstimationOptions | None = None) -> KeypointEstimator:
    """The estimator of a keypoint model.

    Raises:
        ModelMismatchError: if the model estimates no keypoints.
    """
    if model.card.kind not in _ESTIMATORS:
        raise ModelMismatchError(model.card.name, "kind of model", model.card.kind, " or ".join(_ESTIMATORS))
    return _ESTIMATORS[model.card.kind](model, options)


def _drawn(logits: FloatArray, rng: np.random.Generator) -> NDArray[np.int64]:
    """(k,) an index for each row of (k, c), with the probabilities of its softmax."""
    cumulated = np.exp(logits - logits.max(axis=1, keepdims=True)).cumsum(axis=1)
    return np.asarray((cumulated <= rng.random((len(logits), 1)) * cumulated[:, -1:]).sum(axis=1))


def _tensor(array: FloatArray) -> torch.Tensor:
    return torch.from_numpy(np.asarray(array, dtype=np.float32))


def _chain(
    frame: StateFrame, points: FloatArray, start: FloatArray, target: FloatArray, reached: bool
) -> EstimatedChain:
    """A chain in metres whose ends are exactly the given ones."""
    configurations = frame.to_metres(points)
    configurations[0] = start
    if reached:
        configurations[-1] = target
    return EstimatedChain(configurations, reached)
