"""Scenes that no network has seen: shelves of other sizes, tables, a cage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.benchmarks.shelf.analysis import SOON, add_time_tables
from bsp_informed_planner.benchmarks.shelf.families import TRANSFER
from bsp_informed_planner.benchmarks.shelf.runs import Limits, draw_situation, run_planners, run_samplers
from bsp_informed_planner.planning.path import path_length


def transfer_part(quick: bool, models: str | None) -> Part:
    """Problems as they come, of each family."""
    cases: list[Parameters] = [
        {"family": family, "models": models, "star_seconds": 1.2e-3 * SOON, "seconds": 1.2e-3 * SOON}
        for _ in range(1 if quick else 30)
        for family in TRANSFER
    ]
    return Part("transfer", "Scenes of other kinds", cases, measure, summarise, Mode.PINNED)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Everything on one problem."""
    limits = Limits(float(parameters["star_seconds"]), float(parameters["seconds"]))
    problem, situation = draw_situation(rng, None, TRANSFER[str(parameters["family"])].draw)
    return {
        "family": parameters["family"],
        "stratum": problem.stratum,
        "best": path_length(situation.best),
        **run_samplers(situation, limits, parameters["models"], rng),
        **run_planners(problem, limits, rng),
    }


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table for each family."""
    section.text(
        "The same measures where nothing was trained or tuned: problems as they come, chosen as above, of families of "
        "scenes that neither training nor the settings of the guides have seen."
    )
    for name, family in TRANSFER.items():
        own = [row for row in rows if row["family"] == name]
        if own:
            hard = sum(row["stratum"] == "hard" for row in own)
            section.text(f"**{family.title.capitalize()}** ({len(own)} problems, {hard} of them hard):")
            add_time_tables(own, section, rng)
