"""The benchmark of conservative collision checking, put together."""

from __future__ import annotations

from bsp_informed_planner.benchmarks.benchmark import Benchmark
from bsp_informed_planner.benchmarks.collision.edges import edges_part
from bsp_informed_planner.benchmarks.collision.setting_up import setting_up_part
from bsp_informed_planner.benchmarks.collision.speed import speed_part
from bsp_informed_planner.benchmarks.collision.states import inside_part, states_part
from bsp_informed_planner.benchmarks.collision.subjects import ROBOTS, robot_of
from bsp_informed_planner.collision import warm_up
from bsp_informed_planner.collision.bounds import bounds_of


def prepare() -> None:
    """Compiles the kernels and builds the covers, or loads them from their caches."""
    warm_up.warm_up()
    for name in ROBOTS:
        bounds_of(robot_of(name))


def collision_benchmark(quick: bool) -> Benchmark:
    """Times first, on a machine that we leave alone; then checks, in parallel."""
    return Benchmark(
        name="collision",
        title="Benchmark of conservative collision checking",
        introduction=(
            "Kernels decide most states and edges from spheres around and inside the robot's bodies. Whether their "
            "verdicts are right, how many states and edges they decide, and how fast they are, against Pinocchio and "
            "coal on the robots' own geometry. Robots are those of example-robot-data: UR5, Franka Panda and PAL Tiago "
            "with its torso. Scenes are random, from seeds that nothing was tuned on."
        ),
        parts=(speed_part(quick), setting_up_part(quick), states_part(quick), inside_part(quick), edges_part(quick)),
        sources=("scene", "robots", "collision", "benchmarks"),
        prepare=prepare,
    )
