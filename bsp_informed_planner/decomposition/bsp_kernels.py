"""The BSP tree."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.decomposition.clipping_kernels import (
    COPLANAR,
    MINIMUM_AREA,
    ON_PLANE,
    bounding_sphere,
    clip,
    polygon_area,
    with_rows,
)
from bsp_informed_planner.decomposition.fate_kernels import KEPT, REPLACED, facets_to_partition


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


@kernel(inline="always")
def cheapest_partition(
    planes: Floats,
    members: Indices,
    begin: int,
    end: int,
    corners: Floats,
    first: Indices,
    counts: Indices,
    piece_planes: Indices,
    areas: Floats,
    spheres: Floats,
    split_weight: float,
    imbalance_weight: float,
    area_weight: float,
    coplanar_weight: float,
    maximum_candidates: int,
    visit: int,
    seen: Indices,
    share: Floats,
    present: Indices,
) -> int:
    """The plane of least cost for the pieces `members[begin:end]`, of which there is at least one; see `build_tree`.

    Args:
        visit: a number that no earlier call with the same buffers had.
        seen, share, present: buffers (p,), the first of them zeros before the first call.
    """
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
        planes, best, members, begin, end, corners, first, counts, piece_planes, spheres,
        split_weight, imbalance_weight, share[best], np.inf,
    )  # fmt: skip
    stride = max(1, (distinct + maximum_candidates - 1) // maximum_candidates)
    for index in range(0, distinct, stride):
        p = present[index]
        if p == promising or share[p] >= best_cost:
            continue
        cost = partition_cost(
            planes, p, members, begin, end, corners, first, counts, piece_planes, spheres,
            split_weight, imbalance_weight, share[p], best_cost,
        )  # fmt: skip
        if cost < best_cost:
            best, best_cost = p, cost
    return best


@kernel
def build_tree(
    corners: Floats,
    offsets: Indices,
    facet_planes: Indices,
    facet_areas: Floats,
    facet_spheres: Floats,
    planes: Floats,
    old_planes: Indices,
    old_front: Indices,
    old_back: Indices,
    fates: Indices,
    split_weight: float,
    imbalance_weight: float,
    area_weight: float,
    coplanar_weight: float,
    maximum_candidates: int,
) -> tuple[Indices, Floats, Indices, Indices, Indices, int]:
    """Partitions space by planes of facets until no cell has a facet inside, with parts of a former tree.

    At each node that is not taken from the former tree the plane of least cost is taken,

        cost = split_weight * splits + imbalance_weight * |front - back|
               - area_weight * (area share of the plane's facets) - coplanar_weight * (number of them),

    counted over the facets in the cell. The last two terms bound the cost from below, so planes that cannot win are
    passed over unseen.

    Args:
        corners: (n, 3) of the facets; offsets: (f + 1,); facet_planes: (f,) indices of `planes`; facet_areas: (f,);
            facet_spheres: (f, 4), see `bounding_sphere`.
        planes: (p, 4), the first BOUNDS_PLANES of them those of the workspace, whose facets are ignored.
        old_planes, old_front, old_back: (m,) the former tree, as returned; a single leaf if there is none.
        fates: (m,) REPLACED, ENTERED or KEPT for its nodes; what is below a node that is not ENTERED has the same fate.
            Facets do not go into what is KEPT.
        maximum_candidates: planes examined at a node, at most; an even choice of them if there are more.

    Returns:
        for each node: index of its plane, -1 for a leaf; that plane, zeros for a leaf; front child; back child, -1 for
        a leaf. Children come after their parent. For each node of the former tree its new number, -1 if it is gone.
        And the number of facets that were split.
    """
    pieces = facet_planes.shape[0]
    vertices = corners
    used = corners.shape[0]
    first = offsets[:pieces].copy()
    counts = offsets[1:] - offsets[:pieces]
    piece_planes = facet_planes
    areas = facet_areas
    spheres = facet_spheres

    # What is left of the former tree comes first, in the same order.
    old_nodes = old_front.shape[0]
    new_numbers = np.full(old_nodes, -1, np.int64)
    node_planes = np.full(old_nodes + 64, -1, np.int64)
    node_front = np.full(old_nodes + 64, -1, np.int64)
    node_back = np.full(old_nodes + 64, -1, np.int64)
    new_numbers[0] = 0
    nodes, splits = 1, 0
    for old in range(old_nodes):
        node = new_numbers[old]
        if node >= 0 and fates[old] != REPLACED and old_front[old] >= 0:
            new_numbers[old_front[old]], new_numbers[old_back[old]] = nodes, nodes + 1
            node_front[node], node_back[node] = nodes, nodes + 1
            node_planes[node] = old_planes[old]
            nodes += 2

    # Lists of pieces of the nodes on the stack, one after the other; the last node's list is at the end.
    members = np.empty(max(2 * pieces, 1), np.int64)
    inside = facets_to_partition(
        corners, offsets, facet_planes, facet_spheres, planes, old_planes, old_front, old_back, fates, members
    )
    behind = np.empty(max(pieces, 1), np.int64)
    stack = np.empty((64, 4), np.int64)  # node, begin and end of its list, the former node if there is one
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, 0, inside, 0
    height = 0 if fates[0] == KEPT else 1

    plane_count = planes.shape[0]
    seen = np.zeros(plane_count, np.int64)
    share = np.empty(plane_count)
    present = np.empty(plane_count, np.int64)
    visit = 0

    while height > 0:
        height -= 1
        node, begin, end, old = stack[height, 0], stack[height, 1], stack[height, 2], stack[height, 3]
        front_old, back_old, to_front, to_back = -1, -1, True, True
        if old < 0 or fates[old] == REPLACED:
            if begin == end:
                continue
            visit += 1
            best = cheapest_partition(
                planes, members, begin, end, vertices, first, counts, piece_planes, areas, spheres,
                split_weight, imbalance_weight, area_weight, coplanar_weight, maximum_candidates,
                visit, seen, share, present,
            )  # fmt: skip
            node_planes = with_rows(node_planes, nodes + 2)
            node_front = with_rows(node_front, nodes + 2)
            node_back = with_rows(node_back, nodes + 2)
            node_planes[node] = best
            node_front[node], node_back[node] = nodes, nodes + 1
            for child in (nodes, nodes + 1):
                node_planes[child] = -1
                node_front[child] = -1
                node_back[child] = -1
            nodes += 2
        else:
            best, front_old, back_old = old_planes[old], old_front[old], old_back[old]
            to_front, to_back = fates[front_old] != KEPT, fates[back_old] != KEPT

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
                if to_front:
                    members[fill] = piece
                    fill += 1
                continue
            if distance < -spheres[piece, 3]:
                if to_back:
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
                if to_front:
                    members[fill] = piece
                    fill += 1
                continue
            if front_count == 0:
                if to_back:
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
                if not (to_front if in_front else to_back):
                    continue
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
        # A list that nobody reads is empty.
        if to_front:
            stack[height, 0], stack[height, 1], stack[height, 2] = node_front[node], end, middle
            stack[height, 3] = front_old
            height += 1
        if to_back:
            stack[height, 0], stack[height, 1], stack[height, 2] = node_back[node], middle, fill
            stack[height, 3] = back_old
            height += 1
    for old in range(old_nodes):
        if fates[old] == REPLACED:
            new_numbers[old] = -1
    partitions = np.zeros((nodes, 4))
    for node in range(nodes):
        if node_front[node] >= 0:
            for k in range(4):
                partitions[node, k] = planes[node_planes[node], k]
    return (
        node_planes[:nodes].copy(), partitions, node_front[:nodes].copy(), node_back[:nodes].copy(), new_numbers, splits
    )  # fmt: skip


@kernel
def tree_parents(node_front: Indices, node_back: Indices) -> Indices:
    """(n,) parent of each node, -1 for the root."""
    parents = np.full(node_front.shape[0], -1, np.int64)
    for node in range(node_front.shape[0]):
        if node_front[node] >= 0:
            parents[node_front[node]] = node
            parents[node_back[node]] = node
    return parents
