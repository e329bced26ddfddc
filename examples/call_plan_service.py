"""Call the service `plan` from a node of your own.

bsp-planner nodes --robot ur5          (in another shell)
python examples/call_plan_service.py
"""

from __future__ import annotations

import rclpy
from bsp_informed_planner_msgs.msg import Obstacle, ObstacleScene, SceneStatus
from bsp_informed_planner_msgs.srv import Plan
from geometry_msgs.msg import Point, Pose, PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from shape_msgs.msg import SolidPrimitive

rclpy.init()
node = rclpy.create_node("my_node")
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
status: list[SceneStatus] = []
node.create_subscription(SceneStatus, "scene_status", status.append, latched)
scenes = node.create_publisher(ObstacleScene, "obstacle_scene", latched)
plan = node.create_client(Plan, "plan")
if not plan.wait_for_service(timeout_sec=30.0):
    raise SystemExit("service plan is not there: are the nodes running?")

box = Obstacle(id="box", pose=Pose(position=Point(x=0.5, y=0.0, z=0.2)))
box.primitives = [SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.2, 0.4, 0.4])]
scene = ObstacleScene(obstacles=[box])
scene.header.frame_id = "world"  # the root link of the robot
scene.header.stamp = node.get_clock().now().to_msg()
scenes.publish(scene)
while not status or status[-1].header.stamp != scene.header.stamp:
    rclpy.spin_once(node)  # the nodes say when the scene is in force, or why not
if status[-1].error_code != 1:
    raise SystemExit(status[-1].message)

request = Plan.Request().request
request.scene_revision = status[-1].revision  # plan on this scene and no other
request.start = JointState(position=[0.9, -1.2, 1.2, -1.57, -1.57, 0.0])  # empty: from joint_states
goal = PoseStamped()
goal.header.frame_id = "world"
goal.pose.position.x, goal.pose.position.y, goal.pose.position.z = 0.45, -0.35, 0.3
goal.pose.orientation.x = 1.0  # the tool points down
request.goal_poses = [goal]
request.allowed_planning_time = 2.0  # improve the path for so long; the first comes within moments:
request.first_solution = False  # True returns that one
future = plan.call_async(Plan.Request(request=request))
rclpy.spin_until_future_complete(node, future)
response = future.result().response
print(response.error_code, response.message)  # 1: success; else a MoveIt error code and the reason
if response.error_code == 1:
    print(len(response.trajectory.points), "points for a joint trajectory controller; certified:", response.certified)
rclpy.shutdown()
