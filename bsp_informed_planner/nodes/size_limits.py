"""How large scenes may be: beyond it, a mistake or an attack is likelier than an intent."""

from __future__ import annotations

from dataclasses import dataclass

from bsp_informed_planner_msgs.msg import AllowedCollision, AttachedObstacle, ObstacleScene
from bsp_informed_planner_msgs.msg import Obstacle as ObstacleMsg
from sensor_msgs.msg import PointCloud2

from bsp_informed_planner.errors import InvalidObstacleError
from bsp_informed_planner.scene.scene import Obstacle, Scene
from bsp_informed_planner.scene.shapes import MAX_CLOUD_POINTS, ConvexMesh, Mesh, PointCloud


@dataclass(frozen=True)
class SizeLimits:
    """Bounds of a scene, and of each message that changes it.

    Attributes:
        bodies: shapes of all obstacles together.
        vertices: vertices, and likewise triangles, of all meshes together.
        points: of all point clouds together.
        pairs: that may touch.
        name_length: of an id or a name of a link, in characters.
    """

    bodies: int = 1000
    vertices: int = 200_000
    points: int = MAX_CLOUD_POINTS
    pairs: int = 1000
    name_length: int = 256

    def check_message(self, message: ObstacleScene) -> None:
        """Look at the sizes in a message, before anything of it is read.

        Raises:
            InvalidObstacleError: naming the limit.
        """
        self.check_parts(message.obstacles, message.attached, message.allowed_collisions)

    def check_parts(
        self, obstacles: list[ObstacleMsg], attached: list[AttachedObstacle], pairs: list[AllowedCollision]
    ) -> None:
        """The same for the parts of a message.

        Raises:
            InvalidObstacleError: naming the limit.
        """
        self._require("max_bodies", len(obstacles) + len(attached), self.bodies)
        self._require("max_pairs", len(pairs), self.pairs)
        every = [*obstacles, *(body.obstacle for body in attached)]
        self._require("max_bodies", sum(map(_bodies, every)), self.bodies)
        self._require("max_vertices", sum(len(mesh.vertices) for item in every for mesh in item.meshes), self.vertices)
        self._require("max_vertices", sum(len(mesh.triangles) for item in every for mesh in item.meshes), self.vertices)
        clouds = [cloud for item in every for cloud in item.point_clouds]
        self._require("max_points", sum(cloud.width * cloud.height for cloud in clouds), self.points)
        names = [item.id for item in every]
        for body in attached:
            self._require("max_pairs", len(body.touch_links), self.pairs)
            names += [body.link_name, *body.touch_links]
        for pair in pairs:
            names += [pair.first, pair.second]
        self._require("max_name_length", max(map(len, names), default=0), self.name_length)

    def check_points(self, message: PointCloud2) -> None:
        """Look at the size of a point cloud.

        Raises:
            InvalidObstacleError: naming the limit.
        """
        self._require("max_points", message.width * message.height, self.points)

    def check_scene(self, scene: Scene) -> None:
        """Look at a whole scene, which many messages may have built up.

        Raises:
            InvalidObstacleError: naming the limit.
        """
        obstacles: list[Obstacle] = [*scene.obstacles.values(), *(body.obstacle for body in scene.attached.values())]
        shapes = [shape for obstacle in obstacles for shape, _ in obstacle.shapes]
        self._require("max_bodies", len(shapes), self.bodies)
        meshes = [shape for shape in shapes if isinstance(shape, (Mesh, ConvexMesh))]
        self._require("max_vertices", sum(len(mesh.vertices) for mesh in meshes), self.vertices)
        self._require("max_points", sum(len(s.points) for s in shapes if isinstance(s, PointCloud)), self.points)
        self._require("max_pairs", len(scene.allowed_collisions), self.pairs)

    @staticmethod
    def _require(parameter: str, count: int, most: int) -> None:
        if count > most:
            what = {
                "max_bodies": "bodies",
                "max_vertices": "vertices or triangles",
                "max_points": "points of point clouds",
                "max_pairs": "pairs or links that may touch",
                "max_name_length": "characters in a name",
            }[parameter]
            raise InvalidObstacleError("*", f"{count} {what}: at most {most} (parameter `{parameter}`)")


#: What a node reads that trusts the sender with the limits: no more than parameters can be set to.
LARGEST = SizeLimits(100_000, 5_000_000, MAX_CLOUD_POINTS, 100_000, 4096)


def _bodies(message: ObstacleMsg) -> int:
    return len(message.primitives) + len(message.meshes) + len(message.planes) + len(message.point_clouds)
