"""Malformed requests, scenes and descriptions: each is answered with a code that names a reason, none is a crash.

Some hundred cases, or as many as the environment asks for: `FUZZ_CASES=10000 pytest test/test_fuzz_nodes.py`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from bsp_informed_planner_msgs.msg import AllowedCollision, AttachedObstacle, Obstacle, ObstacleScene
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import PointCloud2, PointField
from shape_msgs.msg import Mesh, MeshTriangle, Plane, SolidPrimitive
from suite import PATIENCE, Suite, gap_scene, running_suite

from bsp_informed_planner.benchmarks.nodes.random_requests import random_request
from bsp_informed_planner.errors import BspPlannerError
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.planner_node import PlannerNode
from bsp_informed_planner.nodes.scene_conversions import scene_from_msg, scene_to_msg
from bsp_informed_planner.nodes.scene_keeper import SceneKeeper
from bsp_informed_planner.nodes.size_limits import SizeLimits
from bsp_informed_planner.robots.arm import load_arm

#: Of each kind: requests, scenes, clouds, descriptions.
CASES = int(os.environ.get("FUZZ_CASES", "600")) // 4
BOUNDS = gap_scene(0.5).bounds
URDF = """<robot name="slider"><link name="world"/><link name="beam"/>
<joint name="x" type="prismatic"><origin xyz="0 0 0.1" rpy="0 0 0"/><parent link="world"/><child link="beam"/>
<axis xyz="1 0 0"/><limit lower="0" upper="1" velocity="1" effort="1"/></joint>
<link name="ball"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
<joint name="q" type="revolute"><parent link="beam"/><child link="ball"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


def refused(call: Callable[[], object]) -> bool:
    """Whether a call was refused with a sentence; any other exception is a failure of the test."""
    reason: str | None = None
    try:
        call()
    except BspPlannerError as error:
        reason = str(error)
    assert reason != ""
    return reason is not None


@pytest.fixture(scope="module")
def suite() -> Iterator[Suite]:
    with running_suite("point") as suite:
        yield suite.add_all(use_inference=False)


def test_requests(suite: Suite) -> None:
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    suite.settle(client)
    planner = suite.nodes[-1]
    assert isinstance(planner, PlannerNode)
    rng = np.random.default_rng(0)
    codes = set()
    for _ in range(CASES):
        request = random_request(rng)
        request.allowed_planning_time = min(request.allowed_planning_time, 0.05)
        response = planner._plan(request, lambda: False, None).response
        assert response.error_code not in (ErrorCode.CRASH, ErrorCode.FAILURE), (response.message, request)
        assert response.message
        codes.add(response.error_code)
    assert len(codes) >= 6


numbers = st.one_of(
    st.floats(-2.0, 2.0), st.sampled_from([0.0, np.nan, np.inf, -np.inf, 1e-320, 1e300, -1e-9, 1e12]), st.floats()
)
names = st.one_of(st.sampled_from(["", "a", "b", "lower", "points"]), st.text(max_size=300))


@st.composite
def poses(draw: st.DrawFn, message: Obstacle) -> None:
    for part, keys in ((message.pose.position, "xyz"), (message.pose.orientation, "xyzw")):
        for key in keys:
            if draw(st.booleans()):
                setattr(part, key, draw(numbers))


@st.composite
def obstacles(draw: st.DrawFn) -> Obstacle:
    message = Obstacle(id=draw(names), operation=bytes([draw(st.integers(0, 5))]))
    draw(poses(message))
    for _ in range(draw(st.integers(0, 2))):
        kind = draw(st.integers(0, 3))
        if kind == 0:
            dimensions = draw(st.lists(numbers, max_size=3))
            message.primitives.append(SolidPrimitive(type=draw(st.integers(0, 6)), dimensions=dimensions))
        elif kind == 1:
            message.planes.append(Plane(coef=draw(st.lists(numbers, min_size=4, max_size=4))))
        elif kind == 2:
            mesh = Mesh()
            for _ in range(draw(st.integers(0, 5))):
                mesh.vertices.append(type(message.pose.position)(x=draw(numbers), y=draw(numbers), z=draw(numbers)))
            for _ in range(draw(st.integers(0, 5))):
                corners = draw(st.lists(st.integers(0, 6), min_size=3, max_size=3))
                mesh.triangles.append(MeshTriangle(vertex_indices=np.array(corners, dtype=np.uint32)))
            message.meshes.append(mesh)
        else:
            message.point_clouds.append(draw(clouds()))
    return message


@st.composite
def clouds(draw: st.DrawFn) -> PointCloud2:
    fields = [
        PointField(
            name=draw(st.sampled_from("xyzw")), offset=draw(st.integers(0, 40)), datatype=draw(st.integers(0, 9))
        )
        for _ in range(draw(st.integers(0, 4)))
    ]
    if draw(st.booleans()):
        fields = [PointField(name=name, offset=4 * i, datatype=7, count=1) for i, name in enumerate("xyz")]
    cloud = PointCloud2(
        width=draw(st.sampled_from([0, 1, 3, 2**32 - 1])),
        height=draw(st.sampled_from([0, 1, 2**32 - 1])),
        point_step=draw(st.sampled_from([0, 12, 16])),
        row_step=draw(st.sampled_from([0, 12, 36, 48])),
        fields=fields,
        data=draw(st.binary(max_size=64)),
        is_bigendian=draw(st.booleans()),
        is_dense=draw(st.booleans()),
    )
    cloud.header.frame_id = draw(st.sampled_from(["", "world", "camera"]))
    return cloud


@st.composite
def scenes(draw: st.DrawFn) -> ObstacleScene:
    message = scene_to_msg(gap_scene(0.8))
    message.is_diff = draw(st.booleans())
    message.obstacles.extend(draw(st.lists(obstacles(), max_size=3)))
    for point in (message.workspace_min, message.workspace_max):
        if draw(st.integers(0, 4)) == 0:
            point.x = draw(numbers)
    for _ in range(draw(st.integers(0, 2))):
        body = AttachedObstacle(operation=bytes([draw(st.integers(0, 4))]), obstacle=draw(obstacles()))
        body.link_name = draw(names)
        message.attached.append(body)
    for _ in range(draw(st.integers(0, 2))):
        pair = AllowedCollision(first=draw(names), second=draw(names), allowed=draw(st.booleans()))
        message.allowed_collisions.append(pair)
    return message


@settings(max_examples=CASES, deadline=None)
@given(st.lists(scenes(), min_size=1, max_size=3))
def test_scenes(messages: list[ObstacleScene]) -> None:
    keeper = SceneKeeper("world", BOUNDS, "points")
    for message in messages:
        before = keeper.scene
        if refused(lambda: keeper.take_scene(message, SizeLimits())):  # noqa: B023
            assert keeper.scene is before
        else:
            # What the owner accepts the others can read.
            assert keeper.scene is not None
            again = scene_from_msg(scene_to_msg(keeper.scene))
            assert list(again.obstacles) == list(keeper.scene.obstacles)
            assert again.allowed_collisions == keeper.scene.allowed_collisions


@settings(max_examples=CASES, deadline=None)
@given(clouds())
def test_points(message: PointCloud2) -> None:
    keeper = SceneKeeper("world", BOUNDS, "points")
    if refused(lambda: keeper.take_points(message, 0.02, SizeLimits())):
        assert keeper.scene is None


@settings(max_examples=CASES, deadline=None)
@given(st.lists(st.tuples(st.integers(0, len(URDF)), st.integers(0, 12), st.text(max_size=6)), min_size=1, max_size=4))
@example([(0, 0, "a\x00")])
@example([(5, 0, "\ud800")])
@example([(0, 0, "<?xml version='1.0' encoding='nonsense'?>")])
def test_descriptions(cuts: list[tuple[int, int, str]]) -> None:
    text = URDF
    for place, length, insert in cuts:
        text = text[:place] + insert + text[place + length :]
    refused(lambda: load_arm(text))
