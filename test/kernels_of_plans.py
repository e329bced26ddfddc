"""Plans of many kinds after all kernels were called once: prints each signature that is compiled nevertheless.

A script, since what other tests have compiled in a process would hide it.
"""

from __future__ import annotations

import gc
import sys

import numpy as np
from numba.core.dispatcher import Dispatcher

from bsp_informed_planner.compile_kernels import compile_kernels
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.incremental import IncrementalDecomposer
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import PlanningFailedError
from bsp_informed_planner.planning import JointGoal, Planner, PlanningProblem, PlanOptions, PoseGoal
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.sampling.guide import SAMPLER_IDS
from bsp_informed_planner.scene.diff import ObstacleOperation, SceneDiff, apply
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene
from bsp_informed_planner.scene.shapes import Cone, ConvexMesh, Cylinder, Mesh, PointCloud, Shape, Sphere

Signatures = set[tuple[str, str, str]]


def signatures() -> Signatures:
    """Of all kernels of the package that this process has compiled or loaded."""
    kernels = [value for value in gc.get_objects() if isinstance(value, Dispatcher)]
    own = [kernel for kernel in kernels if kernel.py_func.__module__.startswith("bsp_informed_planner")]
    return {
        (kernel.py_func.__module__, kernel.py_func.__name__, str(types))
        for kernel in own
        for types in kernel.signatures
    }


def with_other_shapes(scene: Scene) -> Scene:
    """The scene, and one of each other shape out of the way."""
    corners = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    shapes: list[Shape] = [
        Sphere(0.05),
        Cylinder(0.05, 0.1),
        Cone(0.05, 0.1),
        ConvexMesh(corners),
        Mesh(corners, faces),
        PointCloud(corners, 0.01),
    ]
    far = [-0.5, -0.5]
    placed = [
        Obstacle.of(f"shape_{index}", shape, Pose.from_xyz_rpy([*far, 0.2 * index], [0.0, 0.0, 0.0]))
        for index, shape in enumerate(shapes)
    ]
    return Scene.of([*scene.obstacles.values(), *placed], scene.bounds, scene.frame)


def try_plans(planner: Planner, problem: PlanningProblem, planner_ids: tuple[str, ...]) -> None:
    """One of each sampler and planner, by one thread and by two, guided from the first moment on."""
    for sampler_id in SAMPLER_IDS:
        for planner_id in planner_ids:
            for threads in (1, 2):
                options = PlanOptions(
                    planner_id=planner_id,
                    sampler_id=sampler_id,
                    threads=threads,
                    head_start=0,
                    allowed_seconds=5.0,
                    max_samples=1000,
                    seed=0,
                )
                try:
                    planner.plan(problem, options)
                except PlanningFailedError:
                    continue


def main() -> None:
    compile_kernels()
    before = signatures()
    maze = random_maze(np.random.default_rng(0)).problem
    planner = Planner(PointRobot(), maze.scene)
    try_plans(planner, PlanningProblem(maze.start, [JointGoal(maze.goals[0])]), ("anytime", "rrt_star"))
    arm = ur5()
    for seed in range(2):
        shelf = random_shelf_problem(arm, np.random.default_rng(seed))
        scene = with_other_shapes(shelf.scene) if seed else shelf.scene
        planner = Planner(arm, scene)
        planner.get_ready(2)
        problem = PlanningProblem(shelf.start, [PoseGoal(shelf.goal_poses[0])])
        try_plans(planner, problem, ("anytime", "rrt_star"))
        planner.plan(problem, PlanOptions(padding=0.005, seed=0, first_solution=True))
    decomposer = IncrementalDecomposer(DecompositionOptions())
    decomposer.decompose(shelf.scene)
    moved = next(iter(shelf.scene.obstacles))
    decomposer.decompose(apply(shelf.scene, SceneDiff.of(ObstacleOperation.remove(moved))))
    decompose(shelf.scene)
    for module, name, types in sorted(signatures() - before):
        sys.stdout.write(f"{module} {name} {types}\n")


if __name__ == "__main__":
    main()
