"""Obstacles, scenes, changes of scenes, files and generators."""

from bsp_informed_planner.scene.attached import AttachmentOperation, CollisionPermission
from bsp_informed_planner.scene.diff import ObstacleOperation, OperationKind, SceneDiff
from bsp_informed_planner.scene.diff import apply as apply_diff
from bsp_informed_planner.scene.maze import MazeOptions, MazeProblem, environment, random_maze
from bsp_informed_planner.scene.mesh_parts import convex_parts
from bsp_informed_planner.scene.moveit_yaml import load_scene, scene_from_moveit_yaml
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.polytopes import (
    ConvexPolytope,
    cross_section,
    polytopes_of,
    polytopes_of_obstacle,
    prism,
    scene_polytopes,
)
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import AttachedObstacle, Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import (
    Box,
    Cone,
    ConvexMesh,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from bsp_informed_planner.scene.shelf import (
    ShelfLevel,
    ShelfOptions,
    ShelfScene,
    random_shelf,
    sample_level_pose,
    sample_outside_pose,
)
from bsp_informed_planner.scene.voxels import merged_boxes
from bsp_informed_planner.scene.yaml_io import problem_from_yaml, save_scene, scene_from_yaml, scene_to_yaml

__all__ = [
    "AttachedObstacle",
    "AttachmentOperation",
    "Box",
    "CollisionPermission",
    "Cone",
    "ConvexMesh",
    "ConvexPolytope",
    "Cylinder",
    "FloatArray",
    "HalfSpace",
    "MazeOptions",
    "MazeProblem",
    "Mesh",
    "Obstacle",
    "ObstacleOperation",
    "OperationKind",
    "PointCloud",
    "Pose",
    "ScenarioProblem",
    "Scene",
    "SceneDiff",
    "Shape",
    "ShelfLevel",
    "ShelfOptions",
    "ShelfScene",
    "Sphere",
    "WorkspaceBounds",
    "apply_diff",
    "convex_parts",
    "cross_section",
    "environment",
    "load_scene",
    "merged_boxes",
    "polytopes_of",
    "polytopes_of_obstacle",
    "prism",
    "problem_from_yaml",
    "random_maze",
    "random_shelf",
    "sample_level_pose",
    "sample_outside_pose",
    "save_scene",
    "scene_from_moveit_yaml",
    "scene_from_yaml",
    "scene_polytopes",
    "scene_to_yaml",
]
