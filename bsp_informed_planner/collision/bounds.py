"""Conservative collision bounds of a robot: proved spheres around and inside its bodies, ready for the kernels."""

from __future__ import annotations

import itertools
import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from weakref import ReferenceType, WeakKeyDictionary, WeakValueDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bsp_informed_planner.collision.allowed_contacts import allowed_contacts
from bsp_informed_planner.collision.body_groups import BodyGroups, group_bodies
from bsp_informed_planner.collision.check_arrays_kernels import (
    FRAME_ROWS,
    LANES,
    SPHERE_ROWS,
    STRIDE,
    Chain,
    Checks,
    RobotBounds,
    Scratch,
    SphereTree,
)
from bsp_informed_planner.collision.clear_pairs import BEYOND_LIMITS, find_clear_pairs
from bsp_informed_planner.collision.cover import CoverOptions, RobotCovers
from bsp_informed_planner.collision.cover_files import cover_key, load_covers, save_covers
from bsp_informed_planner.collision.cover_kernels import enclosing_ball
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.group_covers import HELD_OPTIONS, builder_of
from bsp_informed_planner.collision.holding import HoldingRobot
from bsp_informed_planner.collision.obstacle_arrays import pack_obstacles
from bsp_informed_planner.collision.sharpening import SharpeningOptions, sharpen_close_pairs
from bsp_informed_planner.collision.verdict_calls_kernels import UNDECIDED
from bsp_informed_planner.collision.verdicts import Verdicts
from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.robots.motion_bound import axis_distances, joint_axes
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds

logger = logging.getLogger(__name__)

#: Intervals of an edge in which no point moves further than this are not halved [m].
FINEST = 2e-4
# Half the distance between 1 and the next number in single precision.
_ROUNDING = 2.0**-24
# Added to inner radii, and taken from obstacles' cores [m].
_ROOM = 1e-6
_STACK, _INTERVALS = 4096, 512

# Is told how many steps are done, of how many; what it raises ends the work.
Progress = Callable[[int, int], None]


class CollisionBounds:
    """Spheres that cover a robot's bodies, and spheres inside of them, in every scene.

    Rounding. The kernels compute in single precision (unit roundoff u = 2^-24), in any order of sums. A joint's
    rotation is the product of its parent's, a constant one, and one by sine and cosine. Entries are sums of three
    products: an error of at most 4 u each, 7 u for a column as a whole; sine and cosine come from Taylor polynomials
    with remainders below 6e-8 and roundings of at most 6 u. So a joint adds at most 24 u to the error of a rotation
    (in the norm), and n joints 24 n u. The error of a point that is L away along the chain is at most the sum over
    joints of rotation error times offset, plus the roundings of the offsets' sums, 4 u L each: 28 n u L. Radii are
    enlarged (inner ones: reduced) by 48 (n + 2) u L, where L bounds the distance of any point of the robot from the
    root in all configurations; that is 24 um for an arm of six joints and 1 m. Differences to obstacles, all of whose
    numbers are below L after `pack_obstacles`, add less than 64 u L, which goes into the margin against obstacles.

    Immutable; threads may share it. Use `bounds_of`.

    Attributes:
        robot: whose bounds they are.
        groups, covers: of its bodies.
        arrays: for the kernels.
        reach: no point of the robot is further from the root frame's origin, in any configuration [m].
    """

    def __init__(self, robot: Robot, groups: BodyGroups, robot_covers: RobotCovers) -> None:
        """
        Args:
            robot: a robot.
            groups: of its bodies.
            robot_covers: of the groups.
        """
        self.robot = robot
        self.groups = groups
        self.covers = robot_covers
        covers = robot_covers.covers
        model = robot.model
        axes, prismatic = joint_axes(model)
        turns = _turned_frames(axes)
        count = model.njoints - 1
        placements = np.zeros((count, 12))
        for joint in range(1, count + 1):
            parent = int(model.parents[joint])
            placement = model.jointPlacements[joint]
            placements[joint - 1, :9] = (turns[parent].T @ placement.rotation @ turns[joint]).ravel()
            placements[joint - 1, 9:] = turns[parent].T @ placement.translation
        chain = Chain(
            np.array([int(model.parents[joint]) for joint in range(1, count + 1)], dtype=np.int64),
            np.array([model.joints[joint].idx_v for joint in range(1, count + 1)], dtype=np.int64),
            prismatic.astype(np.int64),
            placements.astype(np.float32),
        )
        levers = np.zeros((len(covers), count))
        reach = 0.0
        for group, cover in enumerate(covers):
            joint = int(groups.joints[group])
            far = float((np.linalg.norm(cover.outer[:, :3], axis=1) + cover.outer[:, 3]).max())
            reach = max(reach, far + _chain_length(model, prismatic, joint))
            if joint > 0:
                centres = np.concatenate([cover.outer[:, :3], cover.inner[:, :3]])
                distances = axis_distances(model, axes, prismatic, joint, centres)
                # Rounded up, never zero where a joint moves the group, and with room for slides beyond the limits.
                movers = _movers(model, joint)
                beyond = BEYOND_LIMITS * np.count_nonzero(prismatic)
                levers[group, movers] = np.maximum(distances[movers] * (1.0 + 1e-6) + beyond, 1e-6)
        self.reach = reach
        rounding = self._rounding = 48.0 * (count + 2) * _ROUNDING * reach
        self.arrays = RobotBounds(
            chain=chain,
            outer=_tree([(cover.outer, cover.ends) for cover in covers], groups, turns, rounding),
            inner=_tree([_flat_tree(cover.inner) for cover in covers], groups, turns, -rounding),
            joints=groups.joints,
            exposed=(groups.joints > 0).astype(np.int64),
            pairs=_without(groups.pairs, robot_covers.clear_pairs),
            lower=robot.lower - BEYOND_LIMITS,
            upper=robot.upper + BEYOND_LIMITS,
            levers=levers.astype(np.float32),
        )

    def checks(self, scene: Scene, padding: float = 0.0, finest: float = FINEST) -> Checks:
        """What the kernels take, for one thread.

        Args:
            scene: obstacles in the robot's root frame, and what may touch them.
            padding: distance that bodies have to keep from obstacles, but not from each other [m].
            finest: intervals of an edge in which no point moves further than this are not halved [m].

        Raises:
            InvalidObstacleError: if a shape of an obstacle has no volume.
            InvalidOptionError: if the padding is negative, or `finest` is not positive.
        """
        if not 0.0 <= padding < math.inf:
            raise InvalidOptionError("padding", padding, "a distance of at least 0 m")
        if not 0.0 < finest < math.inf:
            raise InvalidOptionError("finest", finest, "a positive distance [m]")
        reach = self.reach + padding + 0.01
        rounding = 64.0 * _ROUNDING * reach
        contacts = allowed_contacts(self.robot, self.groups, scene)
        # Inner radii lack the rounding of the robot's places: here it is the cores that bear it, since a robot may be a
        # point. A little more than nothing is added, for a point touches only what is closer than its radius.
        return Checks(
            self.arrays,
            pack_obstacles(scene, reach, self._rounding + rounding + _ROOM, contacts),
            padding + rounding,
            padding + self._rounding + _ROOM,
            finest,
            np.array(self.robot.motion_radii, dtype=np.float64),
            self._scratch(),
        )

    def for_thread(self, checks: Checks) -> Checks:
        """The same checks for another thread."""
        return checks._replace(scratch=self._scratch())

    def _scratch(self) -> Scratch:
        joints, groups = len(self.arrays.chain.parents), len(self.arrays.joints)
        outer, inner = len(self.arrays.outer.spheres), len(self.arrays.inner.spheres)

        def singles(*shape: int) -> np.ndarray:
            return np.zeros(shape, dtype=np.float32)

        return Scratch(
            values=singles(joints, LANES),
            frames=singles(joints + 1, FRAME_ROWS * STRIDE),
            turning=singles((FRAME_ROWS + 3) * STRIDE),
            outer=singles(outer, SPHERE_ROWS * STRIDE),
            inner=singles(inner, SPHERE_ROWS * STRIDE),
            outer_ages=np.zeros(outer, dtype=np.int64),
            inner_ages=np.zeros(inner, dtype=np.int64),
            clock=np.zeros(1, dtype=np.int64),
            slack=singles(groups),
            bend=singles(groups),
            accelerations=singles(groups),
            open=np.zeros(LANES, dtype=np.int32),
            asked=np.zeros(LANES, dtype=np.int32),
            stuck=np.zeros(LANES, dtype=np.int32),
            lane=np.eye(LANES, dtype=np.int32),
            hits=np.zeros(LANES, dtype=np.int32),
            stack=np.zeros((_STACK, 2), dtype=np.int64),
            intervals=np.zeros((_INTERVALS, 2)),
            step=np.zeros(self.robot.dof),
            turned=singles(joints),
        )


# Robots whose bounds are kept in memory though nobody uses them at the moment. Those of a robot that holds something
# live as long as a planner has them: it is another robot each time, and its bounds may take megabytes.
_MOST_KEPT = 8
# All of these are looked at under `_guard`, which nobody holds for long. Covers of one key are built once at a time.
_guard = threading.Lock()
_known: WeakKeyDictionary[Robot, ReferenceType[CollisionBounds]] = WeakKeyDictionary()
_kept: deque[CollisionBounds] = deque(maxlen=_MOST_KEPT)
_keys: WeakKeyDictionary[Robot, str] = WeakKeyDictionary()
_building: WeakValueDictionary[str, threading.Lock] = WeakValueDictionary()


def bounds_of(robot: Robot, progress: Progress | None = None) -> CollisionBounds:
    """The bounds of a robot: those made before, from a file, or else built and kept in the user's cache.

    If it holds something (`robot_in_scene`), only the groups of what it holds are new, and those that bodies which may
    touch come out of: a tenth of a second for a box of 0.1 m, more for what is larger, or a mesh.

    Building takes 20 to 50 s for an arm, once, as `bsp-planner benchmark collision` measures; it is logged. Other
    threads get the bounds of other robots meanwhile.

    Args:
        robot: a robot.
        progress: see `build_covers`.
    """
    bounds = bounds_at_hand(robot)
    if bounds is not None:
        return bounds
    key = bounds_key(robot)
    with _guard:
        lock = _building.get(key)
        if lock is None:
            lock = _building[key] = threading.Lock()
    with lock:
        # Another thread may have built them meanwhile.
        return bounds_at_hand(robot) or _remember(robot, _built_covers(robot, key, progress))


def bounds_at_hand(robot: Robot) -> CollisionBounds | None:
    """The bounds of a robot, made before or from a file; None if they have to be built. Takes a tenth of a second."""
    with _guard:
        bounds = _still_known(robot)
    if bounds is None:
        covers = load_covers(bounds_key(robot))
        if covers is not None:
            bounds = _remember(robot, covers)
    return bounds


def bounds_key(robot: Robot) -> str:
    """Robots of the same key have the same bounds; see `cover_key`."""
    with _guard:
        key = _keys.get(robot)
    if key is None:
        options = HELD_OPTIONS if isinstance(robot, HoldingRobot) else CoverOptions()
        key = cover_key(robot, options, SharpeningOptions())
        with _guard:
            _keys[robot] = key
    return key


def _remember(robot: Robot, covers: RobotCovers) -> CollisionBounds:
    bounds = CollisionBounds(robot, group_bodies(robot.collision_model), covers)
    with _guard:
        known = _still_known(robot)
        if known is not None:
            return known
        _known[robot] = ReferenceType(bounds)
        if not isinstance(robot, HoldingRobot):
            _kept.append(bounds)
        return bounds


def _still_known(robot: Robot) -> CollisionBounds | None:
    reference = _known.get(robot)
    return None if reference is None else reference()


def _built_covers(robot: Robot, key: str, progress: Progress | None) -> RobotCovers:
    logger.info("building the collision bounds of %s", robot.name)
    begin = time.perf_counter()
    if isinstance(robot, HoldingRobot):
        covers = _extended(bounds_of(robot.bare, progress), robot)
    else:
        covers = build_covers(robot, progress=progress)
    logger.info("collision bounds of %s built in %.1f s", robot.name, time.perf_counter() - begin)
    save_covers(key, covers)
    return covers


def _extended(base: CollisionBounds, robot: Robot) -> RobotCovers:
    """Covers of a robot that holds something: what it has in common with the bare one is known."""
    places = {members: place for place, members in enumerate(base.groups.members)}
    groups = group_bodies(robot.collision_model)
    covers = []
    for members in groups.members:
        if members in places:
            covers.append(base.covers.covers[places[members]])
        else:
            builder = builder_of(robot, members)
            builder.build()
            covers.append(builder.cover())
    known = {frozenset(base.groups.members[group] for group in pair) for pair in base.covers.clear_pairs.tolist()}
    clear = [pair for pair in groups.pairs.tolist() if frozenset(groups.members[group] for group in pair) in known]
    return RobotCovers(tuple(covers), np.array(clear, dtype=np.int64).reshape(-1, 2))


def build_covers(
    robot: Robot,
    options: CoverOptions | None = None,
    sharpening: SharpeningOptions | None = None,
    progress: Progress | None = None,
) -> RobotCovers:
    """Covers of a robot's groups of bodies, made anew.

    See `CoverBuilder`, `find_clear_pairs` and `sharpen_close_pairs`: pairs that never touch need no sharper covers.

    Args:
        robot: a robot.
        options: how fine.
        sharpening: what is done about links that are close to each other.
        progress: is told after every step, and at the end; what it raises ends the work.
    """
    options, sharpening = options or CoverOptions(), sharpening or SharpeningOptions()
    groups = group_bodies(robot.collision_model)
    # A step for each group, one for the pairs that never touch, and one for each round of sharpening.
    steps, done = len(groups.members) + 1 + sharpening.rounds, 0

    def step() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, steps)

    builders = []
    for members in groups.members:
        builders.append(builder_of(robot, members, options))
        builders[-1].build()
        step()
    clear = find_clear_pairs(robot, groups)
    step()

    def covers() -> RobotCovers:
        return RobotCovers(tuple(builder.cover() for builder in builders), clear)

    nothing = Scene.of([], WorkspaceBounds(-np.ones(3), np.ones(3)), robot.root_frame)
    judge = ExactChecker(robot, nothing)

    def undecided(configurations: FloatArray, most: int) -> FloatArray:
        bounds = CollisionBounds(robot, groups, covers())
        verdicts = Verdicts(bounds.checks(nothing)).of_states(configurations)
        open_ones = configurations[verdicts == UNDECIDED]
        free = (configuration for configuration in open_ones if judge.is_free(configuration))
        return np.array(list(itertools.islice(free, most))).reshape(-1, robot.dof)

    pairs = _without(groups.pairs, clear)
    sharpen_close_pairs(robot, groups, builders, pairs, undecided, sharpening, on_round=step)
    made = covers()
    if progress is not None:
        progress(steps, steps)
    return made


def _without(pairs: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.int64]:
    """The rows of an array (p, 2) that are not rows of another (k, 2)."""
    dropped = {tuple(pair) for pair in others.tolist()}
    return np.array([pair for pair in pairs.tolist() if tuple(pair) not in dropped], dtype=np.int64).reshape(-1, 2)


def _turned_frames(axes: FloatArray) -> list[FloatArray]:
    """Rotations (3, 3) whose third column is the joint's axis; of the root: the identity."""
    turns = [np.eye(3)]
    for axis in axes:
        other = np.eye(3)[int(np.argmin(np.abs(axis)))]
        first = np.cross(other, axis)
        first /= np.linalg.norm(first)
        turns.append(np.stack([first, np.cross(axis, first), axis], axis=1))
    return turns


def _movers(model: pin.Model, joint: int) -> list[int]:
    """Places, in Pinocchio's order, of the joints that move a joint's frame."""
    return [int(mover) - 1 for mover in model.supports[joint] if mover > 0]


def _chain_length(model: pin.Model, prismatic: np.ndarray, joint: int) -> float:
    """How far the frame of a joint is from the root at most, in all configurations [m]."""
    length = 0.0
    for mover in _movers(model, joint):
        length += float(np.linalg.norm(model.jointPlacements[mover + 1].translation))
        if prismatic[mover]:
            index = model.joints[mover + 1].idx_v
            length += max(abs(model.lowerPositionLimit[index]), abs(model.upperPositionLimit[index])) + BEYOND_LIMITS
    return length


def _flat_tree(balls: FloatArray) -> tuple[FloatArray, np.ndarray]:
    """A tree whose leaves are some balls, all below one node."""
    if len(balls) < 2:
        return balls, np.arange(1, len(balls) + 1)
    cells = np.zeros((len(balls), 6))
    cells[:, :3], cells[:, 5] = balls[:, :3], balls[:, 3]
    root = enclosing_ball(cells, np.append(balls[:, :3].mean(axis=0), 0.0))
    ends = np.arange(1, len(balls) + 2)
    ends[0] = len(balls) + 1
    return np.concatenate([root[None], balls]), ends


def _tree(
    covers: Sequence[tuple[FloatArray, np.ndarray]], groups: BodyGroups, turns: list[FloatArray], rounding: float
) -> SphereTree:
    """Trees of all groups in one, in the turned frames, `rounding` added to all radii."""
    spheres, ends, roots = [np.empty((0, 4))], [np.empty(0, dtype=np.int64)], [0]
    for group, (balls, own_ends) in enumerate(covers):
        placed = balls.copy()
        placed[:, :3] = balls[:, :3] @ turns[int(groups.joints[group])]
        placed[:, 3] += rounding
        spheres.append(placed)
        ends.append(own_ends + roots[-1])
        roots.append(roots[-1] + len(balls))
    return SphereTree(
        np.concatenate(spheres).astype(np.float32),
        np.concatenate(ends),
        np.array(roots, dtype=np.int64),
    )
