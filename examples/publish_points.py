"""Publish the points of a camera as obstacles: a PointCloud2, made by hand.

bsp-planner nodes --robot ur5          (in another shell)
python examples/publish_points.py
"""

from __future__ import annotations

import array
import time

import numpy as np
import rclpy
from bsp_informed_planner_msgs.msg import ObstacleScene
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2, PointField


def point_cloud(points: np.ndarray, frame: str) -> PointCloud2:
    """A message of points (n, 3) [m] in a frame."""
    values = np.ascontiguousarray(points, dtype="<f4")
    cloud = PointCloud2(height=1, width=len(values), is_dense=bool(np.isfinite(values).all()))
    cloud.header.frame_id = frame
    cloud.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1) for i, name in enumerate("xyz")
    ]
    cloud.point_step, cloud.row_step = 12, 12 * len(values)
    cloud.data = array.array("B", values.tobytes())
    return cloud


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("my_camera")
    seen: list[ObstacleScene] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(ObstacleScene, "scene", seen.append, latched)
    clouds = node.create_publisher(PointCloud2, "obstacle_points", qos_profile_sensor_data)
    y, z = np.meshgrid(np.arange(-0.3, 0.3, 0.01), np.arange(0.0, 0.4, 0.01))
    cloud = point_cloud(np.stack([np.full(y.size, 0.8), y.ravel(), z.ravel()], axis=1), "world")
    deadline = time.monotonic() + 30.0
    while not seen or "points" not in [obstacle.id for obstacle in seen[-1].obstacles]:
        if time.monotonic() > deadline:
            raise SystemExit("the points are in no scene: are the nodes running?")
        cloud.header.stamp = node.get_clock().now().to_msg()
        clouds.publish(cloud)  # again and again, as a camera does: each takes the place of the one before
        rclpy.spin_once(node, timeout_sec=0.2)
    print(f"{cloud.width} points are an obstacle of revision {seen[-1].revision} of the scene")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
