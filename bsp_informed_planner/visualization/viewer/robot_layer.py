"""A robot in a page."""

from __future__ import annotations

from typing import Any

import numpy as np

from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.palette import BASE, Colour
from bsp_informed_planner.visualization.shape_triangles import RobotMeshes
from bsp_informed_planner.visualization.triangle_mesh import TriangleMesh
from bsp_informed_planner.visualization.viewer.server import Viewer, rgb


class RobotLayer:
    """The moving bodies of a robot, in one configuration, by its collision geometry, and a ball at its tool.

    Attributes:
        nodes: of the scene, for a switch.
    """

    def __init__(
        self,
        viewer: Viewer,
        name: str,
        robot: Robot,
        meshes: RobotMeshes,
        configuration: FloatArray,
        colour: Colour,
        *,
        opacity: float | None = None,
        ball: float = 0.01,
    ) -> None:
        """
        Args:
            viewer: the page.
            name: of the nodes, below /robot.
            robot: which robot.
            meshes: of it.
            configuration: (n,) where it is at first [rad or m].
            colour: of the bodies.
            opacity: None for bodies that cannot be looked through.
            ball: radius of the ball, so that a robot that is a point is seen too [m].
        """
        self._viewer = viewer
        self._robot = robot
        self._meshes = meshes
        self._ball = viewer.server.scene.add_icosphere(f"/robot/{name}/tool", ball, rgb(colour))
        self._colour = colour
        # A robot that is a point has bodies without a surface.
        self._bodies = {
            number: mesh_node(viewer, f"/robot/{name}/{number}", mesh, colour, opacity)
            for number, mesh in enumerate(meshes.moving)
            if len(mesh)
        }
        self.nodes = [*self._bodies.values(), self._ball]
        self.move(configuration)

    def move(self, configuration: FloatArray) -> None:
        """Puts the robot into a configuration (n,) [rad or m]."""
        with self._viewer.lock, self._viewer.server.atomic():
            self._ball.position = tuple(self._robot.forward_kinematics(configuration).position.tolist())
            placements = self._meshes.placements(configuration)
            for number, node in self._bodies.items():
                pose = placements[number]
                x, y, z, w = pose.quaternion.tolist()
                node.position = tuple(pose.position.tolist())
                node.wxyz = (w, x, y, z)

    def paint(self, colour: Colour) -> None:
        """Gives all bodies a colour."""
        if colour != self._colour:
            self._colour = colour
            for node in self.nodes:
                node.color = rgb(colour)


def base_nodes(viewer: Viewer, meshes: RobotMeshes) -> list[Any]:
    """The bodies of a robot that never move."""
    return [mesh_node(viewer, "/robot/base", meshes.base, BASE)] if len(meshes.base) else []


def mesh_node(viewer: Viewer, name: str, mesh: TriangleMesh, colour: Colour, opacity: float | None = None) -> Any:
    """A node of triangles, smooth where corners of triangles coincide."""
    vertices, faces = np.unique(mesh.points.astype(np.float32), axis=0, return_inverse=True)
    return viewer.server.scene.add_mesh_simple(
        name, vertices, np.asarray(faces).reshape(-1, 3), color=rgb(colour), opacity=opacity, flat_shading=True,
        side="double",
    )  # fmt: skip
