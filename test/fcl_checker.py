"""A second opinion on collisions: python-fcl, meshes read by trimesh, placements from forward kinematics of links."""

from __future__ import annotations

import coal
import fcl
import numpy as np
import trimesh

from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.scene.shapes import Box, Cylinder


class FclChecker:
    """Collision checking of an arm among boxes and cylinders, which is what random shelves are made of.

    Args:
        arm: the robot.
        scene: of boxes and cylinders.
    """

    def __init__(self, arm: ArmRobot, scene: Scene) -> None:
        self._arm = arm
        self._obstacles = []
        for obstacle in scene.obstacles.values():
            for shape, pose in obstacle.placed_shapes():
                assert isinstance(shape, (Box, Cylinder))
                body = fcl.Box(*shape.size) if isinstance(shape, Box) else fcl.Cylinder(shape.radius, shape.height)
                self._obstacles.append(fcl.CollisionObject(body, fcl.Transform(pose.rotation, pose.position)))
        self._links = []
        for item in arm.collision_model.geometryObjects:
            name = arm.model.frames[item.parentFrame].name
            # Where the geometry sits on its link.
            link = arm.model.frames[item.parentFrame].placement
            self._links.append((name, (link.inverse() * item.placement).homogeneous, self._body(item)))

    @staticmethod
    def _body(item: object) -> fcl.CollisionObject:
        geometry = item.geometry  # type: ignore[attr-defined]
        if isinstance(geometry, coal.Box):
            return fcl.CollisionObject(fcl.Box(*(2.0 * geometry.halfSide)))
        mesh = trimesh.load(item.meshPath)  # type: ignore[attr-defined]
        model = fcl.BVHModel()
        model.beginModel(len(mesh.vertices), len(mesh.faces))
        model.addSubModel(np.asarray(mesh.vertices), np.asarray(mesh.faces))
        model.endModel()
        return fcl.CollisionObject(model)

    def is_free(self, configuration: FloatArray) -> bool:
        """Whether no link touches an obstacle, nor another link of a pair that is checked."""
        for name, local, body in self._links:
            placement = self._arm.forward_kinematics(configuration, name).matrix @ local
            body.setTransform(fcl.Transform(placement[:3, :3], placement[:3, 3]))
        bodies = [body for _, _, body in self._links]
        moving = [body for name, _, body in self._links if name != "base_link"]
        pairs = [(bodies[pair.first], bodies[pair.second]) for pair in self._arm.collision_model.collisionPairs]
        pairs += [(body, obstacle) for body in moving for obstacle in self._obstacles]
        request = fcl.CollisionRequest()
        return not any(fcl.collide(a, b, request, fcl.CollisionResult()) for a, b in pairs)
