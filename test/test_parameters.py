"""Parameters of the nodes: declared once, checked, changed while the nodes run, and written down."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from rclpy.parameter import Parameter
from suite import PATIENCE, Suite, gap_scene, guided_request, point_request, running_suite

from bsp_informed_planner.cli.app import app
from bsp_informed_planner.nodes.decomposition_node import DecompositionNode
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.inference_node import InferenceNode
from bsp_informed_planner.nodes.lifecycle import PlannerSuiteNode
from bsp_informed_planner.nodes.parameter_table import KINDS, parameter_table
from bsp_informed_planner.nodes.planner_node import PlannerNode

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def suite() -> Iterator[Suite]:
    with running_suite("point") as suite:
        yield suite


def refusal(node: PlannerSuiteNode, **values: object) -> str:
    """Why a change was refused; empty if it was not."""
    result = node.set_parameters_atomically([Parameter(name, value=value) for name, value in values.items()])
    assert result.successful == (not result.reason)
    return str(result.reason)


@pytest.mark.parametrize(
    ("kind", "values", "said"),
    [
        (PlannerNode, {"workers": 0}, "workers"),
        (PlannerNode, {"uniform_fraction": float("nan")}, "uniform_fraction"),
        (PlannerNode, {"sampler_id": "magic"}, "magic"),
        (PlannerNode, {"allowed_planning_time": 90.0}, "at most max_seconds"),
        (PlannerNode, {"allowed_planning_time": 5}, "allowed_planning_time"),
        (PlannerNode, {"paddding": 0.1}, "did you mean padding?"),
        (InferenceNode, {"robot": "r2d2"}, "r2d2"),
        (DecompositionNode, {"grid": 4}, "an odd number"),
        (DecompositionNode, {"workspace_max": [1.0, 1.0]}, "3 numbers"),
        (DecompositionNode, {"workspace_max": [1.0, 1.0, -2.0]}, "less than workspace_max"),
    ],
)
def test_bad_parameters_fail_the_transition(
    suite: Suite,
    kind: Callable[..., PlannerSuiteNode],
    values: dict[str, object],
    said: str,
    capfd: pytest.CaptureFixture[str],
) -> None:
    defaults: dict[str, object] = {} if kind is DecompositionNode else {"robot": "point"}
    overrides = [Parameter(name, value=value) for name, value in {**defaults, **values}.items()]
    node = kind(namespace=suite.namespace, parameter_overrides=overrides, context=suite.context)
    assert not node.autostart()
    assert said in capfd.readouterr().err
    # Nothing is left behind.
    assert not [topic for topic in (s.topic_name for s in node.subscriptions) if topic.endswith("scene")]
    node.destroy_node()


def test_unknown_parameters_may_be_allowed(suite: Suite, capfd: pytest.CaptureFixture[str]) -> None:
    suite.add(InferenceNode, somebody_elses=1, allow_unknown_parameters=True)
    assert "no parameter 'somebody_elses'" in capfd.readouterr().err


def test_changes_are_judged_and_applied(suite: Suite) -> None:
    suite.add_all()
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    suite.settle(client)
    planner = suite.nodes[-1]
    assert "at most max_seconds, 2" in refusal(planner, uniform_fraction=0.7, max_seconds=2.0)
    assert planner.get_parameter("uniform_fraction").value == 0.5
    assert "at most" in refusal(planner, uniform_fraction=1.5) or "range" in refusal(planner, uniform_fraction=1.5)
    assert "'magic'" in refusal(planner, sampler_id="magic")
    assert "when the node is configured" in refusal(planner, workers=4)
    assert client.plan(guided_request(), PATIENCE).sampler_id == "keypoint_tube"
    assert refusal(planner, sampler_id="uniform") == ""
    response = client.plan(point_request(), PATIENCE)
    assert (response.error_code, response.sampler_id) == (ErrorCode.SUCCESS, "uniform")
    assert refusal(planner, max_seconds=0.5, allowed_planning_time=0.5) == ""
    response = client.plan(point_request(allowed_planning_time=1.0), PATIENCE)
    assert "at most 0.5 s" in response.message
    # What is read when a node is configured can be set while it is not.
    planner.trigger_deactivate()
    planner.trigger_cleanup()
    assert refusal(planner, workers=4) == ""
    planner.trigger_configure()
    planner.trigger_activate()
    assert planner.get_parameter("workers").value == 4


def test_a_change_to_empty_scenes_takes_effect(suite: Suite) -> None:
    suite.add_all()
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    scene = gap_scene(0.8)
    client.publish_scene(type(scene).of([], scene.bounds), PATIENCE)
    suite.settle(client)
    refused = client.plan(point_request(scene_revision=client.revision), PATIENCE)
    assert refused.error_code == ErrorCode.UNABLE_TO_ACQUIRE_SENSOR_DATA
    assert refusal(suite.nodes[-1], allow_empty_scene=True) == ""
    assert client.plan(point_request(), PATIENCE).error_code == ErrorCode.SUCCESS


def test_descriptors_say_bounds(suite: Suite) -> None:
    node = suite.add(PlannerNode)
    described = node.describe_parameter("uniform_fraction")
    assert (described.floating_point_range[0].from_value, described.floating_point_range[0].to_value) == (0.0, 1.0)
    assert "lambda" in described.description
    assert node.describe_parameter("workers").integer_range[0].to_value == 64
    assert "'rrt_star'" in node.describe_parameter("planner_id").additional_constraints


def test_the_table_is_up_to_date(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    assert (ROOT / "docs" / "parameters.md").read_text(encoding="utf-8") == parameter_table(), (
        "run: bsp-planner parameters --write docs/parameters.md"
    )
    written = tmp_path / "parameters.md"
    assert CliRunner().invoke(app, ["parameters", "--write", str(written)]).exit_code == 0
    assert written.read_text(encoding="utf-8") == parameter_table()


@pytest.mark.parametrize("file", ["point.yaml", "ur5.yaml"])
def test_parameter_files_name_parameters_that_exist(file: str) -> None:
    content = yaml.safe_load((ROOT / "config" / file).read_text(encoding="utf-8"))
    for node, values in content.items():
        fields: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in values["ros__parameters"].items()
        }
        KINDS[node.removeprefix("/**/")](**fields).validate()
