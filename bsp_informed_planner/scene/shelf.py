"""Shelves of three low levels with things on them, in front of an arm (the paper's second experiment)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.scene.convex_polytope import ConvexPolytope
from bsp_informed_planner.scene.polytopes import polytopes_of_obstacle
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cylinder

LEVELS = 3
# Tries for a place of an item, and of a tool pose.
_ITEM_TRIES, _POSE_TRIES = 2000, 500
# So near an item is beside or behind it [m].
DEEP_DISTANCE = 0.10


@dataclass(frozen=True)
class ShelfOptions:
    """What random shelves look like. Lengths in m, angles in rad; ranges are (least, most).

    The defaults suit an arm of 0.85 m reach (UR5) whose base stands at the origin of the root frame, z up.

    Attributes:
        level_height: from board to board, the same for all three levels.
        depth, width: inside.
        board_thickness: of all boards.
        yaw: of the shelf about z; at 0 it opens towards -x, i.e. towards the robot.
        x, y: of the middle of its front edge.
        z: of the middle of its lowest board.
        items: number of obstacles on the boards; fewer if they find no place.
        item_size: edges of a box, or diameter of a cylinder, as seen from above.
        item_height: from this to `item_height_share` of the level height.
        item_height_share: see there.
        item_yaw: of a box, to either side, in the shelf.
        item_gap: least distance of the circles around two items, as seen from above.
        cylinder_share: part of the items that are cylinders; the rest are boxes.
        pedestal: edge of the square pedestal under the robot; 0 for none.
        pedestal_gap: from the pedestal to the robot's base at z = 0.
        lower, upper: bounds of the workspace.

    Raises:
        InvalidOptionError: if a range is empty, or a length that must be positive is not.
    """

    level_height: tuple[float, float] = (0.30, 0.40)
    depth: tuple[float, float] = (0.30, 0.40)
    width: tuple[float, float] = (0.80, 1.00)
    board_thickness: float = 0.02
    yaw: tuple[float, float] = (-0.25, 0.25)
    x: tuple[float, float] = (0.42, 0.55)
    y: tuple[float, float] = (-0.10, 0.10)
    z: tuple[float, float] = (-0.53, -0.37)
    items: tuple[int, int] = (6, 12)
    item_size: tuple[float, float] = (0.04, 0.10)
    item_height: float = 0.10
    item_height_share: float = 0.8
    item_yaw: float = 0.7
    item_gap: float = 0.01
    cylinder_share: float = 0.25
    pedestal: float = 0.24
    pedestal_gap: float = 0.0
    lower: tuple[float, float, float] = (-0.75, -0.95, -0.75)
    upper: tuple[float, float, float] = (1.15, 0.95, 1.15)

    def __post_init__(self) -> None:
        for name in ("level_height", "depth", "width", "item_size", "items", "yaw", "x", "y", "z"):
            least, most = getattr(self, name)
            positive = name not in ("yaw", "x", "y", "z", "items")
            if not least <= most or (positive and least <= 0.0) or (name == "items" and least < 0):
                raise InvalidOptionError(name, (least, most), "a range" + (" of positive numbers" if positive else ""))
        if not 0.0 < self.board_thickness < self.level_height[0]:
            raise InvalidOptionError("board_thickness", self.board_thickness, "positive, below the level height")
        if not 0.0 < self.item_height <= self.item_height_share * self.level_height[0]:
            raise InvalidOptionError("item_height", self.item_height, "positive, at most its share of the lowest level")
        if self.item_height_share * self.level_height[1] > self.level_height[1] - self.board_thickness:
            raise InvalidOptionError("item_height_share", self.item_height_share, "items that fit under the next board")
        if not 0.0 <= self.cylinder_share <= 1.0:
            raise InvalidOptionError("cylinder_share", self.cylinder_share, "from 0 to 1")
        if self.pedestal < 0.0 or self.pedestal_gap < 0.0:
            raise InvalidOptionError("pedestal", (self.pedestal, self.pedestal_gap), "lengths of 0 or more")


@dataclass(frozen=True, eq=False)
class ShelfLevel:
    """One level of a shelf, in the frame of the shelf.

    Attributes:
        lower, upper: (3,) corners of its free volume [m].
        items: ids of the obstacles that stand in it.
    """

    lower: FloatArray
    upper: FloatArray
    items: tuple[str, ...]

    @property
    def opening(self) -> FloatArray:
        """(4, 3) corners of its opening [m] in the plane x = 0, counter-clockwise seen from the front (-x)."""
        (_, y0, z0), (_, y1, z1) = self.lower, self.upper
        return np.array([[0.0, y1, z0], [0.0, y0, z0], [0.0, y0, z1], [0.0, y1, z1]])


@dataclass(frozen=True, eq=False)
class ShelfScene:
    """A shelf in front of a robot.

    Attributes:
        scene: obstacles `board_0` (lowest) to `board_3`, `side_left`, `side_right`, `back`, `item_0` ... and, if
            there is one, `pedestal`.
        pose: of the shelf in the frame of the scene. The origin of the shelf's frame is the middle of the front edge of
            the lowest board, at half its thickness; x points into the shelf, z up.
        levels: from the lowest.
    """

    scene: Scene
    pose: Pose
    levels: tuple[ShelfLevel, ...]

    @cached_property
    def item_bodies(self) -> tuple[tuple[ConvexPolytope, ...], ...]:
        """For each level the polytopes around its items, in the frame of the scene.

        Round items are circumscribed: the distance from them is a lower bound, good enough to place a tool.
        """
        return tuple(
            tuple(
                part
                for item in level.items
                for part in polytopes_of_obstacle(self.scene.obstacles[item], self.scene.bounds)
            )
            for level in self.levels
        )


def random_shelf(rng: np.random.Generator, options: ShelfOptions | None = None, frame: str = "base_link") -> ShelfScene:
    """A shelf of random size at a random place, with random items standing on its boards.

    Args:
        rng: source of randomness; the same state gives the same shelf.
        options: None for the defaults.
        frame: name of the root frame of the robot.
    """
    options = options or ShelfOptions()
    height, depth, width = (rng.uniform(*r) for r in (options.level_height, options.depth, options.width))
    thickness = options.board_thickness
    pose = Pose.from_xyz_rpy(
        [rng.uniform(*r) for r in (options.x, options.y, options.z)], [0, 0, rng.uniform(*options.yaw)]
    )

    obstacles = [
        Obstacle.of(name, Box(size), pose * _at(centre))
        for name, size, centre in _boards(height, depth, width, thickness)
    ]
    items, levels_of_items = _items(rng, options, height, depth, width)
    obstacles.extend(Obstacle(item.id, item.shapes, pose * item.pose) for item in items)
    if options.pedestal > 0.0:
        top, bottom = -options.pedestal_gap, options.lower[2]
        size = np.array([options.pedestal, options.pedestal, top - bottom])
        obstacles.append(Obstacle.of("pedestal", Box(size), _at([0.0, 0.0, 0.5 * (top + bottom)])))

    levels = tuple(
        ShelfLevel(
            np.array([0.0, -0.5 * width, level * height + 0.5 * thickness]),
            np.array([depth, 0.5 * width, (level + 1) * height - 0.5 * thickness]),
            tuple(item.id for item, on in zip(items, levels_of_items, strict=True) if on == level),
        )
        for level in range(LEVELS)
    )
    bounds = WorkspaceBounds(np.array(options.lower), np.array(options.upper))
    return ShelfScene(Scene.of(obstacles, bounds, frame), pose, levels)


def sample_level_pose(
    rng: np.random.Generator,
    shelf: ShelfScene,
    level: int,
    clearance: float = 0.04,
    tilt: float = 0.4,
    roll: float = math.pi,
    deep: bool = False,
) -> Pose:
    """A random pose of the tool inside a level, pointing into the shelf.

    Only the point of the tool is free; whether an arm reaches it without collision is for the caller to find out.

    Args:
        rng: source of randomness.
        shelf: the shelf.
        level: from 0, the lowest.
        clearance: least distance of the position from boards, and about that from items [m].
        tilt: greatest angle of the tool's z axis to the shelf's x axis, up or down and to either side [rad].
        roll: greatest angle about the tool's z axis, to either side; at 0 the tool's x axis points down [rad].
        deep: only in the rear half and beside or behind an item, if the level has one: at most `DEEP_DISTANCE` from it.

    Returns:
        pose in the frame of the scene.

    Raises:
        InvalidOptionError: if the shelf has no such level, or no place in it has that clearance.
    """
    if not 0 <= level < len(shelf.levels):
        raise InvalidOptionError("level", level, f"0 to {len(shelf.levels) - 1}")
    volume = shelf.levels[level]
    low = volume.lower + [0.0, clearance, clearance]
    high = volume.upper - clearance
    if deep:
        low[0] = max(low[0], 0.5 * (volume.lower[0] + volume.upper[0]))
    if (low >= high).any():
        raise InvalidOptionError("clearance", clearance, "less than half of the level's sizes")
    bodies = shelf.item_bodies[level]
    for _ in range(_POSE_TRIES):
        local = rng.uniform(low, high)
        position = shelf.pose.apply(local)
        distance = min((float(body.distance(position)) for body in bodies), default=np.inf)
        if distance >= clearance and (not deep or not bodies or distance <= DEEP_DISTANCE):
            return _pointing_in(rng, shelf, local, tilt, roll)
    raise InvalidOptionError("clearance", clearance, f"a distance that a place in level {level} has from all items")


def sample_outside_pose(
    rng: np.random.Generator,
    shelf: ShelfScene,
    distance: tuple[float, float] = (0.10, 0.30),
    base_clearance: float = 0.20,
    tilt: float = 0.5,
    roll: float = math.pi,
) -> Pose:
    """A random pose of the tool in front of the shelf, pointing towards it.

    Args:
        rng: source of randomness.
        shelf: the shelf.
        distance: range of the distance of the position from the plane of the shelf's front [m].
        base_clearance: least distance of the position from the z axis of the scene, where the robot stands [m].
        tilt, roll: as for `sample_level_pose`.

    Returns:
        pose in the frame of the scene.

    Raises:
        InvalidOptionError: if there is no such place.
    """
    first, last = shelf.levels[0], shelf.levels[-1]
    low = np.array([-distance[1], 0.8 * first.lower[1], first.lower[2]])
    high = np.array([-distance[0], 0.8 * first.upper[1], last.upper[2]])
    for _ in range(_POSE_TRIES):
        local = rng.uniform(low, high)
        position = shelf.pose.apply(local)
        if shelf.scene.bounds.contains(position) and math.hypot(position[0], position[1]) >= base_clearance:
            return _pointing_in(rng, shelf, local, tilt, roll)
    raise InvalidOptionError("distance", distance, "a place between the robot and the shelf")


def _at(position: FloatArray | list[float], yaw: float = 0.0) -> Pose:
    return Pose(np.asarray(position), np.array([0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)]))


def _boards(height: float, depth: float, width: float, thickness: float) -> list[tuple[str, FloatArray, FloatArray]]:
    """Name, size and centre of each board, in the frame of the shelf."""
    half = 0.5 * thickness
    tall, middle = LEVELS * height + thickness, 0.5 * LEVELS * height
    boards = [
        (f"board_{k}", np.array([depth, width, thickness]), np.array([0.5 * depth, 0.0, k * height]))
        for k in range(LEVELS + 1)
    ]
    for name, side in (("side_left", 1.0), ("side_right", -1.0)):
        centre = np.array([0.5 * depth, side * (0.5 * width + half), middle])
        boards.append((name, np.array([depth, thickness, tall]), centre))
    back = np.array([thickness, width + 2.0 * thickness, tall])
    boards.append(("back", back, np.array([depth + half, 0.0, middle])))
    return boards


def _items(
    rng: np.random.Generator, options: ShelfOptions, height: float, depth: float, width: float
) -> tuple[list[Obstacle], list[int]]:
    """Items in the frame of the shelf, and the level that each stands in."""
    wanted = int(rng.integers(options.items[0], options.items[1] + 1))
    items: list[Obstacle] = []
    levels: list[int] = []
    circles: list[tuple[int, float, float, float]] = []
    for _ in range(_ITEM_TRIES):
        if len(items) == wanted:
            break
        level = int(rng.integers(LEVELS))
        tall = rng.uniform(options.item_height, options.item_height_share * height)
        first, second = rng.uniform(*options.item_size, size=2)
        is_cylinder = rng.random() < options.cylinder_share
        radius = 0.5 * first if is_cylinder else 0.5 * math.hypot(first, second)
        if 2.0 * radius >= min(depth, width):
            continue
        x, y = rng.uniform(radius, depth - radius), rng.uniform(radius - 0.5 * width, 0.5 * width - radius)
        yaw = rng.uniform(-options.item_yaw, options.item_yaw)
        if any(on == level and math.hypot(x - a, y - b) < radius + r + options.item_gap for on, a, b, r in circles):
            continue
        circles.append((level, x, y, radius))
        levels.append(level)
        shape = Cylinder(radius, tall) if is_cylinder else Box(np.array([first, second, tall]))
        z = level * height + 0.5 * options.board_thickness + 0.5 * tall
        items.append(Obstacle.of(f"item_{len(items)}", shape, _at([x, y, z], yaw)))
    return items, levels


def _pointing_in(rng: np.random.Generator, shelf: ShelfScene, local: FloatArray, tilt: float, roll: float) -> Pose:
    """The pose at a position of the shelf's frame whose z axis is the shelf's x axis, up to the angles."""
    # A quarter turn about y: the tool's x axis points down, its y axis to the left, its z axis into the shelf.
    straight = Pose.from_xyz_rpy(local, [0.0, 0.5 * math.pi, 0.0])
    # A direction at random in the plane across the tool, so that the whole angle is bounded by the tilt.
    direction, angle = rng.uniform(-math.pi, math.pi), tilt * math.sqrt(rng.random())
    tilted = Pose.from_rotation_vector([angle * math.cos(direction), angle * math.sin(direction), 0.0])
    rolled = Pose.from_rotation_vector([0.0, 0.0, rng.uniform(-roll, roll)])
    return shelf.pose * straight * tilted * rolled
