"""Random scenes of a given number of boxes, and scenes of all kinds of obstacles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cone, ConvexMesh, Cylinder, HalfSpace, Shape, Sphere
from bsp_informed_planner.scene.shelf import ShelfOptions, ShelfScene, random_shelf, sample_outside_pose

CUBE = WorkspaceBounds(-np.ones(3), np.ones(3))
# Compartments of shelving: width, depth, height; its boards; space around it [m].
COMPARTMENT = np.array([0.45, 0.35, 0.35])
BOARD, AISLE = 0.02, 0.5
ITEMS_PER_COMPARTMENT = 4
# Facets of a box that count: in the plane only those of its sides do.
FACETS_OF_BOX = {2: 4, 3: 6}


def shelf_of_boxes(rng: np.random.Generator, boxes: int = 20) -> ShelfScene:
    """A three-level shelf of seven boards with boxes on them, as for an arm, of so many boxes in all."""
    items = boxes - 7
    options = ShelfOptions(items=(items, items), cylinder_share=0.0, pedestal=0.0)
    while True:
        shelf = random_shelf(rng, options)
        if len(shelf.scene.obstacles) == boxes:
            return shelf


def point_outside(rng: np.random.Generator, shelf: ShelfScene) -> FloatArray:
    """(3,) a random point in front of a shelf [m]."""
    return sample_outside_pose(rng, shelf).position


def clutter(rng: np.random.Generator, boxes: int, dimension: int) -> Scene:
    """Turned boxes at random places of the cube [-1, 1]^3, some of which overlap.

    In 3D they are turned at random and have about 7 % of the cube; in the plane they stand upright through z = 0 and
    have about a quarter of it. That they become smaller as they become more keeps scenes alike.
    """
    size = 0.5 * (20.0 / boxes) ** (1.0 / 3.0) if dimension == 3 else (3.0 / boxes) ** 0.5
    obstacles = []
    for index in range(boxes):
        edges = rng.uniform(0.2, 1.0, 3) * min(size, 1.0)
        position, angles = rng.uniform(-1.0, 1.0, 3), rng.uniform(-math.pi, math.pi, 3)
        if dimension == 2:
            edges[2], position[2], angles[:2] = 0.5, 0.0, 0.0
        obstacles.append(Obstacle.of(f"box_{index}", Box(edges), Pose.from_xyz_rpy(position, angles)))
    return Scene.of(obstacles, CUBE)


def shelving(rng: np.random.Generator, boxes: int, dimension: int) -> Scene:
    """Shelving of so many boxes: boards, sides, a back, and about four items in each compartment.

    In 3D compartments are side by side and on top of each other. In the plane, which is a section at z = 0, they are
    side by side in several rows with aisles between them. Scenes of fewer than seven boxes are parts of a compartment.
    """
    bays, rows = _grid(boxes, dimension)
    boards = _boards_3d(bays, rows) if dimension == 3 else _boards_2d(bays, rows)
    boards = boards[:boxes]
    items = [
        _item(rng, index % (bays * rows) % bays, index % (bays * rows) // bays, dimension)
        for index in range(boxes - len(boards))
    ]
    lower, upper = np.array([-AISLE, -AISLE, -AISLE]), np.array([bays, 1.0, rows]) * COMPARTMENT + AISLE
    if dimension == 2:
        upper[1], upper[2] = rows * (COMPARTMENT[1] + AISLE), AISLE
    obstacles = [
        Obstacle.of(f"{kind}_{index}", Box(size), Pose.from_xyz_rpy(centre, (0.0, 0.0, yaw)))
        for kind, group in (("board", boards), ("item", items))
        for index, (size, centre, yaw) in enumerate(group)
    ]
    return Scene.of(obstacles, WorkspaceBounds(lower, upper))


def moved_in_compartment(rng: np.random.Generator, scene: Scene, item: str) -> Scene:
    """A scene of `shelving` in 3D, with an item at another place of its compartment."""
    obstacle = scene.obstacles[item]
    column, row = (int(obstacle.pose.position[axis] / COMPARTMENT[axis]) for axis in (0, 2))
    ((shape, _),) = obstacle.shapes
    assert isinstance(shape, Box)
    place = rng.uniform(0.15, 0.85, 2) * COMPARTMENT[:2] + [column * COMPARTMENT[0], 0.0]
    position = np.append(place, row * COMPARTMENT[2] + 0.5 * BOARD + 0.5 * shape.size[2])
    return with_pose(scene, item, Pose.from_xyz_rpy(position, (0.0, 0.0, rng.uniform(-0.5, 0.5))))


def with_pose(scene: Scene, obstacle: str, pose: Pose) -> Scene:
    """The scene with an obstacle at another pose, its revision one higher."""
    changed = dict(scene.obstacles)
    changed[obstacle] = Obstacle(obstacle, changed[obstacle].shapes, pose)
    return replace(scene, obstacles=changed, revision=scene.revision + 1)


def fresh(scene: Scene) -> Scene:
    """The same scene of new objects, as if it had just been received: nothing is cached in them."""
    return Scene.of(
        [
            Obstacle(
                obstacle.id,
                tuple((shape, Pose(pose.position, pose.quaternion)) for shape, pose in obstacle.shapes),
                Pose(obstacle.pose.position, obstacle.pose.quaternion),
            )
            for obstacle in scene.obstacles.values()
        ],
        scene.bounds,
        scene.frame,
        scene.revision,
    )


def random_boxes(rng: np.random.Generator, most: int = 15) -> Scene:
    """Up to so many boxes of all sizes, turned at random or upright, some of which overlap or stick out of the cube."""
    tilted, size = bool(rng.random() < 0.5), float(rng.uniform(0.05, 1.5))
    obstacles = []
    for index in range(int(rng.integers(0, most + 1))):
        angles = rng.uniform(-math.pi, math.pi, 3)
        if not tilted:
            angles[:2] = 0.0
        pose = Pose.from_xyz_rpy(rng.uniform(-1.1, 1.1, 3), angles)
        obstacles.append(Obstacle.of(f"box_{index}", Box(rng.uniform(0.1, 1.0, 3) * size), pose))
    return Scene.of(obstacles, CUBE)


def random_shapes(rng: np.random.Generator) -> Scene:
    """Up to eight obstacles of all kinds, and half of the time a floor; half of the obstacles stand upright."""
    obstacles = []
    floor = float(rng.uniform(0.3, 0.9))
    if rng.random() < 0.5:
        obstacles.append(Obstacle.of("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), floor)))
    for index in range(int(rng.integers(1, 9))):
        radius, height = float(rng.uniform(0.03, 0.35)), float(rng.uniform(0.05, 0.8))
        shapes: tuple[Shape, ...] = (
            Box(rng.uniform(0.05, 0.6, 3)),
            Sphere(radius),
            Cylinder(radius, height),
            Cone(radius, height),
            ConvexMesh(rng.normal(size=(int(rng.integers(6, 16)), 3)) * rng.uniform(0.05, 0.25)),
        )
        shape = shapes[int(rng.integers(len(shapes)))]
        angles = rng.uniform(-math.pi, math.pi, 3) * (1.0 if rng.random() < 0.5 else np.array([0.0, 0.0, 1.0]))
        obstacles.append(Obstacle.of(f"shape_{index}", shape, Pose.from_xyz_rpy(rng.uniform(-1.0, 1.0, 3), angles)))
    return Scene.of(obstacles, CUBE)


_Cuboid = tuple[FloatArray, FloatArray, float]


def _grid(boxes: int, dimension: int) -> tuple[int, int]:
    """Columns and rows of compartments; about as wide as high, with four items in each."""
    cells = max(1.0, boxes / (ITEMS_PER_COMPARTMENT + (0 if dimension == 3 else 1)))
    rows = max(1, int(math.sqrt(cells)))
    return max(1, int(cells / rows)), rows


def _boards_3d(bays: int, rows: int) -> list[_Cuboid]:
    width, depth, height = np.array([bays, 1.0, rows]) * COMPARTMENT
    boards = [_cuboid(0.0, width, 0.0, depth, row * COMPARTMENT[2]) for row in range(rows + 1)]
    boards += [
        (np.array([BOARD, depth, height]), np.array([bay * COMPARTMENT[0], 0.5 * depth, 0.5 * height]), 0.0)
        for bay in range(bays + 1)
    ]
    boards.append((np.array([width, BOARD, height]), np.array([0.5 * width, depth, 0.5 * height]), 0.0))
    return boards


def _cuboid(x0: float, x1: float, y0: float, y1: float, z: float) -> _Cuboid:
    """A horizontal board."""
    return np.array([x1 - x0, y1 - y0, BOARD]), np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1), z]), 0.0


def _boards_2d(bays: int, rows: int) -> list[_Cuboid]:
    """For each row a back and dividers, which reach through z = 0."""
    width, depth = bays * COMPARTMENT[0], COMPARTMENT[1]
    boards = []
    for row in range(rows):
        y = row * (depth + AISLE)
        boards.append((np.array([width, BOARD, 0.4]), np.array([0.5 * width, y + depth, 0.0]), 0.0))
        boards += [
            (np.array([BOARD, depth, 0.4]), np.array([bay * COMPARTMENT[0], y + 0.5 * depth, 0.0]), 0.0)
            for bay in range(bays + 1)
        ]
    return boards


def _item(rng: np.random.Generator, column: int, row: int, dimension: int) -> _Cuboid:
    size = np.append(rng.uniform(0.04, 0.10, 2), rng.uniform(0.10, 0.25))
    x, y = rng.uniform(0.15, 0.85, 2) * COMPARTMENT[:2] + [column * COMPARTMENT[0], 0.0]
    if dimension == 2:
        return size, np.array([x, y + row * (COMPARTMENT[1] + AISLE), 0.0]), float(rng.uniform(-0.5, 0.5))
    z = row * COMPARTMENT[2] + 0.5 * BOARD + 0.5 * size[2]
    return size, np.array([x, y, z]), float(rng.uniform(-0.5, 0.5))
