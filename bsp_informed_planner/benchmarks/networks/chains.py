"""Chains of keypoints in unseen mazes: how many are worth anything."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.maze.world import ChainVerdict, MazeWorld
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import Estimate, column, median, share
from bsp_informed_planner.errors import ModelUnavailableError
from bsp_informed_planner.networks.registry import Model
from bsp_informed_planner.sampling.keypoint_estimation import SceneView, estimator_of
from bsp_informed_planner.sampling.models import find_model

#: Chains drawn from a network.
CHAINS = 16
#: Share of mazes in which the likeliest chain, and the best of 16, must be usable.
PLAIN, BEST = 0.80, 0.95
NETWORKS = {"heatmap": "heatmap", "sequential_regression": "regression (paper)"}


def chains_part(quick: bool, models: str | None) -> Part:
    """Chains of each keypoint model in a folder, of the exact chain, and of the straight line."""
    cases: list[Parameters] = [{"models": models, "chains": CHAINS}] * (60 if quick else 600)
    return Part("chains", "Keypoint chains in unseen mazes", cases, measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Judges the chains of all estimators in one maze."""
    world = MazeWorld.random(rng)
    row: dict[str, object] = {}
    chains = {"exact": world.exact_chain, "straight": np.stack((world.start, world.goal))}
    for name, chain in chains.items():
        row.update({f"{name}_{key}": value for key, value in _described(world.judge(chain, True)).items()})
    for kind in NETWORKS:
        try:
            model = find_model(world.robot, (kind,), parameters["models"])
        except ModelUnavailableError:
            continue
        judged = judge_network(model, world, int(parameters["chains"]), rng)
        row.update({f"{kind}_{key}": value for key, value in judged.items()})
    return row


def judge_network(model: Model, world: MazeWorld, count: int, rng: np.random.Generator) -> dict[str, object]:
    """What the chains of a keypoint network are worth in a maze.

    Returns:
        the verdict on the likeliest chain, by the names of its attributes; `best_usable` and `best_free`, whether any
        of `count` chains is, with the length of the shortest such one relative to the exact chain's, or None; the
        share of all that is usable; times.
    """
    begin = time.perf_counter()
    view = SceneView.of(world.scene, model)
    encoded = time.perf_counter()
    chains = estimator_of(model).chains(view, world.start, world.goal, count, rng)
    drawn = time.perf_counter()
    verdicts = [world.judge(chain.configurations, chain.reached) for chain in chains]
    found = _described(verdicts[0])
    found["encoding_ms"], found["chains_ms"] = 1e3 * (encoded - begin), 1e3 * (drawn - encoded)
    found["of_all_usable"] = float(np.mean([verdict.usable for verdict in verdicts]))
    exact = world.judge(world.exact_chain, True).length
    for name in ("usable", "free"):
        good = [verdict.length for verdict in verdicts if getattr(verdict, name)]
        found[f"best_{name}"] = bool(good)
        found[f"best_{name}_length"] = min(good) / exact if good else None
    return found


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table of shares, and the required numbers."""
    section.text(
        f"One maze and problem a case. *Plain* is the likeliest chain of a network, *best of {CHAINS}* is whether any "
        f"of {CHAINS} chains, the plain one among them, is good, which a check then tells. A chain is *usable* if it "
        "ends at the goal, no keypoint lies in a wall, and all its segments are free of walls that are 1 cm thinner on "
        "each side; *free* if they are free of the walls as they are. Times are of one core, compiled and warm."
    )
    kinds = ["straight", "exact", *(kind for kind in NETWORKS if f"{kind}_usable" in rows[0])]
    names = ("reached", "valid", "connected", "nearly", "usable", "free")
    table: list[list[object]] = []
    for kind in kinds:
        table.append([NETWORKS.get(kind, kind), *(_share(rows, f"{kind}_{name}") for name in names), "", ""])
        if f"{kind}_best_usable" in rows[0]:
            table[-1][-2:] = [_share(rows, f"{kind}_best_usable"), _share(rows, f"{kind}_best_free")]
    section.table(["chains", *names, f"usable, best of {CHAINS}", f"free, best of {CHAINS}"], table)
    networks = [kind for kind in kinds if kind in NETWORKS]
    if networks:
        section.table(
            ["network", "encoding [ms]", f"{CHAINS} chains [ms]", "usable of all drawn", "length of best free / exact"],
            [
                [
                    NETWORKS[kind],
                    median(column(rows, f"{kind}_encoding_ms"), rng),
                    median(column(rows, f"{kind}_chains_ms"), rng),
                    float(column(rows, f"{kind}_of_all_usable").mean()),
                    _median_known(rows, f"{kind}_best_free_length", rng),
                ]
                for kind in networks
            ],
        )
    if "heatmap" in kinds:
        count = f"of {len(rows)} mazes"
        plain, best = _share(rows, "heatmap_usable"), _share(rows, "heatmap_best_usable")
        section.require(RequiredNumber("keypoint chains usable, plain", plain, "at least", PLAIN, remark=count))
        section.require(
            RequiredNumber(f"keypoint chains usable, best of {CHAINS}", best, "at least", BEST, remark=count)
        )
        for name, key in (("plain", "heatmap_free"), (f"best of {CHAINS}", "heatmap_best_free")):
            section.require(
                RequiredNumber(f"keypoint chains free outright, {name}", _share(rows, key), "reported", remark=count)
            )


def _described(verdict: ChainVerdict) -> dict[str, object]:
    names = ("reached", "valid", "connected", "nearly", "usable", "free", "length", "keypoints")
    return {name: getattr(verdict, name) for name in names}


def _share(rows: Sequence[Row], name: str) -> Estimate:
    return share(sum(bool(row[name]) for row in rows), len(rows))


def _median_known(rows: Sequence[Row], name: str, rng: np.random.Generator) -> Estimate | str:
    known = [row[name] for row in rows if row[name] is not None]
    return median(known, rng) if known else "none"
