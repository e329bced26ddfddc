"""Scenes and requests for a point robot, good ones and bad ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from bsp_informed_planner_msgs.msg import AllowedCollision, AttachedObstacle, Obstacle, ObstacleScene, PlanRequest
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState
from shape_msgs.msg import SolidPrimitive

from bsp_informed_planner.nodes.scene_conversions import scene_to_msg
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle as SceneObstacle
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box

_NUMBERS = (np.nan, np.inf, -np.inf, -1.0, 0.0, 0.5, 1.0, 1e-300, 1e300)


def gap_scene(gap_at: float, gap: float = 0.2) -> Scene:
    """A unit square, and a wall at x = 0.5 with a gap."""
    bounds = WorkspaceBounds(np.array([0.0, 0.0, -0.05]), np.array([1.0, 1.0, 0.05]))

    def wall(name: str, low: float, high: float) -> SceneObstacle:
        pose = Pose.from_xyz_rpy([0.5, (low + high) / 2.0, 0.0])
        return SceneObstacle.of(name, Box(np.array([0.05, high - low, 0.2])), pose)

    walls = [wall("lower", -0.1, gap_at - gap / 2.0), wall("upper", gap_at + gap / 2.0, 1.1)]
    return Scene.of(walls, bounds)


def gap_message(rng: np.random.Generator) -> ObstacleScene:
    """A good scene with the gap anywhere, or now and then one that has to be refused."""
    message = scene_to_msg(gap_scene(float(rng.uniform(0.3, 0.7))))
    if rng.random() < 0.05:
        message.obstacles[0].primitives[0].dimensions[int(rng.integers(3))] = float(rng.choice(_NUMBERS[:5]))
    return message


def good_request(rng: np.random.Generator) -> PlanRequest:
    """Through the gap, in half a second at most."""
    request = PlanRequest(allowed_planning_time=0.5, first_solution=True, seed=int(rng.integers(1, 1000)))
    request.start = JointState(name=["x", "y"], position=[0.1, float(rng.uniform(0.1, 0.9))])
    request.goal_states = [JointState(name=["x", "y"], position=[0.9, float(rng.uniform(0.1, 0.9))])]
    return request


def random_request(rng: np.random.Generator) -> PlanRequest:
    """A good one, or one that is spoilt in one or two places: each must be answered, whatever is wrong with it."""
    request = good_request(rng)
    if rng.random() < 0.5:
        for index in rng.integers(len(_SPOILS), size=int(rng.integers(1, 3))):
            _SPOILS[index](request, rng)
    return request


def _number(rng: np.random.Generator) -> float:
    return float(rng.choice(_NUMBERS))


def _text(rng: np.random.Generator) -> str:
    texts = ("", "x", "rrt", "world", "point", "lower", "/", "a b", "ü", "x" * 10_000, "'; drop", "\n")
    return texts[int(rng.integers(len(texts)))]


def _pose(rng: np.random.Generator) -> PoseStamped:
    pose = PoseStamped()
    pose.header.frame_id = _text(rng)
    pose.pose.position.x, pose.pose.position.y = _number(rng), _number(rng)
    pose.pose.orientation.x, pose.pose.orientation.w = _number(rng), _number(rng)
    return pose


def _body(rng: np.random.Generator) -> AttachedObstacle:
    primitive = SolidPrimitive(type=int(rng.integers(7)), dimensions=[abs(_number(rng))] * int(rng.integers(4)))
    body = Obstacle(id=_text(rng), primitives=[primitive] * int(rng.integers(2)))
    # Mostly a link that there is, so that the body itself is looked at.
    link = "point" if rng.random() < 0.7 else _text(rng)
    return AttachedObstacle(operation=bytes([int(rng.integers(4))]), obstacle=body, link_name=link)


_SPOILS: tuple[Callable[[PlanRequest, np.random.Generator], object], ...] = (
    lambda r, g: setattr(r.start, "position", [_number(g), _number(g)]),
    lambda r, g: r.start.name.append(_text(g)),
    lambda r, g: setattr(r, "start", JointState()),
    lambda r, g: r.goal_states.clear(),
    lambda r, g: r.goal_states.append(JointState(position=[_number(g)] * int(g.integers(4)))),
    lambda r, g: r.goal_states.extend([JointState()] * 200),
    lambda r, g: r.goal_poses.append(_pose(g)),
    lambda r, g: setattr(r, "goal_frame", _text(g)),
    lambda r, g: setattr(r, "planner_id", _text(g)),
    lambda r, g: setattr(r, "sampler_id", _text(g)),
    lambda r, g: setattr(r, "allowed_planning_time", min(_number(g), 1.0)),
    lambda r, g: setattr(r, "uniform_fraction", _number(g)),
    lambda r, g: setattr(r, "max_samples", int(g.integers(1, 50))),
    lambda r, g: setattr(r, "seed", 2**64 - 1),
    lambda r, g: setattr(r, "max_velocity_scaling_factor", _number(g)),
    lambda r, g: setattr(r, "max_acceleration_scaling_factor", _number(g)),
    lambda r, g: setattr(r, "padding", _number(g)),
    lambda r, g: r.attached.append(_body(g)),
    lambda r, g: r.allowed_collisions.append(AllowedCollision(first=_text(g), second=_text(g))),
    lambda r, g: setattr(r, "scene_revision", int(g.integers(5))),
    lambda r, g: setattr(r, "scene_epoch", int(g.integers(1, 5))),
)
