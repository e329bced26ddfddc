"""Parameters of the decomposition node."""

from __future__ import annotations

from dataclasses import dataclass

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.nodes.parameters import NodeParameters, parameter
from bsp_informed_planner.nodes.size_limits import LARGEST, SizeLimits


@dataclass(frozen=True)
class DecompositionParameters(NodeParameters):
    """Parameters of the decomposition node."""

    frame_id: str = parameter("world", "Planning frame: scenes must be given in it. The root link of the robot.")
    dimension: int = parameter(3, "Dimension of the workspace: 3, or 2 for a robot in the plane.", minimum=2, maximum=3)
    workspace_min: tuple[float, ...] = parameter(
        (-1.0, -1.0, -0.5), "Lower bounds of the space decomposed, where a scene gives none [m]."
    )
    workspace_max: tuple[float, ...] = parameter(
        (1.0, 1.0, 1.5), "Upper bounds of the space decomposed, where a scene gives none [m]."
    )
    grid: int = parameter(3, "Keypoint candidates along each side of a portal; odd.", minimum=1, maximum=15)
    points_id: str = parameter("points", "Id of the obstacle that obstacle_points is made into.")
    points_resolution: float = parameter(
        0.02, "Edge of the voxels of obstacle_points [m].", minimum=1e-3, maximum=1.0, live=True
    )
    max_bodies: int = parameter(
        1000, "Most shapes of a scene, all obstacles together.", minimum=1, maximum=LARGEST.bodies, live=True
    )
    max_vertices: int = parameter(
        200_000, "Most vertices, and most triangles, of all meshes.", minimum=1, maximum=LARGEST.vertices, live=True
    )
    max_points: int = parameter(
        500_000, "Most points of all point clouds.", minimum=1, maximum=LARGEST.points, live=True
    )
    max_pairs: int = parameter(
        1000, "Most pairs of bodies that may touch.", minimum=0, maximum=LARGEST.pairs, live=True
    )
    max_name_length: int = parameter(
        256,
        "Most characters in the id of an obstacle or the name of a link.",
        minimum=1,
        maximum=LARGEST.name_length,
        live=True,
    )
    publish_edges: bool = parameter(
        False, "List the edges in keypoint_graph, though the portals imply them.", live=True
    )
    publish_markers: bool = parameter(True, "Publish decomposition_markers for RViz and Foxglove.", live=True)

    @property
    def limits(self) -> SizeLimits:
        return SizeLimits(self.max_bodies, self.max_vertices, self.max_points, self.max_pairs, self.max_name_length)

    def validate(self) -> None:
        if not self.points_id:
            raise InvalidOptionError("parameter points_id", self.points_id, "a name")
        if self.grid % 2 == 0:
            raise InvalidOptionError("parameter grid", self.grid, "an odd number")
        if not all(low < high for low, high in zip(self.workspace_min, self.workspace_max, strict=True)):
            raise InvalidOptionError("parameter workspace_min", self.workspace_min, "less than workspace_max")
