"""Samples in environments 1 and 2 without and with decomposition: the paper's first figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.maze.environments import ENVIRONMENTS
from bsp_informed_planner.benchmarks.maze.figures import draw_samples
from bsp_informed_planner.benchmarks.maze.samplers import SAMPLERS
from bsp_informed_planner.benchmarks.maze.world import MazeWorld
from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.errors import ModelUnavailableError
from bsp_informed_planner.scene.maze import environment

SAMPLES = 300
PANELS = {"shortest_path": "without decomposition", "network_fallback": "with decomposition"}


def pictures_part(models: str | None) -> Part:
    """One picture for each environment."""
    cases: list[Parameters] = [{"environment": chosen, "models": models} for chosen in ENVIRONMENTS]
    return Part("samples", "Samples without and with decomposition", cases, measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Samples of both methods, and how many of them are valid."""
    row: dict[str, object] = {"environment": parameters["environment"]}
    for name in PANELS:
        world = MazeWorld(environment(int(parameters["environment"])))
        try:
            made = SAMPLERS[name].make(world, int(rng.integers(2**32)), parameters["models"])
        except ModelUnavailableError:
            continue
        samples = made.sampler.sample(rng, SAMPLES)
        row[f"{name}_samples"] = np.round(samples, 4).tolist()
        row[f"{name}_valid"] = int((world.distance.at(samples) > 0.0).sum())
        row[f"{name}_fallback"] = made.fallback
    return row


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """The pictures."""
    section.text(
        f"{SAMPLES} samples of the CVAE on whole paths (left) and of ours with the network's keypoints (right), no "
        "uniform ones among them; start: blue cross, goal: red star. The paper: without decomposition samples lie in "
        "the walls or along the straight line, with it most are valid."
    )
    for row in rows:
        shown = [name for name in PANELS if f"{name}_samples" in row]
        if not shown:
            section.text("Left out: the models are not there.")
            continue
        panels = {
            f"{SAMPLERS[name].title}, {PANELS[name]}: {row[f'{name}_valid']} of {SAMPLES} valid": np.array(
                row[f"{name}_samples"]
            )
            for name in shown
        }
        maze = environment(int(row["environment"]))
        title = f"Environment {row['environment']}"
        figure = draw_samples(title, maze, panels)
        section.picture(f"samples-{row['environment']}", figure, f"{title}: samples without and with decomposition")
        if reason := row.get("network_fallback_fallback"):
            section.text(f"In this run of environment {row['environment']} the network fell back to {reason}.")
