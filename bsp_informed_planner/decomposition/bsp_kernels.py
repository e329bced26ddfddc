"""The BSP tree."""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.decomposition.clipping_kernels import (
    BOUNDS_PLANES,
    COPLANAR,
    MINIMUM_AREA,
    ON_PLANE,
    clip,
    polygon_area,
    with_rows,
)


@kernel
def bounding_sphere(corners: Floats, first: int, count: int, spheres: Floats, row: int) -> None:
    """Writes centre and radius of a sphere around a polygon to `spheres[row]`."""
    for k in range(3):
        total = 0.0
        for i in range(first, first + count):
            total += corners[i, k]
        spheres[row, k] = total / count
    largest = 0.0
    for i in range(first, first + count):
        square = 0.0
        for k in range(3):
            square += (corners[i, k] - spheres[row, k]) ** 2
        largest = max(largest, square)
    spheres[row, 3] = math.sqrt(largest) + ON_PLANE


@kernel
def partition_cost(
    planes: Floats,
    plane_index: int,
    members: Indices,
    begin: int,
    end: int,
    corners: Floats,
    first: Indices,
    counts: Indices,
    piece_planes: Indices,
    spheres: Floats,
    split_weight: float,
    imbalance_weight: float,
    offset: float,
    limit: float,
) -> float:
    """Cost of a partition plane for the pieces `members[begin:end]`, or any number of at least `limit` beyond that.

    cost = split_weight * splits + imbalance_weight * |front - back| + offset
    """
    a, b, c, d = (
        planes[plane_index, 0],
        planes[plane_index, 1],
        planes[plane_index, 2],
        planes[plane_index, 3],
    )
    front, back, splits = 0, 0, 0
    cost = offset
    for index in range(begin, end):
        piece = members[index]
        if piece_planes[piece] == plane_index:
            continue
        height = a * spheres[piece, 0] + b * spheres[piece, 1] + c * spheres[piece, 2] - d
        if height > spheres[piece, 3]:
            front += 1
            continue
        if height < -spheres[piece, 3]:
            back += 1
            continue
        highest, lowest = -np.inf, np.inf
        for i in range(first[piece], first[piece] + counts[piece]):
            height = a * corners[i, 0] + b * corners[i, 1] + c * corners[i, 2] - d
            highest = max(highest, height)
            lowest = min(lowest, height)
        if lowest >= -ON_PLANE:
            front += 1
        elif highest <= ON_PLANE:
            back += 1
        else:
            splits += 1
            cost += split_weight
            if cost >= limit:
                return cost
    return cost + imbalance_weight * abs(front - back)


@kernel
def build_tree(
    corners: Floats,
    offsets: Indices,
    facet_planes: Indices,
    facet_areas: Floats,
    planes: Floats,
    split_weight: float,
    imbalance_weight: float,
    area_weight: float,
    coplanar_weight: float,
    maximum_candidates: int,
) -> tuple[Indices, Indices, Indices, int]:
    """Partitions space by planes of facets until no cell has a facet inside.

    At each node the plane of least cost is taken,

        cost = split_weight * splits + imbalance_weight * |front - back|
               - area_weight * (area share of the plane's facets) - coplanar_weight * (number of them),

    counted over the facets in the cell. The last two terms bound the cost from below, so planes that cannot win are
    passed over unseen.

    Args:
        corners: (n, 3) of the facets; offsets: (f + 1,); facet_planes: (f,) indices of `planes`; facet_areas: (f,).
        planes: (p, 4), the first BOUNDS_PLANES of them those of the workspace, whose facets are ignored.
        maximum_candidates: planes examined at a node, at most; an even choice of them if there are more.

    Returns:
        for each node: index of its plane, -1 for a leaf; front child; back child, -1 for a leaf. Children come after
        their parent. And the number of facets that were split.
    """
    pieces = facet_planes.shape[0]
    vertices = corners
    used = corners.shape[0]
    first = offsets[:pieces].copy()
    counts = offsets[1:] - offsets[:pieces]
    piece_planes = facet_planes
    areas = facet_areas
    spheres = np.empty((max(pieces, 1), 4))
    for piece in range(pieces):
        bounding_sphere(vertices, first[piece], counts[piece], spheres, piece)

    node_planes = np.full(64, -1, np.int64)
    node_front = np.full(64, -1, np.int64)
    node_back = np.full(64, -1, np.int64)
    nodes, splits = 1, 0

    # Lists of pieces of the nodes on the stack, one after the other; the last node's list is at the end.
    members = np.empty(max(2 * pieces, 1), np.int64)
    inside = 0
    for piece in range(pieces):
        if facet_planes[piece] >= BOUNDS_PLANES:
            members[inside] = piece
            inside += 1
    behind = np.empty(max(pieces, 1), np.int64)
    stack = np.empty((64, 3), np.int64)  # node, begin and end of its list
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, 0, inside
    height = 1

    plane_count = planes.shape[0]
    seen = np.zeros(plane_count, np.int64)
    share = np.zeros(plane_count)
    present = np.empty(plane_count, np.int64)
    visit = 0

    while height > 0:
        height -= 1
        node, begin, end = stack[height, 0], stack[height, 1], stack[height, 2]
        if begin == end:
            continue

        visit += 1
        distinct, total_area = 0, 0.0
        for index in range(begin, end):
            total_area += areas[members[index]]
        for index in range(begin, end):
            piece = members[index]
            p = piece_planes[piece]
            if seen[p] != visit:
                seen[p] = visit
                share[p] = 0.0
                present[distinct] = p
                distinct += 1
            share[p] -= coplanar_weight + area_weight * areas[piece] / total_area
        promising = present[0]
        for index in range(1, distinct):
            if share[present[index]] < share[promising]:
                promising = present[index]
        best = promising
        best_cost = partition_cost(
            planes, best, members, begin, end, vertices, first, counts, piece_planes, spheres,
            split_weight, imbalance_weight, share[best], np.inf,
        )  # fmt: skip
        stride = max(1, (distinct + maximum_candidates - 1) // maximum_candidates)
        for index in range(0, distinct, stride):
            p = present[index]
            if p == promising or share[p] >= best_cost:
                continue
            cost = partition_cost(
                planes, p, members, begin, end, vertices, first, counts, piece_planes, spheres,
                split_weight, imbalance_weight, share[p], best_cost,
            )  # fmt: skip
            if cost < best_cost:
                best, best_cost = p, cost

        node_planes = with_rows(node_planes, nodes + 2)
        node_front = with_rows(node_front, nodes + 2)
        node_back = with_rows(node_back, nodes + 2)
        node_planes[node] = best
        node_front[node], node_back[node] = nodes, nodes + 1
        for child in (nodes, nodes + 1):
            node_planes[child] = -1
            node_front[child] = -1
            node_back[child] = -1

        fill, behind_count = end, 0
        members = with_rows(members, end + 2 * (end - begin))
        behind = with_rows(behind, end - begin)
        for index in range(begin, end):
            piece = members[index]
            if piece_planes[piece] == best:
                continue
            count = counts[piece]
            distance = -planes[best, 3]
            for k in range(3):
                distance += planes[best, k] * spheres[piece, k]
            if distance > spheres[piece, 3]:
                members[fill] = piece
                fill += 1
                continue
            if distance < -spheres[piece, 3]:
                behind[behind_count] = piece
                behind_count += 1
                continue
            room = count + 1
            if used + 2 * room > vertices.shape[0]:
                vertices = with_rows(vertices, used + 2 * room)
            front_count, back_count = clip(vertices, first[piece], count, planes, best, vertices, used, used + room)
            if front_count == COPLANAR:
                continue
            if back_count == 0:
                members[fill] = piece
                fill += 1
                continue
            if front_count == 0:
                behind[behind_count] = piece
                behind_count += 1
                continue
            splits += 1
            first = with_rows(first, pieces + 2)
            counts = with_rows(counts, pieces + 2)
            piece_planes = with_rows(piece_planes, pieces + 2)
            areas = with_rows(areas, pieces + 2)
            spheres = with_rows(spheres, pieces + 2)
            for in_front in (True, False):
                start = used if in_front else used + room
                length = front_count if in_front else back_count
                area = polygon_area(vertices, start, length)
                if length < 3 or area < MINIMUM_AREA:
                    continue
                first[pieces], counts[pieces] = start, length
                piece_planes[pieces] = piece_planes[piece]
                areas[pieces] = area
                bounding_sphere(vertices, start, length, spheres, pieces)
                if in_front:
                    members[fill] = pieces
                    fill += 1
                else:
                    behind[behind_count] = pieces
                    behind_count += 1
                pieces += 1
            used += 2 * room
        middle = fill
        for index in range(behind_count):
            members[fill] = behind[index]
            fill += 1

        stack = with_rows(stack, height + 2)
        stack[height, 0], stack[height, 1], stack[height, 2] = nodes, end, middle
        stack[height + 1, 0], stack[height + 1, 1], stack[height + 1, 2] = nodes + 1, middle, fill
        height += 2
        nodes += 2
    return node_planes[:nodes].copy(), node_front[:nodes].copy(), node_back[:nodes].copy(), splits


@kernel
def tree_parents(node_front: Indices, node_back: Indices) -> Indices:
    """(n,) parent of each node, -1 for the root."""
    parents = np.full(node_front.shape[0], -1, np.int64)
    for node in range(node_front.shape[0]):
        if node_front[node] >= 0:
            parents[node_front[node]] = node
            parents[node_back[node]] = node
    return parents
