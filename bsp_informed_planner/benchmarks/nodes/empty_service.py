"""A service of plain rclpy that does nothing: what messages of the size of a plan cost by themselves."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

import rclpy
from bsp_informed_planner_msgs.msg import PlanRequest, PlanResponse
from bsp_informed_planner_msgs.srv import Plan
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectoryPoint

NAME = "empty_service"
#: Longest wait for the service, and for an answer [s].
PATIENCE = 30.0


def serve(node: Node) -> None:
    """Have a node serve `empty_service`: its answers have as many points as the request's `max_samples`."""
    responses: dict[int, PlanResponse] = {}

    def answer(request: Plan.Request, response: Plan.Response) -> Plan.Response:
        points = int(request.request.max_samples)
        if points not in responses:
            values = [0.5] * len(request.request.start.position)
            responses[points] = PlanResponse()
            responses[points].trajectory.points = [
                JointTrajectoryPoint(positions=values, velocities=values, accelerations=values) for _ in range(points)
            ]
        response.response = responses[points]
        return response

    node.create_service(Plan, NAME, answer)


@contextmanager
def empty_service(beside: Node, as_process: bool) -> Iterator[Callable[[PlanRequest, int], float]]:
    """Yields what takes the time of one round trip [s], of a request and an answer with so many points.

    Args:
        beside: a node in whose context and namespace the service and its client are.
        as_process: whether the service has a process of its own.
    """
    options = {"context": beside.context, "namespace": beside.get_namespace()}
    with ExitStack() as stack:
        if as_process:
            stack.enter_context(_process(beside))
        else:
            server = rclpy.create_node(NAME, **options)
            stack.callback(server.destroy_node)
            serve(server)
            executor = SingleThreadedExecutor(context=beside.context)
            executor.add_node(server)
            thread = threading.Thread(target=executor.spin, daemon=True)
            thread.start()
            stack.callback(thread.join, PATIENCE)
            stack.callback(executor.shutdown)
        node = rclpy.create_node(f"{NAME}_client", **options)
        stack.callback(node.destroy_node)
        mine = SingleThreadedExecutor(context=beside.context)
        mine.add_node(node)
        stack.callback(mine.shutdown)
        client = node.create_client(Plan, NAME)
        if not client.wait_for_service(PATIENCE):
            raise RuntimeError(f"{NAME} is not there")

        def round_trip(request: PlanRequest, points: int) -> float:
            asked = Plan.Request(request=request)
            asked.request.max_samples = points
            begin = time.perf_counter()
            future = client.call_async(asked)
            # `spin_until_future_complete` leaves tasks behind, more with each call.
            while not future.done() and time.perf_counter() < begin + PATIENCE:
                mine.spin_once(timeout_sec=PATIENCE)
            elapsed = time.perf_counter() - begin
            if not future.done():
                raise RuntimeError(f"{NAME} does not answer")
            if len(future.result().response.trajectory.points) != points:
                raise RuntimeError(f"{NAME} gave another answer")
            return elapsed

        yield round_trip


@contextmanager
def _process(beside: Node) -> Iterator[None]:
    command = [sys.executable, "-m", __name__, "--ros-args", "-r", f"__ns:={beside.get_namespace()}"]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(beside.context.get_domain_id())}
    process = subprocess.Popen(command, env=environment)
    try:
        yield
    finally:
        process.terminate()
        process.wait(PATIENCE)


def main() -> None:
    """Serve until told to end."""
    rclpy.init()
    node = rclpy.create_node(NAME)
    serve(node)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    main()
