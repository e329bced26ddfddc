"""A camera: from points of the world to pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bsp_informed_planner.scene.pose import FloatArray

# Nothing nearer than this is drawn by a perspective camera [m].
NEAR = 0.02


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera with square pixels, (0, 0) being the upper left corner of the upper left one.

    Attributes:
        axes: (3, 3) rows: unit vectors to the right, down and forward.
        position: (3,) of the eye, or any point of the image plane if orthographic [m].
        scale: pixels per metre at a distance of 1 m, or everywhere if orthographic.
        orthographic: whether it is.
        width, height: of the image in pixels.
    """

    axes: FloatArray
    position: FloatArray
    scale: float
    orthographic: bool
    width: int
    height: int

    @staticmethod
    def fitted(
        points: ArrayLike,
        direction: ArrayLike,
        width: int,
        height: int,
        *,
        field_of_view: float | None = math.radians(32.0),
        margin: float = 0.055,
    ) -> Camera:
        """The camera that looks along a direction, z upwards, and just holds all points.

        Args:
            points: (m, 3), m of at least 1 [m].
            direction: (3,) of view, not vertical.
            width, height: of the image in pixels.
            field_of_view: angle between the left and the right edge [rad]; None: orthographic.
            margin: fraction of the image kept free on each side.
        """
        axes = view_axes(direction)
        x, y, z = (np.asarray(points, dtype=np.float64).reshape(-1, 3) @ axes.T).T
        usable = 1.0 - 2.0 * margin
        if field_of_view is None:
            extent = max(np.ptp(x) / width, np.ptp(y) / height, 1e-6 / width)
            centre = np.array([0.5 * (x.min() + x.max()), 0.5 * (y.min() + y.max()), z.min() - 1.0])
            return Camera(axes, centre @ axes, usable / extent, True, width, height)
        # With the eye at e, a point is seen if |x - e_x| <= tan_x (z - e_z): of each side the tightest point counts.
        tangent = math.tan(0.5 * field_of_view)
        tan_x, tan_y = usable * tangent, usable * tangent * height / width
        right, left = (x - tan_x * z).max(), (-x - tan_x * z).max()
        low, high = (y - tan_y * z).max(), (-y - tan_y * z).max()
        depth = min(-(right + left) / (2.0 * tan_x), -(low + high) / (2.0 * tan_y), z.min() - 2.0 * NEAR)
        eye = np.array([0.5 * (right - left), 0.5 * (low - high), depth])
        return Camera(axes, eye @ axes, 0.5 * width / tangent, False, width, height)

    def view(self, points: ArrayLike) -> FloatArray:
        """Points (..., 3) of the world in the axes of the camera [m]."""
        return np.asarray((np.asarray(points, dtype=np.float64) - self.position) @ self.axes.T)

    def project(self, points: ArrayLike) -> FloatArray:
        """(..., 3) x and y in pixels and the nearness of points (..., 3) of the world; see `project_view`."""
        return self.project_view(self.view(points))

    def project_view(self, view: FloatArray) -> FloatArray:
        """(..., 3) x and y in pixels, and nearness: it grows towards the eye, and is linear in x and y on a plane.

        Args:
            view: (..., 3) in the axes of the camera [m]; for a perspective camera in front of the near plane.
        """
        centre = np.array([0.5 * self.width, 0.5 * self.height])
        result = np.empty_like(view)
        if self.orthographic:
            result[..., :2] = view[..., :2] * self.scale + centre
            result[..., 2] = -view[..., 2]
        else:
            result[..., 2] = 1.0 / np.maximum(view[..., 2], 1e-9)
            result[..., :2] = view[..., :2] * (self.scale * result[..., 2:]) + centre
        return result

    def nearer(self, points: FloatArray, distance: float) -> FloatArray:
        """Points (..., 3) of the world moved towards the eye by a distance [m]: they stay at their pixels."""
        if self.orthographic:
            return points - distance * self.axes[2]
        towards = self.position - points
        return np.asarray(points + distance * towards / np.linalg.norm(towards, axis=-1, keepdims=True).clip(1e-9))

    def resized(self, factor: float) -> Camera:
        """The same view in an image of `factor` times the width and height, to whole pixels."""
        width, height = max(round(self.width * factor), 1), max(round(self.height * factor), 1)
        return Camera(self.axes, self.position, self.scale * factor, self.orthographic, width, height)


def view_axes(direction: ArrayLike) -> FloatArray:
    """(3, 3) rows right, down and forward of a camera that looks along `direction` (3,), z upwards."""
    forward = np.asarray(direction, dtype=np.float64)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-9:
        right = np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    return np.stack((right, np.cross(forward, right), forward))


def looking(azimuth: float, elevation: float) -> FloatArray:
    """(3,) direction of view of an eye that stands at an azimuth and elevation [rad] around what it looks at."""
    return -np.array(
        [math.cos(azimuth) * math.cos(elevation), math.sin(azimuth) * math.cos(elevation), math.sin(elevation)]
    )
