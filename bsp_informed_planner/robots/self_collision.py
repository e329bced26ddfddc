"""Which links of a robot collide with each other: always, never or sometimes; and an SRDF that says so.

As MoveIt's setup assistant does it (S. Chitta, I. Sucan, S. Cousins, "MoveIt!", IEEE Robotics & Automation Magazine
19(1), 2012), by random configurations. What never collided among uniform ones is tried again with joints at their
limits, where arms fold: a pair that is left out of checking by mistake is a collision that nobody sees.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
import pinocchio as pin

from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.description import LinkPair, XmlSource, read_xml
from bsp_informed_planner.scene.pose import FloatArray

# A pair that collides in so large a share of configurations is a fault of the models, not of the configurations.
ALWAYS_SHARE = 0.95
# Of the samples that try what never collided: how likely each joint is to stand at a limit.
AT_LIMIT = 0.3


class PairKind(str, Enum):
    """What two links do. The values are the reasons in an SRDF."""

    ADJACENT = "Adjacent"  # a joint connects them
    FIXED = "Fixed"  # they cannot move relative to each other
    ALWAYS = "Always"
    NEVER = "Never"
    SOMETIMES = "Sometimes"


@dataclass(frozen=True)
class PairReport:
    """Two links that have geometry.

    Attributes:
        links: their names, sorted.
        kind: what they do.
        share: of uniform configurations in which they collide, in [0, 1].
        at_zero: whether they collide in the configuration of zeros, or what of it the limits allow.
        exempt: whether the SRDF exempts them from checking.
    """

    links: tuple[str, str]
    kind: PairKind
    share: float
    at_zero: bool
    exempt: bool


@dataclass(frozen=True)
class SelfCollisionReport:
    """All pairs of links.

    Attributes:
        pairs: sorted by their links.
        samples: how many uniform configurations the shares are of.
        free_share: of them in which no pair collides that is checked as things are.
        proposed_free_share: the same with the SRDF that is proposed.
    """

    pairs: tuple[PairReport, ...]
    samples: int
    free_share: float
    proposed_free_share: float

    def of_kind(self, kind: PairKind) -> tuple[PairReport, ...]:
        """The pairs of a kind."""
        return tuple(pair for pair in self.pairs if pair.kind is kind)


def sample_self_collisions(
    robot: ArmRobot,
    samples: int,
    rng: np.random.Generator,
    on_progress: Callable[[int, int], None] | None = None,
) -> SelfCollisionReport:
    """Check all pairs of links that can move relative to each other, those that the SRDF exempts too.

    Links that a joint connects are not looked at: they touch where the joint is, whatever else they do.

    Args:
        robot: the arm.
        samples: uniform configurations within the limits; half as many more with joints at their limits.
        rng: generator.
        on_progress: told how many configurations of how many are done.
    """
    model = robot.model
    geometry = robot.collision_model.copy()
    geometry.removeAllCollisionPairs()
    objects = list(geometry.geometryObjects)
    links_of_pairs: list[LinkPair] = []
    exempt, adjacent = robot.description.disabled_pairs, robot.description.adjacent_links
    unsampled: dict[LinkPair, PairKind] = {}
    for second in range(len(objects)):
        for first in range(second):
            links = frozenset(model.frames[objects[k].parentFrame].name for k in (first, second))
            if len(links) == 1:
                continue
            if objects[first].parentJoint == objects[second].parentJoint:
                unsampled[links] = PairKind.FIXED
            elif links in adjacent:
                unsampled[links] = PairKind.ADJACENT
            else:
                geometry.addCollisionPair(pin.CollisionPair(first, second))
                links_of_pairs.append(links)
    names = sorted(set(links_of_pairs), key=sorted)
    columns = np.array([names.index(links) for links in links_of_pairs], dtype=np.int64)
    colliding = _PairCollisions(model, geometry, columns, len(names))

    zero = np.clip(np.zeros(robot.dof), robot.lower, robot.upper)
    at_zero = colliding.of(zero)
    uniform = rng.uniform(robot.lower, robot.upper, (samples, robot.dof))
    folded = rng.uniform(robot.lower, robot.upper, (samples // 2, robot.dof))
    at_limit = rng.random(folded.shape) < AT_LIMIT
    folded = np.where(at_limit, np.where(rng.random(folded.shape) < 0.5, robot.lower, robot.upper), folded)
    hits = np.zeros((samples, len(names)), dtype=bool)
    ever = at_zero.copy()
    total = samples + len(folded)
    for done, configuration in enumerate((*uniform, *folded), start=1):
        found = colliding.of(configuration)
        ever |= found
        if done <= samples:
            hits[done - 1] = found
        if on_progress is not None and (done % 100 == 0 or done == total):
            on_progress(done, total)

    shares = hits.mean(axis=0) if samples else at_zero.astype(np.float64)
    pairs = []
    for index, links in enumerate(names):
        kind = PairKind.SOMETIMES
        if shares[index] >= ALWAYS_SHARE:
            kind = PairKind.ALWAYS
        elif not ever[index]:
            kind = PairKind.NEVER
        pairs.append(_report(links, kind, float(shares[index]), bool(at_zero[index]), links in exempt))
    pairs += [_report(links, kind, 0.0, False, links in exempt) for links, kind in unsampled.items()]
    checked = np.array([links not in exempt for links in names], dtype=bool)
    kept = checked & np.array([pair.kind is PairKind.SOMETIMES for pair in pairs[: len(names)]], dtype=bool)
    return SelfCollisionReport(
        pairs=tuple(sorted(pairs, key=lambda pair: pair.links)),
        samples=samples,
        free_share=float(1.0 - hits[:, checked].any(axis=1).mean()) if samples else 1.0,
        proposed_free_share=float(1.0 - hits[:, kept].any(axis=1).mean()) if samples else 1.0,
    )


class _PairCollisions:
    """Which pairs of links collide in a configuration: as the exact checker finds it, but all of them."""

    def __init__(self, model: pin.Model, geometry: pin.GeometryModel, columns: np.ndarray, count: int) -> None:
        self._model, self._geometry = model, geometry
        self._columns, self._count = columns, count
        self._data, self._geometry_data = model.createData(), geometry.createData()
        for request in self._geometry_data.collisionRequests:
            request.enable_contact = True  # without it coal overlooks overlaps of aligned primitives
        pairs = np.array([(pair.first, pair.second) for pair in geometry.collisionPairs], dtype=np.int64).reshape(-1, 2)
        self._first, self._second = pairs[:, 0], pairs[:, 1]
        objects = list(geometry.geometryObjects)
        for item in objects:
            item.geometry.computeLocalAABB()
        self._centres = np.array([item.geometry.aabb_center for item in objects]).reshape(-1, 3)
        self._radii = np.array([item.geometry.aabb_radius for item in objects])

    def of(self, configuration: FloatArray) -> np.ndarray:
        """(count,) whether each pair of links collides."""
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, configuration)
        centres = np.array(
            [place.act(centre) for place, centre in zip(self._geometry_data.oMg, self._centres, strict=True)]
        ).reshape(-1, 3)
        # Balls that do not touch save most of the work.
        distances = np.linalg.norm(centres[self._first] - centres[self._second], axis=1)
        found = np.zeros(self._count, dtype=bool)
        for pair in np.flatnonzero(distances <= self._radii[self._first] + self._radii[self._second]).tolist():
            column = self._columns[pair]
            found[column] = found[column] or pin.computeCollision(self._geometry, self._geometry_data, pair)
        return found


def _report(links: LinkPair, kind: PairKind, share: float, at_zero: bool, exempt: bool) -> PairReport:
    first, second = sorted(links)
    return PairReport((first, second), kind, share, at_zero, exempt)


def proposed_srdf(robot: ArmRobot, report: SelfCollisionReport, srdf: XmlSource | None = None) -> str:
    """An SRDF that exempts all pairs but those that collide sometimes.

    Pairs that collide in the zero configuration and not always are not exempt, other than in MoveIt's assistant: that
    contact may be real. Held joints count as fixed: a gripper whose fingers are held keeps only what holds for that.

    Args:
        robot: the arm.
        report: of `sample_self_collisions`.
        srdf: the arm's own, whose content is kept; its pairs stay as they are.

    Returns:
        the XML.

    Raises:
        RobotDescriptionError: if `srdf` is none.
    """
    if srdf is not None:
        root = read_xml(srdf, "SRDF")[0]
    else:
        root = ElementTree.Element("robot", name=robot.name)
        group = ElementTree.SubElement(root, "group", name="arm")
        ElementTree.SubElement(group, "chain", base_link=robot.root_frame, tip_link=robot.tool_frame)
    for pair in report.pairs:
        if pair.kind is not PairKind.SOMETIMES and not pair.exempt:
            first, second = pair.links
            ElementTree.SubElement(root, "disable_collisions", link1=first, link2=second, reason=pair.kind.value)
    ElementTree.indent(root, "  ")
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
