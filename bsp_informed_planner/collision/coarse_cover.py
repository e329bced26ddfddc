"""A few dozen balls that cover a robot's moving bodies: rough, and quick to look at."""

from __future__ import annotations

import threading
from weakref import WeakKeyDictionary

import numpy as np

from bsp_informed_planner.collision.bounds import CollisionBounds
from bsp_informed_planner.collision.push_kernels import CoarseCover
from bsp_informed_planner.scene.pose import FloatArray

#: Bodies get another ball until none is larger than this, or there are so many [m].
RADIUS, MOST_BALLS = 0.115, 16
_ROUNDS, _STEPS = 4, 60


_known: WeakKeyDictionary[CollisionBounds, CoarseCover] = WeakKeyDictionary()
_making = threading.Lock()


def coarse_cover_of(bounds: CollisionBounds) -> CoarseCover:
    """The balls of a robot, made from those of its bounds, once."""
    with _making:
        found = _known.get(bounds)
        if found is None:
            found = _known[bounds] = make_coarse_cover(bounds)
        return found


def make_coarse_cover(bounds: CollisionBounds, radius: float = RADIUS, most: int = MOST_BALLS) -> CoarseCover:
    """Balls around the covering balls of each group of bodies, gathered in as few clusters as the radius takes.

    Args:
        bounds: of the robot.
        radius: see `RADIUS` [m].
        most: balls of a group.
    """
    outer, joints = bounds.arrays.outer, bounds.arrays.joints
    balls, carriers, groups, begins, enclosing = [], [], [], [0], []
    for group, joint in enumerate(joints.tolist()):
        rows = np.arange(outer.roots[group], outer.roots[group + 1])
        if joint == 0 or not len(rows):
            continue
        leaves = outer.spheres[rows[outer.ends[rows] == rows + 1]].astype(np.float64)
        enclosing.append(enclosing_ball_of(leaves))
        clusters = [leaves]
        # Counted here: clusters that come out empty are left out, so their number may stay what it was.
        for count in range(2, min(most, len(leaves)) + 1):
            if max(map(_spread, clusters)) <= radius:
                break
            clusters = _clustered(leaves, count)
        own = [enclosing_ball_of(cluster) for cluster in clusters]
        balls.extend(own)
        carriers.extend([joint] * len(own))
        groups.append(group)
        begins.append(len(balls))
    return CoarseCover(
        np.array(balls).reshape(-1, 4),
        np.array(carriers, dtype=np.int64),
        np.array(groups, dtype=np.int64),
        np.array(begins, dtype=np.int64),
        np.array(enclosing).reshape(-1, 4),
    )


def enclosing_ball_of(balls: FloatArray) -> FloatArray:
    """(4,) centre and radius of a small ball around balls (k, 4) (Badoiu and Clarkson, 2003)."""
    centre = balls[:, :3].mean(axis=0)
    for step in range(1, _STEPS):
        reach = np.linalg.norm(balls[:, :3] - centre, axis=1) + balls[:, 3]
        furthest = int(reach.argmax())
        centre = centre + (balls[furthest, :3] - centre) / (step + 1.0)
    return np.append(centre, (np.linalg.norm(balls[:, :3] - centre, axis=1) + balls[:, 3]).max())


def _spread(balls: FloatArray) -> float:
    """Radius of a ball around balls (k, 4) whose centre is the mean of theirs."""
    places = balls[:, :3] - balls[:, :3].mean(axis=0)
    return float((np.linalg.norm(places, axis=1) + balls[:, 3]).max())


def _clustered(balls: FloatArray, count: int) -> list[FloatArray]:
    """Balls (k, 4) in at most `count` clusters: k-means of their centres, begun with centres far from each other."""
    places = balls[:, :3]
    first = places[int(np.linalg.norm(places - places.mean(axis=0), axis=1).argmax())]
    means, gaps = [first], np.linalg.norm(places - first, axis=1)
    while len(means) < count:
        means.append(places[int(gaps.argmax())])
        gaps = np.minimum(gaps, np.linalg.norm(places - means[-1], axis=1))
    centres = np.array(means)
    squares = (places**2).sum(axis=1)
    for _ in range(_ROUNDS):
        nearest = (squares[:, None] + (centres**2).sum(axis=1) - 2.0 * places @ centres.T).argmin(axis=1)
        found = np.unique(nearest)
        centres = np.array([places[nearest == k].mean(axis=0) for k in found])
    return [balls[nearest == k] for k in found]
