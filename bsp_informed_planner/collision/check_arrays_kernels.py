"""The arrays that the verdict kernels read and write.

Sixteen states are looked at together, one a lane: sixteen numbers in a row, which processors handle at once. A quantity
of all lanes is a slice of a flat row, STRIDE numbers long: the lanes, one more that continues the last two in a line,
so that every lane has a next one, and room.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Singles = NDArray[np.float32]
Indices = NDArray[np.int64]
Lanes = NDArray[np.int32]

#: States that are looked at together.
LANES = 16
#: Numbers from one quantity of all lanes to the next.
STRIDE = 24

# Kinds of an obstacle's parts, and of the nodes of a tree of obstacles that only enclose others.
ENCLOSING, BOX, BALL, CYLINDER, CONE, HALF_SPACE, POLYTOPE = -1, 0, 1, 2, 3, 4, 5
#: Numbers that describe a part of an obstacle, see `obstacle_kernels`.
PART_SIZE = 16

#: What bodies of a group may touch, as a sum: some of them, so that hits are not certain; all, so that there are none.
SOME_MAY_TOUCH, ALL_MAY_TOUCH = 1, 2

# How spheres are looked at, as a sum. It is passed as np.int64(...): kernels are compiled anew for every literal.
#: Lanes are neighbours along an edge, and the intervals between them are looked at, too.
SWEPT = 1
#: Hits are certain (inner spheres), not their absence (outer spheres).
SURELY = 2
#: The first hit ends the search.
STOP = 4

#: Rows of a joint's frame: nine of its rotation, row by row, then three of its origin.
FRAME_ROWS = 12
# Rows of a placed sphere: its centre, and the squared radius against obstacles.
X, Y, Z, SQUARED = 0, STRIDE, 2 * STRIDE, 3 * STRIDE
SPHERE_ROWS = 4


class Chain(NamedTuple):
    """The kinematic tree, every joint turned so that it moves about, or along, its z axis.

    Attributes:
        parents: (n,) the parent of each joint, counted from 1; 0 is the root. Parents come first.
        places: (n,) where in a configuration a joint's value is.
        prismatic: (n,) 1 if it slides, 0 if it turns.
        placements: (n, 12) pose of a joint in its parent's frame: rotation row by row, origin [m].
    """

    parents: Indices
    places: Indices
    prismatic: Indices
    placements: Singles


class SphereTree(NamedTuple):
    """Spheres of all groups of bodies. Every group has a tree, stored depth first, whose leaves are the spheres.

    Attributes:
        spheres: (m, 4) centre and radius in the frame of the group's joint [m]. A node encloses what its leaves stand
            for.
        ends: (m,) the index after the last node below a node: index + 1 for a leaf.
        roots: (g + 1,) first node of each group; those of a group without spheres are equal.
    """

    spheres: Singles
    ends: Indices
    roots: Indices


class RobotBounds(NamedTuple):
    """What is known of a robot, whatever the scene.

    A group is a set of bodies that one joint carries and that are checked against the same others.

    Attributes:
        chain: its joints.
        outer: spheres that cover the bodies, rounding included.
        inner: spheres inside the bodies, rounding included.
        joints: (g,) which joint carries a group, 0 for none.
        exposed: (g,) 1 for groups that are checked against obstacles.
        pairs: (p, 2) groups that are checked against each other.
        lower, upper: (n,) limits, and a little more: what is said of a robot is not said of configurations outside.
        levers: (g, n) bound of the distance of the group's sphere centres from the joint's axis [m], 1 for prismatic
            joints; 0 where the joint does not move the group.
    """

    chain: Chain
    outer: SphereTree
    inner: SphereTree
    joints: Indices
    exposed: Indices
    pairs: Indices
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    levers: Singles


class Obstacles(NamedTuple):
    """The obstacles of a scene as convex parts, in a binary tree of boxes along the axes, stored depth first.

    Attributes:
        boxes: (k, 6) lower and upper corner of each node [m].
        ends: (k,) the index after the last node below a node.
        kinds: (k,) kind of a leaf's part, or ENCLOSING.
        parts: (k, PART_SIZE) description of a leaf's part.
        classes: (k,) of a leaf's obstacle, see `allowed`; 0 for other nodes.
        allowed: (g, c) what the groups of bodies may do with obstacles of each class: sums of SOME_MAY_TOUCH and
            ALL_MAY_TOUCH.
        planes: (q, 4) outward unit normal and offset of the planes of all polytopes: n . x <= d inside.
        cores, core_planes: the same of smaller parts, for hits that are certain in spite of rounding: all points within
            that rounding of a core lie in its part.
    """

    boxes: Singles
    ends: Indices
    kinds: Indices
    parts: Singles
    classes: Indices
    allowed: Indices
    planes: Singles
    cores: Singles
    core_planes: Singles


class Scratch(NamedTuple):
    """Memory that a thread works in.

    Attributes:
        values: (n, LANES) joint values.
        frames: (n + 1, FRAME_ROWS * STRIDE) frames of root and joints.
        turning: ((FRAME_ROWS + 3) * STRIDE,) the frame that is computed, sines, cosines and slides of its joint.
        outer, inner: (m, SPHERE_ROWS * STRIDE) placed spheres.
        outer_ages, inner_ages: (m,) when each was placed.
        clock: (1,) the time: one more for every set of states.
        slack, bend: (g,) of each group, how far its centres may leave their chords, and how much chords that follow
            each other may differ [m].
        accelerations: (g,) bounds of the second derivative of its centres along the edge [m].
        open: (LANES,) 1 where nothing has been hit yet.
        asked: (LANES,) which lanes are asked about.
        stuck: (LANES,) where halving an interval does not help.
        lane: (LANES, LANES) for each lane: 1 there, 0 elsewhere.
        hits: (LANES,) lanes that some test has not excluded yet.
        stack: (s, 2) pairs of nodes to look at.
        intervals: (s, 2) of an edge, to look at.
        step, turned: (n,) of an edge, by place in a configuration, and by joint.
    """

    values: Singles
    frames: Singles
    turning: Singles
    outer: Singles
    inner: Singles
    outer_ages: Indices
    inner_ages: Indices
    clock: Indices
    slack: Singles
    bend: Singles
    accelerations: Singles
    open: Lanes
    asked: Lanes
    stuck: Lanes
    lane: Lanes
    hits: Lanes
    stack: Indices
    intervals: NDArray[np.float64]
    step: NDArray[np.float64]
    turned: Singles


class Checks(NamedTuple):
    """All that a verdict takes. A thread has its own, for the scratch memory.

    Attributes:
        robot: its bounds.
        obstacles: of the scene.
        outer_margin, inner_margin: added to the radii against obstacles, and against their cores [m].
        finest: intervals of an edge in which no point of the robot moves further are not halved [m].
        motion: (n,) how far at most a point moves for a unit of motion of each joint.
        scratch: to work in.
    """

    robot: RobotBounds
    obstacles: Obstacles
    outer_margin: float
    inner_margin: float
    finest: float
    motion: NDArray[np.float64]
    scratch: Scratch
