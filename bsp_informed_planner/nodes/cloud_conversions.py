"""Point clouds between sensor_msgs/PointCloud2 and arrays."""

from __future__ import annotations

from array import array

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import WorkspaceBounds
from bsp_informed_planner.scene.shapes import MAX_CLOUD_POINTS, PointCloud

_TYPES = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8"}


def cloud_points(message: PointCloud2, allow_none: bool = False) -> FloatArray:
    """The points of a cloud, organised or not, in the order of its data.

    Read are the fields `x`, `y` and `z`, of 32 or 64 bit floating point each, at any offset, in either byte order and
    with any padding of points and rows. Other fields are passed over. Points with a value that is not finite are
    returns that were lost (REP-117); they are left out, unless the cloud claims to have none (`is_dense`).

    Args:
        message: the cloud.
        allow_none: whether it may be that no point is left.

    Returns:
        (n, 3) [m], at least one, unless none is allowed.

    Raises:
        ValueError: for a message whose parts do not fit together, of more than `MAX_CLOUD_POINTS` points, that is dense
            but has values that are not finite, or without any point left.
    """
    count = message.width * message.height
    if not 0 < count <= MAX_CLOUD_POINTS:
        raise ValueError(f"a point cloud of {count} points: expected 1 to {MAX_CLOUD_POINTS}")
    step = message.point_step
    # Of a cloud of one row the length of rows does not matter, and some publishers leave it out.
    row = message.width * step if message.height == 1 else message.row_step
    if row < message.width * step:
        raise ValueError(f"point cloud: rows of {message.width} points of {step} bytes do not fit in row_step = {row}")
    needed = (message.height - 1) * row + message.width * step
    if len(message.data) < needed:
        raise ValueError(f"point cloud: its data have {len(message.data)} bytes, its sizes speak of {needed}")
    order = ">" if message.is_bigendian else "<"
    points = np.empty((message.height, message.width, 3))
    for axis, name in enumerate("xyz"):
        field = _field(message, name)
        kind = np.dtype(order + _TYPES[field.datatype])
        if field.offset + kind.itemsize > step:
            raise ValueError(f"point cloud: field '{name}' at {field.offset} ends beyond the {step} bytes of a point")
        points[:, :, axis] = np.ndarray(
            (message.height, message.width), kind, memoryview(message.data), field.offset, (row, step)
        )
    points = points.reshape(-1, 3)
    finite = np.isfinite(points).all(axis=1)
    if finite.all():
        return points
    if message.is_dense:
        raise ValueError(f"point cloud: {np.count_nonzero(~finite)} points are not finite, though it claims is_dense")
    if not finite.any() and not allow_none:
        raise ValueError("point cloud: none of its points is finite")
    return points[finite]


def measured_cloud(message: PointCloud2, resolution: float, bounds: WorkspaceBounds) -> PointCloud | None:
    """What a sensor has measured within bounds; None if that is nothing.

    Args:
        message: see `cloud_points`; one without points, or with none that is finite, has measured nothing.
        resolution: edge of the voxels [m].
        bounds: points outside of them are left out.

    Raises:
        ValueError: if it is no point cloud.
    """
    if message.width * message.height == 0:
        return None
    points = cloud_points(message, allow_none=True)
    points = points[bounds.contains(points)]
    return PointCloud(points, resolution).thinned() if len(points) else None


def cloud_to_msg(points: FloatArray, frame: str = "") -> PointCloud2:
    """A dense cloud of one row from points (n, 3) [m], for `cloud_points`.

    The fields are FLOAT32 if that changes no value, else FLOAT64. The stamp is left to the caller.

    Args:
        points: finite.
        frame: that the points are given in.
    """
    with np.errstate(over="ignore"):
        single = points.astype("<f4")
    exact = bool((single == points).all())
    values = single if exact else points.astype("<f8")
    size = values.dtype.itemsize
    datatype = PointField.FLOAT32 if exact else PointField.FLOAT64
    message = PointCloud2(
        height=1,
        width=len(points),
        fields=[
            PointField(name=name, offset=axis * size, datatype=datatype, count=1) for axis, name in enumerate("xyz")
        ],
        is_bigendian=False,
        point_step=3 * size,
        row_step=3 * size * len(points),
        data=array("B", values.tobytes()),
        is_dense=True,
    )
    message.header.frame_id = frame
    return message


def _field(message: PointCloud2, name: str) -> PointField:
    """A field of coordinates.

    Raises:
        ValueError: if it is missing, repeated or no single floating point number.
    """
    fields = [field for field in message.fields if field.name == name]
    if len(fields) != 1:
        listed = ", ".join(field.name for field in message.fields) or "none"
        raise ValueError(f"point cloud: expected one field '{name}' (it has: {listed})")
    # A count of 0 is what publishers write that do not know of it.
    if fields[0].datatype not in _TYPES or fields[0].count not in (0, 1):
        raise ValueError(
            f"point cloud: field '{name}' has datatype {fields[0].datatype} and count {fields[0].count}, "
            f"expected one FLOAT32 ({PointField.FLOAT32}) or FLOAT64 ({PointField.FLOAT64})"
        )
    return fields[0]
