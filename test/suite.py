"""The three nodes in this process, for tests."""

from __future__ import annotations

import itertools
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import rclpy
from bsp_informed_planner_msgs.action import PlanMotion
from bsp_informed_planner_msgs.msg import ObstacleScene, PlanRequest, PlanResponse, SceneStatus
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from bsp_informed_planner.nodes.client import SuiteClient
from bsp_informed_planner.nodes.decomposition_node import DecompositionNode
from bsp_informed_planner.nodes.inference_node import InferenceNode
from bsp_informed_planner.nodes.lifecycle import PlannerSuiteNode, spin
from bsp_informed_planner.nodes.planner_node import PlannerNode
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
_names = itertools.count()

#: How long tests wait for what has to come [s]: no statement about time, since others may use the machine.
PATIENCE = 60.0
#: Time of plans that are cancelled, or refused at once; what is over sooner than `SOON` has not waited for its end [s].
LONG, SOON = 60.0, 30.0


def gap_scene(gap_at: float, gap: float = 0.1) -> Scene:
    """A unit square, a wall at x = 0.5 with a gap, for the point robot."""
    bounds = WorkspaceBounds(np.array([0.0, 0.0, -0.05]), np.array([1.0, 1.0, 0.05]))

    def wall(name: str, low: float, high: float) -> Obstacle:
        pose = Pose.from_xyz_rpy([0.5, (low + high) / 2.0, 0.0])
        return Obstacle.of(name, Box(np.array([0.05, high - low, 0.2])), pose)

    return Scene.of([wall("lower", -0.1, gap_at - gap / 2.0), wall("upper", gap_at + gap / 2.0, 1.1)], bounds)


class Suite:
    """Nodes in a namespace of their own, spun by a thread.

    Args:
        robot: "point" or "ur5".
    """

    def __init__(self, robot: str) -> None:
        self.robot = robot
        self.namespace = f"/suite_{os.getpid()}_{next(_names)}"
        self.context = Context()
        rclpy.init(context=self.context, domain_id=100 + os.getpid() % 100)
        self.executor = MultiThreadedExecutor(num_threads=4, context=self.context)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        self.nodes: list[PlannerSuiteNode] = []
        self._clients: list[tuple[SuiteClient, Node]] = []

    def _spin(self) -> None:
        spin(self.executor)

    def add(self, kind: Callable[..., PlannerSuiteNode], **parameters: object) -> PlannerSuiteNode:
        """Start a node."""
        if kind is DecompositionNode:
            defaults: dict[str, object] = {"dimension": 2 if self.robot == "point" else 3}
        else:
            defaults = {"robot": self.robot}
            # On a busy machine tests are slow to ask, and nodes to answer.
            if kind is InferenceNode:
                defaults["max_seconds"] = PATIENCE
            if kind is PlannerNode:
                defaults |= {"joint_state_max_age": PATIENCE, "inference_timeout": PATIENCE}
        overrides = [Parameter(name, value=value) for name, value in {**defaults, **parameters}.items()]
        node = kind(namespace=self.namespace, parameter_overrides=overrides, context=self.context)
        assert node.autostart()
        self.executor.add_node(node)
        self.nodes.append(node)
        return node

    def add_all(self, **planner_parameters: object) -> Suite:
        """Start the three of them."""
        self.add(DecompositionNode)
        self.add(InferenceNode)
        self.add(PlannerNode, **planner_parameters)
        return self

    def remove(self, node: PlannerSuiteNode) -> None:
        """Stop a node."""
        self.executor.remove_node(node)
        self.nodes.remove(node)
        node.destroy_node()

    def client(self) -> SuiteClient:
        """A client outside of the executor of the nodes."""
        node = rclpy.create_node(f"client_{next(_names)}", namespace=self.namespace, context=self.context)
        client = SuiteClient(node)
        self._clients.append((client, node))
        return client

    def settle(self, client: SuiteClient) -> None:
        """Wait until all nodes have heard what a client has heard of the scene: topics and nodes come in any order."""
        trackers = [node._world for node in self.nodes if isinstance(node, (InferenceNode, PlannerNode))]

        def is_settled() -> bool:
            status = client._status
            if status is None or any(tracker._status != status for tracker in trackers):
                return False
            known = [(tracker._scene, tracker._decomposition) for tracker in trackers]
            return status.revision == 0 or all(
                scene is not None
                and graph is not None
                and (scene[0], scene[1].revision) == (graph[0], graph[1].scene_revision)
                and (scene[0], scene[1].revision) == (status.epoch, status.revision)
                for scene, graph in known
            )

        spin_until(client, is_settled, "the nodes have not heard of the scene in force")

    def close(self) -> None:
        for client, node in self._clients:
            client.close()
            node.destroy_node()
        for node in list(self.nodes):
            self.remove(node)
        self.executor.shutdown(timeout_sec=5.0)
        rclpy.shutdown(context=self.context)
        self._thread.join(timeout=5.0)


@contextmanager
def running_suite(robot: str) -> Iterator[Suite]:
    """A suite without nodes, closed at the end."""
    suite = Suite(robot)
    try:
        yield suite
    finally:
        suite.close()


def until(condition: Callable[[], bool], otherwise: str = "it has not come", seconds: float = PATIENCE) -> None:
    """Wait for what other threads and processes do."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, otherwise
        time.sleep(0.01)


def spin_until(client: SuiteClient, condition: Callable[[], bool], otherwise: str = "it has not come") -> None:
    """Wait for what a client hears."""
    assert client.spin_until(condition, PATIENCE), otherwise


def status_of(client: SuiteClient, message: ObstacleScene) -> SceneStatus:
    """Publish a scene message and wait for what the decomposition node says of it, in a client that sends it alone."""
    message.header.stamp = client._node.get_clock().now().to_msg()
    client.publish_message(message)
    spin_until(client, lambda: client._status is not None and client._status.header.stamp == message.header.stamp)
    assert client._status is not None
    return client._status


def motion_client(client: SuiteClient) -> ActionClient:
    """An action client in a client's node; to be destroyed."""
    action = ActionClient(client._node, PlanMotion, "plan_motion")
    spin_until(client, action.server_is_ready)
    return action


def start_motion(
    client: SuiteClient, action: ActionClient, request: PlanRequest, **options: object
) -> ClientGoalHandle:
    """Send a goal and wait until it is accepted."""
    sent = action.send_goal_async(PlanMotion.Goal(request=request), **options)
    spin_until(client, sent.done)
    goal = sent.result()
    assert goal.accepted
    return goal


def outcome_of(client: SuiteClient, goal: ClientGoalHandle) -> PlanResponse:
    """Wait for the result of a goal."""
    result = goal.get_result_async()
    spin_until(client, result.done)
    return result.result().result.response


def point_request(goal: tuple[float, float] = (0.9, 0.5), **fields: object) -> PlanRequest:
    """From the left of the wall to a goal; the first path will do, whenever it comes."""
    request = PlanRequest(allowed_planning_time=PATIENCE, first_solution=True, seed=1)
    request.start.position = [0.1, 0.5]
    request.goal_states = [type(request.start)(position=list(goal))]
    for name, value in fields.items():
        setattr(request, name, value)
    return request


def guided_request(goal: tuple[float, float] = (0.9, 0.5), **fields: object) -> PlanRequest:
    """The same for RRT*, which asks for guidance before anything else."""
    return point_request(goal, planner_id="rrt_star", **fields)


def waypoints(response: PlanResponse, joints: int = 2) -> np.ndarray:
    """Of a response, (m, joints)."""
    return np.array(response.waypoints).reshape(-1, joints)
