"""What settings do in unseen mazes: lambda, the longest step, the merge radius, the weights of the mixture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.maze.analysis import cost_ratio, ratio_of_means, samples_to_first, success
from bsp_informed_planner.benchmarks.maze.runs import Protocol, Runs, run_methods
from bsp_informed_planner.benchmarks.maze.samplers import SAMPLERS, TUBE, Made, MazeSampler
from bsp_informed_planner.benchmarks.maze.world import MazeWorld
from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.decomposition.merging import merge_keypoints
from bsp_informed_planner.planning.rrt_star import GOAL_BIAS
from bsp_informed_planner.sampling.sampler import MixtureSampler
from bsp_informed_planner.sampling.tube import tube_sampler
from bsp_informed_planner.scene.pose import FloatArray

SAMPLES = 3000
GRID = (400, SAMPLES)
ETA, WIDE_ETA = 0.05, 0.1
#: Beyond this clearance a segment is no harder for it [m].
WIDE = 0.06


@dataclass(frozen=True)
class Setting:
    """One setting of an ablation.

    Attributes:
        group: what is varied.
        title: for people.
        sampler: and what of it.
        uniform_fraction: lambda.
        max_step: eta [m].
        goal_bias: see `Protocol`.
        base: the setting that it is compared with; empty: itself.
    """

    group: str
    title: str
    sampler: MazeSampler
    uniform_fraction: float = 0.5
    max_step: float = ETA
    goal_bias: float = GOAL_BIAS
    base: str = "uniform"


def _merged(epsilon: float, keep_sight: bool, world: MazeWorld, seed: int, models: str | None) -> Made:
    chain = np.column_stack((world.exact_chain, np.zeros(len(world.exact_chain))))
    merged = merge_keypoints(chain, epsilon, world.decomposition if keep_sight else None)[:, :2]
    return Made(tube_sampler([merged], TUBE, world.robot.lower, world.robot.upper))


def _weighted(kind: str, world: MazeWorld, seed: int, models: str | None) -> Made:
    chain = world.exact_chain
    pairs = list(zip(chain[:-1], chain[1:], strict=True))
    locals_ = [tube_sampler([np.stack(pair)], TUBE, world.robot.lower, world.robot.upper) for pair in pairs]
    return Made(MixtureSampler(locals_, _weights(kind, chain, world)))


def _weights(kind: str, chain: FloatArray, world: MazeWorld) -> list[float]:
    """One for each segment of a chain (m, 2). `difficulty`: the narrower its narrowest place, the more."""
    lengths = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    if kind == "equal":
        return [1.0] * len(lengths)
    if kind == "length":
        return [float(length) for length in lengths]
    places = np.linspace(0.0, 1.0, 21)[:, None]
    narrowest = [
        float(world.distance.at(a + places * (b - a)).min()) for a, b in zip(chain[:-1], chain[1:], strict=True)
    ]
    return [float(WIDE / np.clip(clearance, 0.1 * WIDE, WIDE)) for clearance in narrowest]


def _settings() -> Mapping[str, Setting]:
    tube = SAMPLERS["exact_tube"]
    network = SAMPLERS["network_fallback"]
    found = {"uniform": Setting("lambda", "1 (uniform)", SAMPLERS["uniform"])}
    for fraction in (0.0, 0.1, 0.25, 0.5, 0.75, 0.9):
        found[f"lambda_{fraction:g}_tube"] = Setting("lambda", f"{fraction:g}, {tube.title}", tube, fraction)
    for fraction in (0.0, 0.25, 0.5, 0.75):
        found[f"lambda_{fraction:g}_network"] = Setting("lambda", f"{fraction:g}, {network.title}", network, fraction)
    found["wide_uniform"] = Setting("eta", "0.1, uniform", SAMPLERS["uniform"], max_step=WIDE_ETA, base="wide_uniform")
    for name in ("shortest_path", "network_plain", "network_fallback", "exact", "exact_tube", "perfect"):
        title = f"0.1, {SAMPLERS[name].title}"
        found[f"wide_{name}"] = Setting("eta", title, SAMPLERS[name], max_step=WIDE_ETA, base="wide_uniform")
    for name in ("uniform", "shortest_path", "network_fallback", "exact_tube", "perfect"):
        title = f"0, {SAMPLERS[name].title}"
        found[f"unbiased_{name}"] = Setting("goal bias", title, SAMPLERS[name], goal_bias=0.0, base="unbiased_uniform")
    for epsilon in (0.0, 0.03, 0.06, 0.1):
        for keep_sight in (False, True) if epsilon else (False,):
            title = f"{epsilon:g} m" + (", line of sight kept" if keep_sight else "")
            sampler = MazeSampler(title, partial(_merged, epsilon, keep_sight))
            found[f"merge_{epsilon:g}{'_sight' if keep_sight else ''}"] = Setting("merge radius", title, sampler)
    for kind in ("equal", "length", "difficulty"):
        found[f"weights_{kind}"] = Setting("weights", kind, MazeSampler(kind, partial(_weighted, kind)))
    return found


SETTINGS = _settings()
EXPLANATIONS = {
    "lambda": "**Lambda**, the share of uniform samples (eta 0.05).",
    "eta": "**Eta 0.1** instead of 0.05: the longer the steps, the less there is to gain. Relative to uniform's.",
    "goal bias": "**No goal bias** (0 instead of 0.05), eta 0.05; relative to uniform's.",
    "merge radius": (
        "**Merge radius** epsilon of Algorithm 2, exact keypoints with a Gaussian tube; the paper's midpoints can cut "
        "corners, unless line of sight is kept."
    ),
    "weights": (
        "**Weights of the mixture**, exact keypoints with a Gaussian tube: equal, by the length of the segments (as "
        "everywhere else), or by how narrow their narrowest places are."
    ),
}


def ablations_part(quick: bool, models: str | None) -> Part:
    """All settings in the same mazes."""
    count, runs = (6, 1) if quick else (80, 2)
    cases: list[Parameters] = [{"models": models, "runs": runs} for _ in range(count)]
    return Part("ablations", "What the settings do", cases, measure, summarise, Mode.PINNED)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """All settings in one maze."""
    world = MazeWorld.random(rng)
    row: dict[str, object] = {}
    for name, setting in SETTINGS.items():
        protocol = Protocol(
            int(parameters["runs"]), SAMPLES, GRID, setting.uniform_fraction, setting.max_step, setting.goal_bias
        )
        row.update(run_methods(world, {name: setting.sampler}, protocol, parameters["models"], rng))
    return row


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table for each thing that is varied."""
    runs = {name: Runs.of(rows, name) for name in SETTINGS if f"{name}_first" in rows[0]}
    mazes, repeats = runs["uniform"].first.shape
    section.text(
        f"{mazes} other random mazes, {repeats} runs of each setting in each, {SAMPLES:,} samples; columns as above."
    )
    for group, explanation in EXPLANATIONS.items():
        section.text(explanation)
        section.table(
            ["", "samples to the first path", "success at 400", f"cost at {SAMPLES:,}"],
            [
                [
                    SETTINGS[name].title,
                    ratio_of_means(
                        samples_to_first(found, SAMPLES), samples_to_first(runs[SETTINGS[name].base], SAMPLES), rng
                    ),
                    success(found, 400, rng),
                    cost_ratio(found, runs[SETTINGS[name].base], len(GRID) - 1, rng)[0],
                ]
                for name, found in runs.items()
                if SETTINGS[name].group == group
            ],
        )
