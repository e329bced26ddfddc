"""The SROS 2 policy names what the nodes really have: nothing is missing, nothing is too much."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from suite import running_suite

from bsp_informed_planner.nodes.decomposition_node import DecompositionNode
from bsp_informed_planner.nodes.inference_node import InferenceNode
from bsp_informed_planner.nodes.lifecycle import PlannerSuiteNode
from bsp_informed_planner.nodes.planner_node import PlannerNode

POLICY = Path(__file__).resolve().parent.parent / "config" / "sros2" / "policy.xml"


def allowed(node: str, kind: str, attribute: str) -> set[str]:
    """Names that the policy allows a node, e.g. "topic", "publish"."""
    root = ElementTree.parse(POLICY).getroot()
    profile = root.find(f".//profile[@node='{node}']")
    assert profile is not None
    return {str(item.text) for item in profile.findall(f"{kind}s[@{attribute}='ALLOW']/{kind}")}


def real(node: PlannerSuiteNode) -> dict[tuple[str, str], set[str]]:
    """The same of a running node, from the graph."""
    name, namespace = node.get_name(), node.get_namespace()

    def relative(listed: list[tuple[str, list[str]]]) -> set[str]:
        own = f"{namespace}/{name}/"
        return {
            "~/" + text.removeprefix(own) if text.startswith(own) else text.removeprefix(f"{namespace}/")
            for text, _ in listed
        }

    topics = {
        "publish": relative(node.get_publisher_names_and_types_by_node(name, namespace)),
        "subscribe": relative(node.get_subscriber_names_and_types_by_node(name, namespace)),
    }
    services = {
        "reply": relative(node.get_service_names_and_types_by_node(name, namespace)),
        "request": relative(node.get_client_names_and_types_by_node(name, namespace)),
    }
    actions = {item.split("/")[0] for item in services["reply"] if "/_action/" in item}
    found = {("topic", key): {item for item in names if "/_action/" not in item} for key, names in topics.items()}
    found |= {("service", key): {item for item in names if "/_action/" not in item} for key, names in services.items()}
    return found | {("action", "execute"): actions}


@pytest.mark.parametrize("kind", [DecompositionNode, InferenceNode, PlannerNode])
def test_policy_names_what_nodes_have(kind: type[PlannerSuiteNode]) -> None:
    with running_suite("point") as suite:
        # Without a robot of its own a node listens to the topics of descriptions.
        node = suite.add(kind) if kind is DecompositionNode else suite.add(kind, robot="")
        for (what, attribute), names in real(node).items():
            expected = allowed(node.get_name(), what, attribute)
            # /clock: only with use_sim_time.
            assert expected - {"/clock"} == names, (what, attribute)


def test_clients_may_not_manage_nodes() -> None:
    for what, attribute in (("service", "request"), ("service", "reply"), ("topic", "publish")):
        assert not [name for name in allowed("client", what, attribute) if "state" in name or "set_parameters" in name]
    assert allowed("client", "service", "request") == {"get_planner_info", "plan"}
