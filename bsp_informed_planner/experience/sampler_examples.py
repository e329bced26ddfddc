"""Training of samplers: states on the paths of a dataset, and the loss (Algorithm 1, line 3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.symmetries import random_symmetry, turned_grids, turned_points
from bsp_informed_planner.networks.cvae import Cvae
from bsp_informed_planner.networks.encoding import PlanarDistances, SceneEncoding
from bsp_informed_planner.networks.segment_frame import SegmentFrames, reflected
from bsp_informed_planner.scene.encodings import FloatGrid
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.signed_distance import SignedDistance

#: Points that are kept of each path.
POINTS = 32


def resampled(path: FloatArray, count: int = POINTS) -> FloatArray:
    """(count, n) points of a path (m, n), evenly spaced along it."""
    lengths = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    places = np.linspace(0.0, lengths[-1], count)
    return np.stack([np.interp(places, lengths, path[:, k]) for k in range(path.shape[1])], axis=1)


class _States:
    """States on paths: drawn evenly along them, with noise.

    Args:
        paths: each (POINTS, n), in the coordinates of the network.
        spread: standard deviation of the noise of each path, in the same coordinates.
    """

    def __init__(self, paths: Sequence[FloatArray], dof: int, spread: Sequence[float]) -> None:
        self.paths = np.array(paths, dtype=np.float32).reshape(-1, POINTS, dof)
        self._spread = np.array(spread, dtype=np.float32)

    def draw(self, indices: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.float32]:
        """One state (n,) of each path."""
        place = rng.uniform(0.0, POINTS - 1.0, len(indices))
        before = np.minimum(place.astype(np.int64), POINTS - 2)
        share = (place - before).astype(np.float32)[:, None]
        states = (1.0 - share) * self.paths[indices, before] + share * self.paths[indices, before + 1]
        noise = rng.normal(size=states.shape).astype(np.float32)
        return states + self._spread[indices, None] * noise


class SceneSamplerExamples:
    """States on paths, under both ends of the path and the whole scene: as the paper and Ichter et al. train.

    Args:
        experience: solved problems.
        encoding: of their scenes.
        whole: paths of whole problems, for the baseline of shortest paths; else those of subproblems.
        spread: standard deviation of noise on the states, in unit coordinates.
        planar: whether states are points of the plane, whose symmetries are used as augmentation.
        latent_size: of the network.
    """

    def __init__(
        self,
        experience: Experience,
        encoding: SceneEncoding,
        whole: bool,
        spread: float,
        planar: bool,
        latent_size: int,
    ) -> None:
        self._planar, self._latent_size = planar, latent_size
        scenes, rows, paths = [], [], []
        for number in range(len(experience)):
            scene = experience.scene(number)
            frame = encoding.state_frame(scene)
            scenes.append(encoding.encode(scene))
            for path in (experience.paths[number],) if whole else experience.subpaths[number]:
                rows.append(number)
                paths.append(frame.to_unit(resampled(path)))
        self._scenes = np.array(scenes, dtype=np.float32)
        self._rows = np.array(rows, dtype=np.int64)
        self._states = _States(paths, experience.dof, [spread] * len(paths))

    def __len__(self) -> int:
        return len(self._rows)

    def batch(self, indices: NDArray[np.int64], rng: np.random.Generator | None) -> dict[str, Tensor]:
        """states (b, n), conditions (b, 2 n + s): both ends and the scene; noise (b, latent_size)."""
        drawing = np.random.default_rng(int(indices[0])) if rng is None else rng
        paths = self._states.paths[indices]
        points = [torch.from_numpy(array) for array in (self._states.draw(indices, drawing), paths[:, 0], paths[:, -1])]
        scenes = torch.from_numpy(self._scenes[self._rows[indices]])
        if self._planar:
            symmetry = random_symmetry(rng)
            points = [turned_points(symmetry, array) for array in points]
            scenes = turned_grids(symmetry, scenes)
        states, starts, ends = points
        noise = torch.from_numpy(drawing.normal(size=(len(indices), self._latent_size)).astype(np.float32))
        return {
            "states": states,
            "conditions": torch.cat((starts, ends, scenes.flatten(1)), dim=1),
            "noise": noise,
        }


class SegmentSamplerExamples:
    """States on paths of subproblems of a planar robot, in the frame of their keypoints.

    Args:
        experience: solved problems.
        encoding: gives the unit square and the section.
        spread: standard deviation of noise on the states, in edges of the grid.
        latent_size: of the network.
    """

    def __init__(self, experience: Experience, encoding: PlanarDistances, spread: float, latent_size: int) -> None:
        self._latent_size = latent_size
        conditions: list[FloatGrid] = []
        paths: list[FloatArray] = []
        spreads: list[float] = []
        for number in range(len(experience)):
            scene = experience.scene(number)
            frame = encoding.state_frame(scene)
            subpaths = [frame.to_unit(resampled(path)) for path in experience.subpaths[number]]
            frames = SegmentFrames.of(np.array([p[0] for p in subpaths]), np.array([p[-1] for p in subpaths]))
            conditions.append(frames.conditions(SignedDistance(scene, encoding.section_height), frame))
            for segment, path in enumerate(subpaths):
                paths.append(frames.to_local(path, np.full(len(path), segment)))
            spreads.extend(spread / frames.lengths)
        self._conditions = np.concatenate(conditions) if conditions else np.zeros((0, 1), np.float32)
        self._states = _States(paths, 2, spreads)

    def __len__(self) -> int:
        return len(self._conditions)

    def batch(self, indices: NDArray[np.int64], rng: np.random.Generator | None) -> dict[str, Tensor]:
        """states (b, 2), conditions (b, CONDITION_SIZE), noise (b, latent_size)."""
        drawing = np.random.default_rng(int(indices[0])) if rng is None else rng
        states, conditions = self._states.draw(indices, drawing), self._conditions[indices]
        if rng is not None and rng.random() < 0.5:
            states, conditions = states * np.array([1.0, -1.0], np.float32), reflected(conditions)
        noise = drawing.normal(size=(len(indices), self._latent_size)).astype(np.float32)
        arrays = {"states": states, "conditions": conditions, "noise": noise}
        return {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()}


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
