"""The three nodes, in this process or as processes of their own, and clients of them."""

from __future__ import annotations

import gc
import itertools
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor
from rclpy.parameter import Parameter

from bsp_informed_planner.cli.node_processes import NodeProcesses
from bsp_informed_planner.nodes.client import SuiteClient
from bsp_informed_planner.nodes.decomposition_node import DecompositionNode
from bsp_informed_planner.nodes.inference_node import InferenceNode
from bsp_informed_planner.nodes.lifecycle import SWITCH_SECONDS, PlannerSuiteNode, spin
from bsp_informed_planner.nodes.planner_node import PlannerNode

START_SECONDS = 120.0
#: Where nodes may run.
WHERE = ("one process", "processes")
NodeParameters = Mapping[str, Mapping[str, object]]
_numbers = itertools.count()


def node_parameters(robot: str, **planner: object) -> dict[str, dict[str, object]]:
    """Parameters of the three nodes for a robot that comes along, without markers."""
    return {
        "decomposition_node": {"dimension": 2 if robot == "point" else 3, "publish_markers": False},
        "inference_node": {"robot": robot},
        "planner_node": {"robot": robot, "publish_markers": False, **planner},
    }


@contextmanager
def nodes_in_this_process(parameters: NodeParameters) -> Iterator[Callable[[], SuiteClient]]:
    """The nodes, spun by a thread of this process as their own `main` does. Yields what makes clients."""
    with _clients() as (context, namespace, client), ExitStack() as stack:
        stack.callback(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(SWITCH_SECONDS)
        executor = MultiThreadedExecutor(num_threads=4, context=context)
        thread = threading.Thread(target=lambda: spin(executor), daemon=True)
        stack.callback(thread.join, 5.0)
        stack.callback(executor.shutdown, 5.0)
        kinds: tuple[Callable[..., PlannerSuiteNode], ...] = (DecompositionNode, InferenceNode, PlannerNode)
        for kind, values in zip(kinds, parameters.values(), strict=True):
            overrides = [Parameter(name, value=value) for name, value in values.items()]
            node = kind(namespace=namespace, parameter_overrides=overrides, context=context)
            stack.callback(node.destroy_node)
            if not node.autostart():
                raise RuntimeError(f"{node.get_name()} could not be configured")
            executor.add_node(node)
            stack.callback(executor.remove_node, node)
        thread.start()
        gc.collect()
        gc.freeze()
        stack.callback(gc.unfreeze)
        yield client


@contextmanager
def nodes_as_processes(parameters: NodeParameters) -> Iterator[tuple[Callable[[], SuiteClient], NodeProcesses]]:
    """The nodes as `bsp-planner nodes` starts them. Yields what makes clients, and the processes."""
    with _clients() as (context, namespace, client), tempfile.TemporaryDirectory(prefix="bsp-planner-") as logs:
        environment = {
            "ROS_DOMAIN_ID": str(context.get_domain_id()),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        with NodeProcesses(parameters, namespace=namespace, environment=environment, log_dir=Path(logs)) as processes:
            yield client, processes


@contextmanager
def _clients() -> Iterator[tuple[Context, str, Callable[[], SuiteClient]]]:
    """A context and a namespace that nobody else uses, and what makes clients there."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    context = Context()
    rclpy.init(context=context, domain_id=1 + os.getpid() % 100)
    namespace = f"benchmark_{os.getpid()}_{next(_numbers)}"
    with ExitStack() as stack:
        stack.callback(rclpy.shutdown, context=context)
        numbers = itertools.count()

        def make() -> SuiteClient:
            node = rclpy.create_node(f"client_{next(numbers)}", namespace=namespace, context=context)
            stack.callback(node.destroy_node)
            client = SuiteClient(node)
            stack.callback(client.close)
            client.wait_for_nodes(START_SECONDS)
            return client

        yield context, namespace, make
