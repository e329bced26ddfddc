"""Gaussian mixtures from a database of local primitives (Chamzas et al. 2019, 2021): the paper's second baseline.

No network: in experience, waypoints are stored with the pairs of obstacles that they were seen close to; in a new scene
those of similar pairs are retrieved, and samples are drawn around them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file, save

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.errors import InvalidOptionError, KeypointsUnavailableError, ModelError
from bsp_informed_planner.networks.card import ModelCard
from bsp_informed_planner.sampling.guidance import Guidance
from bsp_informed_planner.sampling.guide import GuideSetting
from bsp_informed_planner.sampling.local_primitives import LocalPrimitives
from bsp_informed_planner.sampling.models import find_card, read_once
from bsp_informed_planner.scene.pose import FloatArray, frozen_array
from bsp_informed_planner.whole_files import write_whole

SAMPLER_ID = "gmm"


@dataclass(frozen=True)
class GmmOptions:
    """Parameters of the database; the defaults are the authors', for arms.

    Attributes:
        reach: obstacles closer to each other than this are a primitive, and waypoints whose reference point is closer
            than this to both belong to it [m].
        radius: of retrieval: primitives within this distance (`LocalPrimitives.nearest_distances`).
        sigma: standard deviation of the Gaussians [rad or m].
        largest: most waypoints that are retrieved; the nearest primitives first.

    Raises:
        InvalidOptionError: for a number that is not positive.
    """

    reach: float = 0.2
    radius: float = 0.4
    sigma: float = 0.2
    largest: int = 2000

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not 0.0 < value < np.inf:
                raise InvalidOptionError(name, value, "a positive number")


class GaussianMixture:
    """Isotropic Gaussians of equal weights around waypoints.

    Args:
        centres: (k, n), k of at least 1.
        sigma: standard deviation [rad or m].
        lower, upper: (n,) joint limits, to which samples are clipped.
    """

    def __init__(self, centres: FloatArray, sigma: float, lower: FloatArray, upper: FloatArray) -> None:
        self.centres = frozen_array(centres, (-1, len(lower)))
        if not len(self.centres):
            raise InvalidOptionError("centres", self.centres.shape, "at least one Gaussian")
        self.sigma = float(sigma)
        self._lower, self._upper = lower, upper

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """See `Sampler`."""
        centres = self.centres[rng.integers(len(self.centres), size=count)]
        return np.clip(rng.normal(centres, self.sigma), self._lower, self._upper)


@dataclass(frozen=True, eq=False)
class PrimitiveDatabase:
    """Primitives of many scenes, each with the waypoints seen close to it.

    Attributes:
        primitives: p of them.
        offsets: (p + 1,) where the waypoints of each begin.
        waypoints: (w, n) [rad or m].
        options: that it was made with.
    """

    primitives: LocalPrimitives
    offsets: np.ndarray
    waypoints: FloatArray
    options: GmmOptions

    @staticmethod
    def of(
        experiences: Sequence[tuple[LocalPrimitives, FloatArray, FloatArray]], dof: int, options: GmmOptions
    ) -> PrimitiveDatabase:
        """A database of solved problems.

        Args:
            experiences: for each problem the primitives of its scene, waypoints (m, n) of its path, and the robot's
                reference point there (m, 3).
            dof: n.
            options: see there.
        """
        kept: list[LocalPrimitives] = []
        waypoints: list[FloatArray] = [np.zeros((0, dof))]
        counts: list[int] = []
        for primitives, states, points in experiences:
            near = primitives.near(points, options.reach)
            used = np.asarray(near.any(axis=1))
            kept.append(primitives.selected(used))
            for row in near[used]:
                waypoints.append(states[row])
                counts.append(int(row.sum()))
        columns = [
            np.concatenate([np.zeros((0, *shape)), *(getattr(part, name) for part in kept)])
            for name, shape in (("centres", (2, 3)), ("halves", (2, 3)), ("rotations", (2, 3, 3)))
        ]
        offsets = np.concatenate(([0], np.cumsum(counts, dtype=np.int64)))
        return PrimitiveDatabase(LocalPrimitives(*columns), offsets, np.concatenate(waypoints), options)

    def primitives_near(self, primitives: LocalPrimitives) -> np.ndarray:
        """(k,) indices of the stored primitives within the radius of one of these, the nearest first."""
        nearest = primitives.nearest_distances(self.primitives, self.options.radius)
        return np.argsort(nearest, kind="stable")[: int(np.isfinite(nearest).sum())]

    def retrieve(self, primitives: LocalPrimitives) -> FloatArray:
        """(k, n) the waypoints of all stored primitives within the radius of one of these, each primitive's once."""
        found = self.primitives_near(primitives)
        counts = np.diff(self.offsets)[found]
        found = found[np.cumsum(counts) - counts < self.options.largest]
        rows = [self.waypoints[self.offsets[row] : self.offsets[row + 1]] for row in found]
        return np.concatenate([np.zeros((0, self.waypoints.shape[1])), *rows])[: self.options.largest]

    def save(self, card: ModelCard, folder: Path) -> Path:
        """Write the database, rounded to half precision, beside its card, as a model; returns its file.

        Raises:
            ModelError: if that fails.
        """
        path = folder / f"{card.name}.safetensors"
        primitives = self.primitives
        arrays = {
            "centres": primitives.centres.astype(np.float16),
            "halves": primitives.halves.astype(np.float16),
            "rotations": primitives.rotations.astype(np.float16),
            "offsets": self.offsets.astype(np.int32),
            "waypoints": self.waypoints.astype(np.float16),
        }
        try:
            write_whole(path, save(arrays))
        except (OSError, SafetensorError) as error:
            raise ModelError(str(path), f"cannot be written: {error}") from error
        replace(card, inputs=asdict(self.options)).write(path.with_suffix(".json"))
        return path

    @staticmethod
    def load(path: Path) -> PrimitiveDatabase:
        """A database that `save` has written.

        Args:
            path: of the database or of its card.

        Raises:
            ModelError: if a file is missing or damaged.
        """
        card = ModelCard.read(path.with_suffix(".json"))
        file = path.with_suffix(".safetensors")
        try:
            arrays = {name: array.astype(np.float64) for name, array in load_file(file).items()}
            primitives = LocalPrimitives(arrays["centres"], arrays["halves"], arrays["rotations"])
            offsets = arrays["offsets"].astype(np.int64)
            if len(offsets) != len(primitives) + 1 or offsets[-1] != len(arrays["waypoints"]):
                raise ModelError(str(file), "its arrays do not fit together")
            return PrimitiveDatabase(primitives, offsets, arrays["waypoints"], GmmOptions(**card.inputs))
        except (OSError, SafetensorError, KeyError, TypeError) as error:
            raise ModelError(str(file), f"cannot be read: {error}") from error


class GmmGuide:
    """Samples around waypoints of similar places.

    Args:
        setting: robot and scene.
        database: of experience.
    """

    def __init__(self, setting: GuideSetting, database: PrimitiveDatabase) -> None:
        self._setting = setting
        self._database = database
        self._waypoints: FloatArray | None = None

    def guide(
        self,
        start: FloatArray,
        goals: FloatArray,
        checker: CollisionChecker,
        should_stop: Callable[[], bool] | None = None,
    ) -> Guidance:
        """See `Guide`: the same samples for all problems of the scene, and no chains.

        Raises:
            KeypointsUnavailableError: if nothing similar is in the database.
        """
        begin = time.monotonic()
        return Guidance(SAMPLER_ID, (), self.sampler(()), seconds=time.monotonic() - begin)

    def sampler(self, chains: Sequence[FloatArray]) -> GaussianMixture:
        """See `Guide`: the same mixture for all chains.

        Raises:
            KeypointsUnavailableError: if nothing similar is in the database.
        """
        robot, options = self._setting.robot, self._database.options
        if self._waypoints is None:
            self._waypoints = self._database.retrieve(LocalPrimitives.of(self._setting.scene, options.reach))
        if not len(self._waypoints):
            raise KeypointsUnavailableError("no place of the scene is like one in the database")
        return GaussianMixture(self._waypoints, options.sigma, robot.lower, robot.upper)


def gmm_guide(setting: GuideSetting) -> GmmGuide:
    """The guide of the sampler id "gmm".

    Raises:
        ModelUnavailableError: if there is no database for the robot.
    """
    path, _ = find_card(setting.robot, (SAMPLER_ID,), setting.models)
    return GmmGuide(setting, read_once(PrimitiveDatabase.load, path))
