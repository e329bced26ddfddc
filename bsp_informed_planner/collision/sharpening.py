"""Finer covers where links come close to each other."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bsp_informed_planner.collision.body_groups import BodyGroups
from bsp_informed_planner.collision.cover import CoverBuilder, Node
from bsp_informed_planner.collision.solid_kernels import touching_balls
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class SharpeningOptions:
    """How much is done about links whose covers touch where they do not.

    Attributes:
        rounds: times that configurations are tried at most.
        enough: share of undecided configurations at which no further round is begun.
        configurations: tried in each round.
        most_tried: of these that are looked at closely.
        factor: by which protrusions shrink in each round.
        finest: protrusion that is not shrunk further [m].
        most_balls: sharpened in each round, those first that are to blame most often.
        most_leaves: of a group's tree: none of its balls is sharpened after that.
    """

    rounds: int = 5
    enough: float = 0.008
    configurations: int = 6000
    most_tried: int = 150
    factor: float = 0.5
    finest: float = 6e-4
    most_balls: int = 200
    most_leaves: int = 20_000


# Tells which of configurations (m, n), free of self-collision, are left undecided by the covers as they are: (k, n),
# the first ones, at most so many as the second argument says: to judge all takes minutes where meshes are large.
Undecided = Callable[[FloatArray, int], FloatArray]


def sharpen_close_pairs(
    robot: Robot,
    groups: BodyGroups,
    builders: Sequence[CoverBuilder],
    pairs: NDArray[np.int64],
    undecided: Undecided,
    options: SharpeningOptions,
    seed: int = 0,
    on_round: Callable[[], None] = lambda: None,
) -> None:
    """Refine the balls that keep the covers from proving that links are clear of each other.

    Links such as a wrist and the arm that it is mounted on are close in all configurations: a cover that is fine enough
    against obstacles leaves most of their configurations to the exact judge. In random configurations that are free and
    not proved so, balls of two links that touch are to blame, and are covered more finely.

    Args:
        robot: a robot.
        groups: of its bodies.
        builders: of each group's cover; their trees grow.
        pairs: (p, 2) groups that are looked at.
        undecided: see there.
        options: see there.
        seed: of the configurations.
        on_round: called after each round.
    """
    rng = np.random.default_rng(seed)
    data = robot.model.createData()
    enough = int(options.enough * options.configurations)
    for _ in range(options.rounds):
        configurations = rng.uniform(robot.lower, robot.upper, (options.configurations, robot.dof))
        tried = undecided(configurations, max(options.most_tried, enough + 1))
        if len(tried) <= enough:
            break
        tried = tried[: options.most_tried]
        leaves = [builder.leaves() for builder in builders]
        balls = [np.array([leaf.ball for leaf in group]) for group in leaves]
        blame: dict[tuple[int, int], int] = {}
        for configuration in tried:
            pin.forwardKinematics(robot.model, data, configuration)
            placed = [_placed(group, data.oMi[int(joint)]) for group, joint in zip(balls, groups.joints, strict=True)]
            for first, second in pairs:
                centre = placed[second][:, :3].mean(axis=0)
                radius = float((np.linalg.norm(placed[second][:, :3] - centre, axis=1) + placed[second][:, 3]).max())
                for a, b in touching_balls(placed[first], placed[second], centre, radius):
                    for key in ((int(first), int(a)), (int(second), int(b))):
                        blame[key] = blame.get(key, 0) + 1
        counts = [len(group) for group in leaves]
        worst = sorted(blame, key=lambda key: -blame[key])
        done = 0
        for group, index in worst:
            leaf: Node = leaves[group][index]
            if leaf.protrusion <= options.finest or done == options.most_balls or counts[group] >= options.most_leaves:
                continue
            builders[group].sharpen(leaf, max(options.factor * leaf.protrusion, options.finest))
            counts[group] += max(len(leaf.children) - 1, 0)
            done += 1
        logger.debug("%d configurations undecided; %d balls sharpened", len(tried), done)
        on_round()
        if not done:
            break


def _placed(balls: FloatArray, placement: pin.SE3) -> FloatArray:
    placed = balls.copy()
    placed[:, :3] = balls[:, :3] @ placement.rotation.T + placement.translation
    return placed
