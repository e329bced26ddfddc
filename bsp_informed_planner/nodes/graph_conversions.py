"""Decompositions between ROS messages and the library."""

from __future__ import annotations

import numpy as np
from bsp_informed_planner_msgs.msg import KeypointGraph

from bsp_informed_planner.decomposition.decomposition import Decomposition, DecompositionTimings
from bsp_informed_planner.nodes.arrays import float64_field, int32_field, uint32_field
from bsp_informed_planner.nodes.obstacle_conversions import point_to_msg
from bsp_informed_planner.scene.scene import WorkspaceBounds


def graph_to_msg(decomposition: Decomposition, with_edges: bool) -> KeypointGraph:
    """A decomposition as a message; its stamp is left to the caller.

    Args:
        decomposition: of a scene.
        with_edges: list the edges too, which the portals imply.
    """
    message = KeypointGraph(scene_revision=decomposition.scene_revision, dimension=decomposition.dimension)
    message.header.frame_id = decomposition.frame
    message.workspace_min = point_to_msg(decomposition.bounds.lower)
    message.workspace_max = point_to_msg(decomposition.bounds.upper)
    message.node_planes = float64_field(decomposition.node_planes)
    message.node_front = int32_field(decomposition.node_front)
    message.node_back = int32_field(decomposition.node_back)
    message.node_solid = decomposition.node_solid.tolist()
    message.portal_corners = float64_field(decomposition.portal_corners)
    message.portal_offsets = uint32_field(decomposition.portal_offsets)
    message.portal_cells = uint32_field(decomposition.portal_cells)
    message.candidates = float64_field(decomposition.candidates)
    message.candidate_portals = uint32_field(decomposition.candidate_portals)
    message.candidate_clearances = float64_field(decomposition.candidate_clearances)
    message.clearance_cap = float(decomposition.clearance_cap)
    message.edge_count = decomposition.edge_count
    if with_edges:
        message.edges = uint32_field(decomposition.edges().ravel())
    timings = decomposition.timings
    message.scene_seconds = timings.scene_seconds
    message.partition_seconds = timings.partition_seconds
    message.portal_seconds = timings.portal_seconds
    message.graph_seconds = timings.graph_seconds
    return message


def decomposition_from_msg(message: KeypointGraph) -> Decomposition:
    """The decomposition that a message holds."""
    lower, upper = message.workspace_min, message.workspace_max
    return Decomposition(
        dimension=int(message.dimension),
        bounds=WorkspaceBounds(np.array([lower.x, lower.y, lower.z]), np.array([upper.x, upper.y, upper.z])),
        node_planes=np.array(message.node_planes, dtype=np.float64).reshape(-1, 4),
        node_front=np.array(message.node_front, dtype=np.int64),
        node_back=np.array(message.node_back, dtype=np.int64),
        node_solid=np.array(message.node_solid, dtype=np.bool_),
        portal_corners=np.array(message.portal_corners, dtype=np.float64).reshape(-1, 3),
        portal_offsets=np.array(message.portal_offsets, dtype=np.int64),
        portal_cells=np.array(message.portal_cells, dtype=np.int64).reshape(-1, 2),
        candidates=np.array(message.candidates, dtype=np.float64).reshape(-1, 3),
        candidate_portals=np.array(message.candidate_portals, dtype=np.int64),
        candidate_clearances=np.array(message.candidate_clearances, dtype=np.float64),
        clearance_cap=float(message.clearance_cap),
        frame=message.header.frame_id,
        scene_revision=int(message.scene_revision),
        timings=DecompositionTimings(
            scene_seconds=message.scene_seconds,
            partition_seconds=message.partition_seconds,
            portal_seconds=message.portal_seconds,
            graph_seconds=message.graph_seconds,
        ),
    )
