"""Triangles with normals, for pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bsp_informed_planner.scene.pose import FloatArray

# Faces that meet at a smaller angle than this are drawn as one smooth surface: cos(40 degrees).
CREASE_COSINE = 0.766
# Corners closer than this fraction of the extent are one vertex.
WELD_TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles, each with the normals of the surface at its corners.

    Attributes:
        corners: (t, 3, 3) corners of each triangle [m].
        normals: (t, 3, 3) unit normals at these corners.
    """

    corners: FloatArray
    normals: FloatArray

    @staticmethod
    def of(corners: ArrayLike) -> TriangleMesh:
        """From triangles (t, 3, 3) [m], smooth across edges of less than 40 degrees, sharp across others."""
        array = np.asarray(corners, dtype=np.float64).reshape(-1, 3, 3)
        areas = np.cross(array[:, 1] - array[:, 0], array[:, 2] - array[:, 0])
        array = array[np.linalg.norm(areas, axis=1) > 0.0]
        return TriangleMesh(array, corner_normals(array))

    @staticmethod
    def joined(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
        """All triangles of several meshes, in their order."""
        if not meshes:
            return TriangleMesh(np.empty((0, 3, 3)), np.empty((0, 3, 3)))
        return TriangleMesh(
            np.concatenate([mesh.corners for mesh in meshes]), np.concatenate([mesh.normals for mesh in meshes])
        )

    def transformed(self, rotation: FloatArray, position: FloatArray) -> TriangleMesh:
        """Turned by a matrix (3, 3), then moved by (3,) [m]."""
        return TriangleMesh(self.corners @ rotation.T + position, self.normals @ rotation.T)

    @property
    def points(self) -> FloatArray:
        """(3 t, 3) corners of all triangles [m]."""
        return self.corners.reshape(-1, 3)

    def __len__(self) -> int:
        return len(self.corners)


def corner_normals(corners: FloatArray) -> FloatArray:
    """(t, 3, 3) normals at the corners of triangles (t, 3, 3) that have an area.

    The normal at a corner is the mean, weighted by area, over the triangles that share the vertex and are inclined to
    the corner's own triangle by less than the crease angle.
    """
    count = len(corners)
    if count == 0:
        return np.empty((0, 3, 3))
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    units = areas / np.linalg.norm(areas, axis=1, keepdims=True)
    first, second = _neighbours(_welded(corners.reshape(-1, 3)))
    smooth = (units[first // 3] * units[second // 3]).sum(axis=1) > CREASE_COSINE
    sums = np.zeros((3 * count, 3))
    np.add.at(sums, first[smooth], areas[second[smooth] // 3])
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(lengths > 0.0, sums / np.maximum(lengths, 1e-300), units.repeat(3, axis=0)).reshape(count, 3, 3)


def _welded(points: FloatArray) -> NDArray[np.int64]:
    """The index of the vertex of each point (n, 3); near points share one."""
    extent = max(float(np.ptp(points, axis=0).max()), 1e-9)
    _, vertices = np.unique(np.round(points / (WELD_TOLERANCE * extent)), axis=0, return_inverse=True)
    return np.asarray(vertices).reshape(-1).astype(np.int64)


def _neighbours(vertices: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """All ordered pairs of corners that share a vertex, given the vertex of each corner (n,)."""
    order = np.argsort(vertices, kind="stable")
    counts = np.bincount(vertices)
    begins = np.concatenate(([0], np.cumsum(counts)[:-1]))
    repeats = counts[vertices]
    first = np.arange(len(vertices)).repeat(repeats)
    within = np.arange(len(first)) - (np.cumsum(repeats) - repeats).repeat(repeats)
    return first, order[begins[vertices].repeat(repeats) + within]
