"""Training of samplers: states on the paths of a dataset, and the loss (Algorithm 1, line 3)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.symmetries import random_symmetry, turned_grids, turned_points
from bsp_informed_planner.networks.cvae import Cvae
from bsp_informed_planner.networks.encoding import PlanarDistances, SceneEncoding, StateFrame
from bsp_informed_planner.networks.segment_frame import SegmentFrames, reflected
from bsp_informed_planner.sampling.path_shapes import resampled
from bsp_informed_planner.scene.encodings import FloatGrid
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.scene.signed_distance import SignedDistance

#: Points by which a path is resampled, and states that are kept of each path.
POINTS, STATES = 32, 64
#: Draws of a state that collides, before it loses its noise.
_TRIES = 10


def noisy_states(
    path: FloatArray,
    count: int,
    spread: float,
    rng: np.random.Generator,
    is_free: Callable[[FloatArray], NDArray[np.bool_]] | None,
) -> FloatArray:
    """States around a path: drawn evenly along it, with Gaussian noise; those that collide are drawn again.

    Args:
        path: (m, n) of straight edges.
        count: number of states.
        spread: standard deviation of the noise.
        rng: source of randomness.
        is_free: which of states (k, n) are free; None: all.

    Returns:
        (count, n). A state that collides at every try is one of the path itself.
    """
    points = resampled(path, POINTS)
    found = np.zeros((count, path.shape[1]))
    left = np.arange(count)
    for _ in range(_TRIES):
        place = rng.uniform(0.0, POINTS - 1.0, len(left))
        before = np.minimum(place.astype(np.int64), POINTS - 2)
        share = (place - before)[:, None]
        states = (1.0 - share) * points[before] + share * points[before + 1]
        noisy = states + rng.normal(0.0, spread, states.shape)
        free = np.ones(len(left), np.bool_) if is_free is None else is_free(noisy)
        found[left] = np.where(free[:, None], noisy, states)
        left = left[~free]
        if not len(left):
            break
    return found


class SceneSamplerExamples:
    """States on paths, under both ends of the path and the whole scene: as the paper and Ichter et al. train.

    Args:
        experience: solved problems.
        encoding: of their scenes.
        whole: paths of whole problems, for the baseline of shortest paths; else those of subproblems.
        spread: standard deviation of noise on the states, in unit coordinates.
        planar: whether states are points of the plane: then noise never takes them into obstacles, and the symmetries
            of the plane are used as augmentation.
        latent_size: of the network.
        seed: of the states that are kept.
    """

    def __init__(
        self,
        experience: Experience,
        encoding: SceneEncoding,
        whole: bool,
        spread: float,
        planar: bool,
        latent_size: int,
        seed: int,
    ) -> None:
        self._planar, self._latent_size = planar, latent_size
        scenes: list[FloatGrid] = []
        rows: list[int] = []
        ends: list[FloatArray] = []
        states: list[FloatArray] = []
        for number in range(len(experience)):
            rng = np.random.default_rng([seed, number])
            scene = experience.scene(number)
            frame = encoding.state_frame(scene)
            scenes.append(encoding.encode(scene))
            is_free = _outside(scene, encoding, frame) if planar else None
            for path in (experience.paths[number],) if whole else experience.subpaths[number]:
                unit = frame.to_unit(path)
                rows.append(number)
                ends.append(unit[[0, -1]])
                states.append(noisy_states(unit, STATES, spread, rng, is_free).astype(np.float32))
        self._scenes = np.array(scenes, dtype=np.float32)
        self._rows = np.array(rows, dtype=np.int64)
        self._ends = np.array(ends, dtype=np.float32).reshape(-1, 2, experience.dof)
        self._states = np.array(states, dtype=np.float32).reshape(-1, STATES, experience.dof)

    def __len__(self) -> int:
        return len(self._rows)

    def batch(self, indices: NDArray[np.int64], rng: np.random.Generator | None) -> dict[str, Tensor]:
        """states (b, n), conditions (b, 2 n + s): both ends and the scene; noise (b, latent_size)."""
        drawing = np.random.default_rng(int(indices[0])) if rng is None else rng
        states = self._states[indices, drawing.integers(STATES, size=len(indices))]
        ends = self._ends[indices]
        points = [torch.from_numpy(array) for array in (states, ends[:, 0], ends[:, 1])]
        scenes = torch.from_numpy(self._scenes[self._rows[indices]])
        if self._planar:
            symmetry = random_symmetry(rng)
            points = [turned_points(symmetry, array) for array in points]
            scenes = turned_grids(symmetry, scenes)
        noise = torch.from_numpy(drawing.normal(size=(len(indices), self._latent_size)).astype(np.float32))
        return {
            "states": points[0],
            "conditions": torch.cat((points[1], points[2], scenes.flatten(1)), dim=1),
            "noise": noise,
        }


class SegmentSamplerExamples:
    """States on paths of subproblems of a planar robot, in the frame of their keypoints; none of them in an obstacle.

    Args:
        experience: solved problems.
        encoding: gives the unit square and the section.
        spread: standard deviation of noise on the states, in edges of the grid.
        latent_size: of the network.
        seed: of the states that are kept.
    """

    def __init__(
        self, experience: Experience, encoding: PlanarDistances, spread: float, latent_size: int, seed: int
    ) -> None:
        self._latent_size = latent_size
        conditions: list[FloatGrid] = []
        states: list[FloatArray] = []
        for number in range(len(experience)):
            rng = np.random.default_rng([seed, number])
            scene = experience.scene(number)
            frame = encoding.state_frame(scene)
            is_free = _outside(scene, encoding, frame)
            subpaths = [frame.to_unit(path) for path in experience.subpaths[number]]
            frames = SegmentFrames.of(np.array([p[0] for p in subpaths]), np.array([p[-1] for p in subpaths]))
            conditions.append(frames.conditions(SignedDistance(scene, encoding.section_height), frame))
            for segment, path in enumerate(subpaths):
                drawn = noisy_states(path, STATES, spread, rng, is_free)
                states.append(frames.to_local(drawn, np.full(STATES, segment)).astype(np.float32))
        self._conditions = np.concatenate(conditions) if conditions else np.zeros((0, 1), np.float32)
        self._states = np.array(states, dtype=np.float32).reshape(-1, STATES, 2)

    def __len__(self) -> int:
        return len(self._conditions)

    def batch(self, indices: NDArray[np.int64], rng: np.random.Generator | None) -> dict[str, Tensor]:
        """states (b, 2), conditions (b, CONDITION_SIZE), noise (b, latent_size)."""
        drawing = np.random.default_rng(int(indices[0])) if rng is None else rng
        states = self._states[indices, drawing.integers(STATES, size=len(indices))]
        conditions = self._conditions[indices]
        if rng is not None and rng.random() < 0.5:
            states, conditions = states * np.array([1.0, -1.0], np.float32), reflected(conditions)
        noise = drawing.normal(size=(len(indices), self._latent_size)).astype(np.float32)
        arrays = {"states": states, "conditions": conditions, "noise": noise}
        return {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()}


def _outside(scene: Scene, encoding: SceneEncoding, frame: StateFrame) -> Callable[[FloatArray], NDArray[np.bool_]]:
    """Which points (k, 2) of the unit square lie outside of obstacles."""
    field = SignedDistance(scene, getattr(encoding, "section_height", 0.0))
    return lambda points: np.asarray(field.at(frame.to_metres(points)) > 0.0)


class SamplerObjective(nn.Module):
    """The negative evidence lower bound (paper, equation 3), its divergence weighted.

    Args:
        network: to train.
        divergence_weight: of the divergence from the prior; by default that of Ichter et al. (2018).
    """

    def __init__(self, network: Cvae, divergence_weight: float = 4e-4) -> None:
        super().__init__()
        self.network = network
        self.divergence_weight = divergence_weight

    def forward(self, batch: dict[str, Tensor]) -> dict[str, Tensor]:
        terms = self.network(batch["states"], batch["conditions"], batch["noise"])
        loss = terms.reconstruction + self.divergence_weight * terms.divergence
        return {
            "loss": loss,
            "reconstruction": terms.reconstruction.detach(),
            "divergence": terms.divergence.detach(),
        }
