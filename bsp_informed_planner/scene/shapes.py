"""Shapes that obstacles are made of, each in its own frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.scene.pose import UNIT_LENGTH_TOLERANCE, FloatArray, frozen_array

# Edge of the voxels of a point cloud where none is given [m].
CLOUD_RESOLUTION = 0.02
# Larger clouds are refused: so many voxels that lie apart from each other take half a minute to decompose.
MAX_CLOUD_POINTS = 2_000_000
MAX_CLOUD_VOXELS = 200_000
# Voxels lie at most so far from the origin along each axis, which is what an octree of 16 levels holds.
MAX_VOXEL_INDEX = 2**15 - 1


def _positive(name: str, value: float) -> float:
    value = float(value)
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f"{name} = {value}: expected a positive number")
    return value


@dataclass(frozen=True, eq=False)
class Box:
    """A box centred at the origin. `size`: (3,) full edge lengths [m]."""

    size: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", frozen_array(self.size, (3,)))
        if (self.size <= 0.0).any():
            raise ValueError(f"box of size {self.size.tolist()}: expected positive edges")


@dataclass(frozen=True)
class Sphere:
    """A ball at the origin. `radius` [m]."""

    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _positive("sphere radius", self.radius))


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z, centred at half height. `radius`, `height` [m]."""

    radius: float
    height: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _positive("cylinder radius", self.radius))
        object.__setattr__(self, "height", _positive("cylinder height", self.height))


@dataclass(frozen=True)
class Cone:
    """A cone along z, its tip at +height / 2 and its base at -height / 2. `radius` of the base, `height` [m]."""

    radius: float
    height: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _positive("cone radius", self.radius))
        object.__setattr__(self, "height", _positive("cone height", self.height))


@dataclass(frozen=True, eq=False)
class ConvexMesh:
    """The convex hull of `vertices`, (n, 3) [m], which must span a volume."""

    vertices: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen_array(self.vertices, (-1, 3)))
        spread = self.vertices - self.vertices.mean(axis=0) if len(self.vertices) else self.vertices
        if len(self.vertices) < 4 or np.linalg.svd(spread, compute_uv=False)[2] < 1e-7:
            raise ValueError(f"the hull of {len(self.vertices)} vertices has no volume")


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh, which may be concave; it is treated as the solid that it encloses.

    Attributes:
        vertices: (n, 3) [m].
        triangles: (m, 3) indices into vertices.
    """

    vertices: FloatArray
    triangles: NDArray[np.int64]

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen_array(self.vertices, (-1, 3)))
        triangles = np.array(self.triangles, dtype=np.int64)
        if triangles.ndim != 2 or triangles.shape[1:] != (3,) or len(triangles) < 4:
            raise ValueError(f"triangles of shape {triangles.shape}: a solid has at least 4, as rows of 3 indices")
        if triangles.min() < 0 or triangles.max() >= len(self.vertices):
            raise ValueError(f"a triangle has an index outside the {len(self.vertices)} vertices")
        spread = self.vertices[np.unique(triangles)]
        spread = spread - spread.mean(axis=0)
        if np.linalg.svd(spread, compute_uv=False)[-1] < 1e-7:
            raise ValueError("the mesh is flat: it encloses no volume")
        triangles.setflags(write=False)
        object.__setattr__(self, "triangles", triangles)


@dataclass(frozen=True, eq=False)
class HalfSpace:
    """The solid half-space normal . x + offset <= 0, e.g. a floor.

    Attributes:
        normal: (3,), of unit length, out of the solid.
        offset: [m].
    """

    normal: FloatArray
    offset: float

    def __post_init__(self) -> None:
        normal = frozen_array(self.normal, (3,))
        length = float(np.linalg.norm(normal))
        if length < 1e-9 or not np.isfinite(self.offset):
            raise ValueError("a plane needs a normal that is not zero and a finite offset")
        if abs(length - 1.0) <= UNIT_LENGTH_TOLERANCE:
            length = 1.0
        object.__setattr__(self, "normal", frozen_array(normal / length))
        object.__setattr__(self, "offset", float(self.offset) / length)


@dataclass(frozen=True, eq=False)
class PointCloud:
    """The body of measured points: all voxels that hold one.

    Voxels are cubes of edge `resolution`, aligned with the axes of the cloud's frame; the origin is a corner of some.
    The body is the union of the closed cubes, so that it contains every point, and stands out of the measured surface
    by at most the diagonal of a voxel. Where no point was measured there is no body.

    Attributes:
        points: (n, 3) [m].
        resolution: edge of a voxel [m].

    Raises:
        ValueError: without points, with a value that is not finite, or with more points or voxels, or voxels further
            from the origin, than `MAX_CLOUD_POINTS`, `MAX_CLOUD_VOXELS` and `MAX_VOXEL_INDEX` allow.
    """

    points: FloatArray
    resolution: float = CLOUD_RESOLUTION

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_array(self.points, (-1, 3)))
        object.__setattr__(self, "resolution", _positive("resolution of a point cloud", self.resolution))
        if not 0 < len(self.points) <= MAX_CLOUD_POINTS:
            raise ValueError(f"a point cloud of {len(self.points)} points: expected 1 to {MAX_CLOUD_POINTS}")
        largest = float(np.abs(self.points).max())
        if largest / self.resolution >= MAX_VOXEL_INDEX:
            raise ValueError(
                f"a point {largest:.6g} m from the origin of its cloud: at a resolution of {self.resolution:g} m, "
                f"coordinates below {MAX_VOXEL_INDEX * self.resolution:.6g} m are expected"
            )
        if len(self.voxels) > MAX_CLOUD_VOXELS:
            raise ValueError(
                f"the points lie in {len(self.voxels)} voxels of {self.resolution:g} m: at most {MAX_CLOUD_VOXELS} are "
                "taken, so a coarser resolution is needed"
            )

    @property
    def voxels(self) -> NDArray[np.int64]:
        """(m, 3) indices i of the voxels, sorted by x, y and z: the cubes from i to i + 1, times `resolution`."""
        return self._voxels_and_first[0]

    @property
    def voxel_centres(self) -> FloatArray:
        """(m, 3) centres of the voxels [m], in the order of `voxels`."""
        return (self.voxels.astype(np.float64) + 0.5) * self.resolution

    def thinned(self) -> PointCloud:
        """The same body of as few points as possible: the first in each voxel, in their order."""
        first = self._voxels_and_first[1]
        return self if len(first) == len(self.points) else PointCloud(self.points[np.sort(first)], self.resolution)

    @cached_property
    def _voxels_and_first(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The voxels, and for each the index of its first point."""
        indices = np.floor(self.points / self.resolution).astype(np.int64)
        lowest = indices.min(axis=0)
        extents = tuple((indices.max(axis=0) - lowest + 1).tolist())
        keys, first = np.unique(np.ravel_multi_index(tuple((indices - lowest).T), extents), return_index=True)
        voxels = np.stack(np.unravel_index(keys, extents), axis=1) + lowest
        voxels.setflags(write=False)
        return voxels, first


Shape = Box | Sphere | Cylinder | Cone | ConvexMesh | Mesh | HalfSpace | PointCloud
