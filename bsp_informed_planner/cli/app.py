"""`bsp-planner`: commands and their options. The work is done in modules of their own, imported when needed."""

from __future__ import annotations

import logging
import sys
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bsp_informed_planner import __version__
from bsp_informed_planner.cli.benchmark import ModelsOption, QuickOption, SeedOption
from bsp_informed_planner.cli.benchmark import app as benchmark_app
from bsp_informed_planner.cli.measuring import as_text, measure
from bsp_informed_planner.cli.plain_errors import PlainErrors
from bsp_informed_planner.cli.robot import app as robot_app
from bsp_informed_planner.cli.robot_options import LockOption, PackageOption, SrdfOption, ToolOption

if TYPE_CHECKING:
    from bsp_informed_planner.cli.robots import RobotChoice

app = typer.Typer(
    name="bsp-planner",
    cls=PlainErrors,
    help="Plan collision-free, short paths for robot arms in cluttered spaces.",
    no_args_is_help=True,
    rich_markup_mode=None,  # or "[rad or m]" would be taken for markup
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(benchmark_app, name="benchmark")
app.add_typer(robot_app, name="robot")


class DemoRobot(str, Enum):
    """Robots that come with the package."""

    UR5 = "ur5"
    POINT = "point"


RobotOption = Annotated[DemoRobot, typer.Option(help="ur5: the arm at a shelf; point: a point robot in a 2D maze.")]
PlanRobotOption = Annotated[
    DemoRobot | None, typer.Option(help="As for `demo`; default: the one that a saved problem names, or ur5.")
]
UrdfOption = Annotated[
    Path | None,
    typer.Option(help="URDF of your own arm; it takes the place of --robot.", exists=True, dir_okay=False),
]
HostOption = Annotated[
    str, typer.Option(help="Address that the page is served at; 0.0.0.0 lets other computers look too.")
]
PortOption = Annotated[int, typer.Option(help="Port of the page, or the next one that is free.", min=0, max=65535)]


def _choice(
    robot: DemoRobot,
    urdf: Path | None,
    srdf: Path | None,
    package_dir: list[Path] | None,
    tool_frame: str | None,
    lock: list[str] | None,
) -> RobotChoice:
    from bsp_informed_planner.cli.robots import RobotChoice

    return RobotChoice(robot.value, urdf, srdf, tuple(package_dir or ()), tool_frame, tuple(lock or ()))


def _named_choice(
    robot: DemoRobot | None,
    urdf: Path | None,
    srdf: Path | None,
    package_dir: list[Path] | None,
    tool_frame: str | None,
    lock: list[str] | None,
) -> RobotChoice | None:
    """None if no option names a robot: a file may."""
    options = (srdf, package_dir, tool_frame, lock)
    if robot is None and urdf is None and not any(options):
        return None
    return _choice(robot or DemoRobot.UR5, urdf, *options)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"bsp-planner {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say what the library does.")] = False,
) -> None:
    """Plan collision-free, short paths for robot arms in cluttered spaces."""
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, format="%(name)s: %(message)s")


@app.command()
def demo(
    seed: Annotated[int, typer.Option(help="Picks the problem, and seeds the planner.", min=0)] = 1,
    robot: RobotOption = DemoRobot.UR5,
    seconds: Annotated[float, typer.Option(help="Planning time allowed [s].", min=0.1, max=60.0)] = 5.0,
    out: Annotated[Path, typer.Option(help="Folder for the picture.")] = Path("out"),
) -> None:
    """Start the three ROS 2 nodes, publish a random scene, call /plan, and draw the path.

    Ends with status 0 only if a verified path came back.
    """
    from bsp_informed_planner.cli.demo import run_demo

    raise typer.Exit(run_demo(seed, robot.value, seconds, out))


@app.command()
def nodes(
    robot: RobotOption = DemoRobot.UR5,
    urdf: UrdfOption = None,
    srdf: SrdfOption = None,
    package_dir: PackageOption = None,
    tool_frame: ToolOption = None,
    lock: LockOption = None,
    namespace: Annotated[str, typer.Option(help="ROS namespace of the nodes.")] = "",
    params_file: Annotated[
        Path | None, typer.Option(help="ROS parameter file, e.g. config/ur5.yaml.", exists=True, dir_okay=False)
    ] = None,
    restart: Annotated[bool, typer.Option(help="Start a node again that has crashed.")] = True,
) -> None:
    """Start the decomposition, inference and planner nodes, without `ros2 launch`. Ctrl-C stops them."""
    from bsp_informed_planner.cli.nodes import run_nodes

    choice = _choice(robot, urdf, srdf, package_dir, tool_frame, lock)
    raise typer.Exit(run_nodes(choice, namespace, params_file, restart))


@app.command()
def parameters(
    write: Annotated[Path | None, typer.Option(help="Write the table into this file, e.g. docs/parameters.md.")] = None,
) -> None:
    """Print the parameters of the nodes: types, defaults, bounds and meaning, as Markdown."""
    from bsp_informed_planner.cli.parameters import run_parameters

    raise typer.Exit(run_parameters(write))


@app.command()
def plan(
    scene: Annotated[
        Path,
        typer.Argument(
            help="Scene or problem file: our YAML, or a MoveIt planning scene; or a saved problem.", exists=True
        ),
    ],
    start: Annotated[
        str | None, typer.Option(help="Start: joint positions, comma-separated [rad or m]; default: the file's.")
    ] = None,
    goal: Annotated[str | None, typer.Option(help="Goal: joint positions, comma-separated [rad or m].")] = None,
    goal_pose: Annotated[
        str | None, typer.Option(help="Goal of the tool: x,y,z,roll,pitch,yaw in the root frame [m, rad].")
    ] = None,
    robot: PlanRobotOption = None,
    urdf: UrdfOption = None,
    srdf: SrdfOption = None,
    package_dir: PackageOption = None,
    tool_frame: ToolOption = None,
    lock: LockOption = None,
    planner_id: Annotated[
        str | None,
        typer.Option(help="anytime, rrt_connect, rrt_star, rrt or OMPL's ompl_...; default: the file's, or anytime."),
    ] = None,
    sampler_id: Annotated[
        str | None,
        typer.Option(
            help="keypoint_tube, uniform, learned, path_library, cvae_shortest_path or gmm; default: the file's, or "
            "keypoint_tube."
        ),
    ] = None,
    models: ModelsOption = None,
    seconds: Annotated[float | None, typer.Option(help="Planning time allowed [s]; default: the file's, or 5.")] = None,
    first: Annotated[bool, typer.Option("--first", help="Stop at the first verified path.")] = False,
    seed: Annotated[int | None, typer.Option(help="Seed of the planner; default: the file's, or drawn.", min=0)] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the whole result as JSON.")] = False,
    png: Annotated[Path | None, typer.Option(help="Draw the path into this file.")] = None,
) -> None:
    """Plan a path through a scene file, without ROS, or repeat a plan that a planner node has saved."""
    from bsp_informed_planner.cli.plan import PlanArguments, run_plan

    choice = _named_choice(robot, urdf, srdf, package_dir, tool_frame, lock)
    raise typer.Exit(
        run_plan(
            PlanArguments(
                scene,
                start,
                goal,
                goal_pose,
                choice,
                planner_id,
                sampler_id,
                models,
                seconds,
                first,
                seed,
                json,
                png,
            )
        )
    )


@app.command()
def decompose(
    scene: Annotated[
        Path, typer.Argument(help="Scene or problem file: our YAML, or a MoveIt planning scene.", exists=True)
    ],
    dimension: Annotated[int, typer.Option(help="3, or 2 for a horizontal section.", min=2, max=3)] = 3,
    height: Annotated[float, typer.Option(help="Of the section, with --dimension 2: its z [m].")] = 0.0,
    grid: Annotated[int, typer.Option(help="Keypoint candidates along each side of a portal; odd.", min=1)] = 3,
    json: Annotated[bool, typer.Option("--json", help="Print cells, portals, candidates and times as JSON.")] = False,
    png: Annotated[Path | None, typer.Option(help="Draw cells, portals and candidates into this file.")] = None,
    view: Annotated[bool, typer.Option("--view", help="Show it in a browser, to turn and try; Ctrl-C ends.")] = False,
    host: HostOption = "localhost",
    port: PortOption = 8080,
) -> None:
    """Partition a scene file by BSP, and say what came of it."""
    from bsp_informed_planner.cli.decompose import run_decompose
    from bsp_informed_planner.decomposition.options import DecompositionOptions

    options = DecompositionOptions(dimension=dimension, grid=grid, section_height=height)
    raise typer.Exit(run_decompose(scene, options, json, png, (host, port) if view else None))


@app.command()
def view(
    scene: Annotated[
        Path | None,
        typer.Argument(
            help="Scene or problem file: our YAML, or a MoveIt planning scene. Default: a random example.", exists=True
        ),
    ] = None,
    robot: PlanRobotOption = None,
    urdf: UrdfOption = None,
    srdf: SrdfOption = None,
    package_dir: PackageOption = None,
    tool_frame: ToolOption = None,
    lock: LockOption = None,
    nodes: Annotated[
        bool, typer.Option("--nodes", help="Show the scene of running nodes, and plan through them; no file then.")
    ] = False,
    namespace: Annotated[str, typer.Option(help="ROS namespace of the nodes.")] = "",
    seed: Annotated[int, typer.Option(help="Picks the example.", min=0)] = 1,
    host: HostOption = "localhost",
    port: PortOption = 8080,
) -> None:
    """Show a robot in a scene in a browser: set start and goal, plan, watch it move. Ctrl-C ends."""
    from bsp_informed_planner.cli.view import ViewArguments, run_view

    choice = _named_choice(robot, urdf, srdf, package_dir, tool_frame, lock)
    raise typer.Exit(run_view(ViewArguments(scene, choice, nodes, namespace, seed, host, port)))


@app.command()
def collect(
    folder: Annotated[Path | None, typer.Argument(help="Folder of the dataset; also --out.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the dataset. A rerun goes on there.")] = None,
    describe: Annotated[bool, typer.Option("--describe", help="Only say what is in the folder.")] = False,
    robot: RobotOption = DemoRobot.UR5,
    urdf: UrdfOption = None,
    srdf: SrdfOption = None,
    package_dir: PackageOption = None,
    tool_frame: ToolOption = None,
    lock: LockOption = None,
    family: Annotated[
        str | None, typer.Option(help="maze, shelf or files; default: what suits the robot, files with --scenes.")
    ] = None,
    scenes: Annotated[
        Path | None, typer.Option(help="Folder of scene or problem files.", exists=True, file_okay=False)
    ] = None,
    problems: Annotated[int, typer.Option(help="Problems for training.", min=0)] = 1000,
    validation: Annotated[int, typer.Option(help="Problems for validation, of seeds of their own.", min=0)] = 0,
    test: Annotated[int, typer.Option(help="Problems for tests, of seeds of their own.", min=0)] = 0,
    seed: Annotated[int, typer.Option(help="Of the whole collection.", min=0)] = 0,
    workers: Annotated[int, typer.Option(help="Processes on this machine.", min=1)] = 1,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, e.g. tcp://10.0.0.1:8786; instead of --workers.")
    ] = None,
    goals: Annotated[
        str, typer.Option(help="Of the configurations of a goal pose: random takes one, any the best.")
    ] = "random",
    epsilon: Annotated[
        float | None, typer.Option(help="Keypoints closer than this are merged [m]; default: by robot.", min=0.0)
    ] = None,
    paths_only: Annotated[
        bool, typer.Option("--paths-only", help="Paths of whole problems without keypoints: several times faster.")
    ] = False,
) -> None:
    """Collect experience: solve random problems as the paper's Algorithm 2 does, and store keypoints and paths.

    The same options give the same rows, whatever the number of workers. After Ctrl-C or a kill, the same command goes
    on from the files that are finished; a larger number of problems adds to them.
    """
    from bsp_informed_planner.cli.collect import CollectArguments, print_description, run_collect
    from bsp_informed_planner.errors import InvalidOptionError

    target = out or folder
    if target is None or (out is not None and folder is not None):
        raise InvalidOptionError("--out", [str(path) for path in (folder, out) if path], "one folder")
    if describe:
        print_description(target)
        raise typer.Exit
    raise typer.Exit(
        run_collect(
            CollectArguments(
                target,
                _choice(robot, urdf, srdf, package_dir, tool_frame, lock),
                family,
                scenes,
                problems,
                validation,
                test,
                seed,
                workers,
                scheduler,
                goals,
                epsilon,
                paths_only,
            )
        )
    )


@app.command()
def evaluate(
    robot: RobotOption = DemoRobot.UR5,
    quick: QuickOption = False,
    seed: SeedOption = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results; default: in out/. A rerun continues there.")
    ] = None,
    models: ModelsOption = None,
    controls: Annotated[
        Path | None,
        typer.Option(help="Folder of a model of kind path_chains_without_scene.", exists=True, file_okay=False),
    ] = None,
) -> None:
    """Measure what learned guidance is worth, on scenes that no training has seen.

    For a UR5 in shelves, chains, samples and plans, beside exact keypoints, a path library and controls that see less;
    for a point in mazes, chains and samples. Ends with one line for each number: it holds or falls short.
    """
    from bsp_informed_planner.benchmarks.guidance.benchmark import guidance_benchmark
    from bsp_informed_planner.benchmarks.networks.benchmark import networks_benchmark

    if robot is DemoRobot.POINT:
        if controls is not None:
            raise typer.BadParameter("there are no such controls for mazes", param_hint="--controls")
        benchmark = networks_benchmark(quick, as_text(models))
    else:
        benchmark = guidance_benchmark(quick, as_text(models), as_text(controls))
    words = f"evaluate --robot {robot.value}"
    measure(benchmark, words, seed, out, quick=quick, models=models, controls=controls)


@app.command()
def train(
    dataset: Annotated[Path, typer.Argument(help="Folder of a dataset, see `collect`.", exists=True, file_okay=False)],
    out: Annotated[Path, typer.Option(help="Folder of weights, card, checkpoint and TensorBoard curves.")],
    model: Annotated[
        str,
        typer.Option(
            help="heatmap or segment_cvae (for planar robots), path_chains (for arms), path_chains_without_scene, "
            "sequential_regression, cvae, cvae_shortest_path, path_library or gmm."
        ),
    ] = "heatmap",
    name: Annotated[str | None, typer.Option(help="Of the files; default: family of the problems and model.")] = None,
    problems: Annotated[int | None, typer.Option(help="Train on at most so many problems.", min=1)] = None,
    steps: Annotated[int | None, typer.Option(help="Steps of the optimiser; default: by model.", min=1)] = None,
    batch_size: Annotated[int | None, typer.Option(help="Examples a step, on all devices.", min=1)] = None,
    learning_rate: Annotated[float | None, typer.Option(help="The largest; it falls as a cosine.")] = None,
    validate_every: Annotated[int | None, typer.Option(help="Steps between validations and checkpoints.")] = None,
    patience: Annotated[
        int | None, typer.Option(help="End after so many validations without a better one; 0: never.", min=0)
    ] = None,
    seed: Annotated[int, typer.Option(help="Of weights, order and augmentation.", min=0)] = 0,
    device: Annotated[str, typer.Option(help="cpu or cuda; for several processes start with torchrun.")] = "cpu",
    threads: Annotated[int, typer.Option(help="Of torch, in each process.", min=1)] = 1,
) -> None:
    """Train a model on a dataset (the paper's Algorithm 1).

    After Ctrl-C or a kill the same command goes on from the last checkpoint, to the same end. On several devices:
    torchrun --nproc-per-node N -m bsp_informed_planner.cli.app train ...
    """
    from bsp_informed_planner.cli.train import TrainArguments, run_train

    raise typer.Exit(
        run_train(
            TrainArguments(
                dataset,
                model,
                out,
                name,
                problems,
                steps,
                batch_size,
                learning_rate,
                validate_every,
                patience,
                seed,
                device,
                threads,
            )
        )
    )


def main() -> None:
    """Entry point of `bsp-planner`. An expected error is a sentence, not a traceback."""
    from bsp_informed_planner.errors import BspPlannerError

    try:
        app()
    except BspPlannerError as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
