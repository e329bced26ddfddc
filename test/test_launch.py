"""The launch file, with stand-ins for launch and launch_ros, which are not installed here: what it starts, and how."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from bsp_informed_planner.cli.node_processes import NODE_NAMES
from bsp_informed_planner.nodes.decomposition_parameters import DecompositionParameters
from bsp_informed_planner.nodes.inference_node import InferenceParameters
from bsp_informed_planner.nodes.planner_parameters import PlannerParameters

FILE = Path(__file__).parent.parent / "launch" / "bsp_planner.launch.py"
KINDS: dict[str, Any] = dict(
    zip(NODE_NAMES, (DecompositionParameters, InferenceParameters, PlannerParameters), strict=True)
)


class LaunchConfiguration:
    def __init__(self, name: str) -> None:
        self.name = name

    def perform(self, context: dict[str, str]) -> str:
        return context[self.name]


@pytest.fixture
def description(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the launch file describes: its arguments, and a function that makes the nodes."""
    contents: dict[str, dict[str, Any]] = {
        "launch": {"LaunchContext": dict, "LaunchDescription": list},
        "launch.actions": {
            "DeclareLaunchArgument": lambda name, **options: SimpleNamespace(name=name, **options),
            "OpaqueFunction": lambda function: function,
        },
        "launch.substitutions": {"LaunchConfiguration": LaunchConfiguration},
        "launch_ros": {},
        "launch_ros.actions": {"Node": lambda **options: SimpleNamespace(**options)},
        "launch_ros.parameter_descriptions": {"ParameterValue": lambda value, value_type: (value, value_type)},
    }
    for name, members in contents.items():
        module = ModuleType(name)
        module.__dict__.update(members)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("bsp_planner_launch", FILE)
    assert spec is not None
    assert spec.loader is not None
    launch = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(launch)
    return launch.generate_launch_description()


def nodes_of(description: list[Any], **arguments: str) -> list[Any]:
    *declared, make = description
    context = {argument.name: argument.default_value for argument in declared}
    assert set(arguments) <= set(context)
    made: list[Any] = make({**context, **arguments})
    return made


def test_three_nodes_in_order_that_come_back(description: list[Any]) -> None:
    nodes = nodes_of(description, robot="ur5", namespace="arm", config="own.yaml")
    assert [node.name for node in nodes] == list(NODE_NAMES)
    assert [node.executable for node in nodes] == list(NODE_NAMES)
    assert next(argument for argument in description[:-1] if argument.name == "respawn").default_value == "true"
    for node in nodes:
        assert (node.respawn.name, node.namespace.name) == ("respawn", "namespace")
        assert node.respawn_delay > 0.0
        assert node.parameters[0] == "own.yaml"
    assert nodes[2].parameters[1]["robot"] == "ur5"


def test_nodes_are_given_parameters_that_they_have(description: list[Any], tmp_path: Path) -> None:
    urdf, srdf = tmp_path / "a.urdf", tmp_path / "a.srdf"
    urdf.write_text("<robot/>")
    srdf.write_text("<robot name='s'/>")
    files = {"robot_description": str(urdf), "robot_description_semantic": str(srdf), "frame_id": "base"}
    for node in nodes_of(description, **files):
        [parameters] = node.parameters
        known = set(KINDS[node.name].__dataclass_fields__) | {"use_sim_time"}
        assert set(parameters) <= known
        if node.name == "decomposition_node":
            assert parameters["frame_id"] == "base"
        else:
            assert parameters["robot_description"] == ("<robot/>", str)
            assert parameters["robot_description_semantic"] == ("<robot name='s'/>", str)
