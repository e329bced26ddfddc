"""Layers of configurations over keypoints, and paths through them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import KeypointGuideOptions
from bsp_informed_planner.sampling.layer_kernels import shortest_through_layers, wind_rows
from bsp_informed_planner.sampling.orientation_kernels import matrices_at, tool_quaternions
from bsp_informed_planner.scene.pose import FloatArray


def tool_orientations(
    start: FloatArray, goal: FloatArray, normal: FloatArray, fraction: float, options: KeypointGuideOptions
) -> FloatArray:
    """Orientations in which the tool may pass a keypoint.

    The goal's own; tilts of it about both lateral axes; rolls about its approach axis z; the rotation on the way from
    start to goal; and the goal's, its approach axis turned onto the normal of the portal.

    Args:
        start, goal: quaternions (4,) of the tool at both ends.
        normal: (3,) unit normal of the portal, either way.
        fraction: how far along the chain the keypoint lies, in [0, 1].
        options: which tilts and rolls.

    Returns:
        (k, 4) quaternions, the goal's first.
    """
    tilts, rolls = np.array(options.tilts, dtype=np.float64), np.array(options.rolls, dtype=np.float64)
    return tool_quaternions(np.array(start), np.array(goal), np.array(normal), float(fraction), tilts, rolls)


def keypoint_layer(
    robot: Robot,
    checker: CollisionChecker,
    point: FloatArray,
    orientations: FloatArray,
    guess: FloatArray,
    options: KeypointGuideOptions,
) -> FloatArray:
    """Collision-free configurations with the reference point of the robot at a keypoint.

    All branches of the inverse kinematics in all orientations, wound as near as possible to a guess; the nearest ones
    that are surely free are kept, and if none is, free ones among the nearest.

    Args:
        robot: gives the inverse kinematics.
        checker: tells which are free.
        point: (3,) keypoint in the root frame [m].
        orientations: (k, 4) quaternions of the tool to try.
        guess: (n,) configuration that the layer should lie close to.
        options: how many configurations to keep, and to check exactly.

    Returns:
        (k, n) with 0 <= k <= `layer_size`.
    """
    poses = matrices_at(np.array(point, dtype=np.float64), np.array(orientations, dtype=np.float64))
    candidates = np.concatenate(robot.inverse_kinematics_batch(poses))
    if not len(candidates):
        return candidates
    wound = nearest_windings(robot, candidates, guess)
    wound = wound[np.argsort(np.linalg.norm(wound - guess, axis=1))]
    kept, layer_size = np.empty((0, robot.dof)), options.layer_size
    # A few at a time: mostly the nearest are enough.
    for begin in range(0, len(wound), 2 * layer_size):
        some = wound[begin : begin + 2 * layer_size]
        kept = np.concatenate((kept, some[checker.surely_free(some)]))
        if len(kept) >= layer_size:
            return kept[:layer_size]
    if not len(kept):
        kept = _exactly_free(wound, checker, options.exact_checks)
    return kept


def _exactly_free(configurations: FloatArray, checker: CollisionChecker, most: int) -> FloatArray:
    """The free ones of configurations (k, n); so many are given to the exact check at most, the first ones."""
    free = np.zeros(len(configurations), dtype=np.bool_)
    before = checker.checks
    for index, configuration in enumerate(configurations):
        free[index] = checker.is_free(configuration)
        if checker.checks - before >= most:
            break
    return configurations[free]


def nearest_windings(robot: Robot, configurations: FloatArray, guess: FloatArray) -> FloatArray:
    """Configurations (k, n), each moved by whole turns of its revolute joints towards a guess (n,), within limits."""
    return wind_rows(configurations, guess, robot.lower, robot.upper, robot.revolute)


@dataclass(frozen=True, eq=False)
class LayerPath:
    """A path through layers.

    Attributes:
        configurations: (m, n) start, one configuration of each layer, goal.
        is_free: whether all of its edges are known to be free.
        length: joint-space length.
    """

    configurations: FloatArray
    is_free: bool
    length: float


def paths_through_layers(
    robot: Robot,
    start: FloatArray,
    layers: list[FloatArray],
    goals: FloatArray,
    is_edge_free: Callable[[FloatArray, FloatArray], bool],
    options: KeypointGuideOptions,
    should_stop: Callable[[], bool],
) -> list[LayerPath]:
    """Shortest paths through layers, by dynamic programming, again and again around edges found in collision.

    One configuration is chosen for each keypoint, consistently along the whole chain: branches are never averaged.
    Angles are unwound along the chain. Edges are only checked once they lie on a shortest path (Bohlin and Kavraki,
    Lazy PRM, 2000); one in collision stays, with a penalty, since a planner may still find a way around.

    Args:
        robot: gives limits and which joints turn.
        start: (n,).
        layers: each (k_i, n), k_i >= 1.
        goals: (g, n), taken as they are.
        is_edge_free: exact check of an edge.
        options: number of repairs, penalty, number of chains.
        should_stop: ends the repairs.

    Returns:
        At least one path; those that are free first, then by length.
    """
    checked: dict[tuple[bytes, bytes], bool] = {}
    blocked: list[tuple[FloatArray, FloatArray]] = []
    found: dict[bytes, LayerPath] = {}
    nodes = np.concatenate([*layers, goals])
    begins = np.cumsum([0, *(len(layer) for layer in layers), len(goals)])
    limits = robot.lower, robot.upper, robot.revolute

    for _ in range(options.repairs):
        avoided = np.array(blocked).reshape(-1, 2, len(start))
        chain = shortest_through_layers(start, nodes, begins, *limits, avoided, options.blocked_penalty)
        key = chain.tobytes()
        if key in found:
            break
        free = True
        for a, b in zip(chain[:-1], chain[1:], strict=True):
            edge = (a.tobytes(), b.tobytes())
            if edge not in checked:
                checked[edge] = is_edge_free(a, b)
                if not checked[edge]:
                    blocked.append((a, b))
            free = free and checked[edge]
        found[key] = LayerPath(chain, free, float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum()))
        if free or should_stop():
            break
    return sorted(found.values(), key=lambda path: (not path.is_free, path.length))[: options.chain_count]
