"""Tables and numbers of the guidance benchmark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Row
from bsp_informed_planner.benchmarks.guidance.chains import FIRST, NEAR, SAMPLES
from bsp_informed_planner.benchmarks.guidance.guides import JOINED, TITLES
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import (
    Estimate,
    bootstrap,
    mean,
    median,
    quantile_with_failures,
    share,
)
from bsp_informed_planner.scene.pose import FloatArray

#: A failed plan counts as so much in ratios and means [ms].
FAILED = 2000.0
HARD_RATIO, HARD_P90, NO_SCENE, LIBRARY, ALL_MEAN, COST, HARD_COST = 0.35, 10.0, 0.8, 1.0, 0.75, 0.92, 0.90
INFERENCE = 1.0


def groups(rows: Sequence[Row]) -> Mapping[str, list[Row]]:
    """Problems as they come, and the hard ones."""
    found = {
        "all": [row for row in rows if row["as_they_come"]],
        "hard": [row for row in rows if row["stratum"] == "hard"],
    }
    return {name: own for name, own in found.items() if own}


def times(rows: Sequence[Row], name: str, mode: str) -> FloatArray:
    """(problems, runs) [ms], infinite where a plan failed."""
    return np.array([[np.inf if v is None else float(v) for v in row[f"{name}_{mode}_ms"]] for row in rows])


def ratio(rows: Sequence[Row], name: str, beside: str, mode: str, rng: np.random.Generator) -> Estimate:
    """Geometric mean over problems of the time relative to another's; problems are resampled as wholes."""
    mine, theirs = (np.log(np.minimum(times(rows, key, mode), FAILED)).mean(axis=1) for key in (name, beside))
    return bootstrap(mine - theirs, lambda block: np.asarray(np.exp(block.mean(axis=1))), rng)


def cost_ratio(rows: Sequence[Row], name: str, beside: str, mode: str, rng: np.random.Generator) -> Estimate | float:
    """Mean over problems of the relative cost, where both solve all runs."""
    values = []
    for row in rows:
        mine, theirs = row[f"{name}_{mode}_cost"], row[f"{beside}_{mode}_cost"]
        if None not in mine and None not in theirs:
            values.append(float(np.mean(mine) / np.mean(theirs)))
    return mean(values, rng) if values else float("nan")


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """Chains and samples; plans with guidance at once; plans that try without it first; the required numbers."""
    names = [name for name in TITLES if f"{name}_at_once_ms" in rows[0]]
    section.text(
        "A UR5, random shelves from seeds that no training uses, one goal configuration, not to be reached by a "
        "straight line. *Hard* and *easy* as in the benchmark of planning. The scene has been planned in before: its "
        "encoding and decomposition are there, everything else is counted. Times are of one core, without validation "
        f"and timing of the trajectory; a plan that fails counts as {FAILED:g} ms in ratios and means."
    )
    by_group = groups(rows)
    for group, own in by_group.items():
        section.text(
            f"Chains and samples, {group} ({len(own)} problems). *Any free*: some chain is free as a whole. *Valid*: "
            f"of {SAMPLES} samples, proved free. *Covered*: points of a good path within {NEAR} rad of a free sample."
        )
        header = ["guidance", "any free", "chains free", "edges free", "valid", "covered", "guidance [ms]",
                  f"{FIRST} samples [ms]"]  # fmt: skip
        judged = [name for name in names if f"{name}_any_free" in own[0]]
        section.table(header, [_chains_row(own, name, rng) for name in judged if name != "plain"])
    for mode, title in (("at_once", "guidance at once"), ("hedged", "guidance after a short search without")):
        table = []
        for group, own in by_group.items():
            for name in names:
                values = times(own, name, mode)
                table.append([
                    f"{group}: {TITLES[name]}",
                    share(int(np.isfinite(values).sum()), values.size).scaled(100.0),
                    quantile_with_failures(values.ravel(), 0.5, rng),
                    quantile_with_failures(values.ravel(), 0.9, rng),
                    mean(np.minimum(values, FAILED).mean(axis=1), rng),
                    "1" if name == "plain" else ratio(own, name, "plain", mode, rng),
                    "1" if name == "plain" else cost_ratio(own, name, "plain", mode, rng),
                ])  # fmt: skip
        section.text(f"Plans, {title}:")
        header = ["", "solved [%]", "median [ms]", "90 % [ms]", "mean [ms]", "time / plain", "cost / plain"]
        section.table(header, table)
    if "learned" in names:
        _require(rows, by_group, names, section, rng)


def _chains_row(rows: Sequence[Row], name: str, rng: np.random.Generator) -> list[object]:
    def average(key: str) -> Estimate | str:
        known = [float(row[f"{name}_{key}"]) for row in rows if row.get(f"{name}_{key}") is not None]
        return mean(known, rng) if known else ""

    def middle(key: str) -> Estimate | str:
        known = [float(row[f"{name}_{key}"]) for row in rows if row.get(f"{name}_{key}") is not None]
        return median(known, rng) if known else ""

    shares = [average(key) for key in ("any_free", "free", "edges", "valid", "cover")]
    return [TITLES[name], *shares, middle("guide_ms"), middle("samples_ms")]


def _require(
    rows: Sequence[Row],
    by_group: Mapping[str, list[Row]],
    names: Sequence[str],
    section: Section,
    rng: np.random.Generator,
) -> None:
    inference = [float(row["learned_guide_ms"]) + float(row["learned_samples_ms"]) for row in rows]
    section.require(
        RequiredNumber(
            f"arm chains and first {FIRST} samples, median", median(inference, rng), "at most", INFERENCE, "ms"
        )
    )
    # What users get; controls are compared with the network alone, since nothing joins them either.
    used = JOINED if JOINED in names else "learned"
    if "hard" in by_group:
        own = by_group["hard"]
        plain = times(own, "plain", "at_once")
        section.require(
            RequiredNumber(
                "hard: time with the network at once / RRT-Connect", ratio(own, used, "plain", "at_once", rng),
                "at most", HARD_RATIO, remark=f"({len(own)} problems, RRT-Connect's median {np.median(plain):.1f} ms)",
            )
        )  # fmt: skip
        for mode in ("at_once", "hedged"):
            p90 = quantile_with_failures(times(own, used, mode).ravel(), 0.9, rng)
            section.require(RequiredNumber(f"hard: 90 % of times, {mode}", p90, "at most", HARD_P90, "ms"))
        section.require(
            RequiredNumber("hard: time, hedged / RRT-Connect", ratio(own, used, "plain", "hedged", rng), "reported")
        )
        if used != "learned":
            for name in ("learned", "exact"):
                value = ratio(own, used, name, "at_once", rng)
                section.require(RequiredNumber(f"hard: time, joined / {TITLES[name]} alone", value, "reported"))
        for beside, limit in (("no_scene", NO_SCENE), ("library", LIBRARY)):
            if beside in names:
                value = ratio(own, "learned", beside, "at_once", rng)
                section.require(RequiredNumber(f"hard: time / {TITLES[beside]}", value, "at most", limit))
        for beside in ("unrepaired", "no_scene_repaired", "library_repaired"):
            if beside in names:
                value = ratio(own, "learned", beside, "at_once", rng)
                section.require(RequiredNumber(f"hard: time / {TITLES[beside]}", value, "reported"))
        section.require(
            RequiredNumber(
                "hard: time, shown the right scene / another one",
                ratio(own, "learned", "wrong_scene", "at_once", rng), "reported",
            )
        )  # fmt: skip
        section.require(
            RequiredNumber(
                "hard: cost / RRT-Connect", cost_ratio(own, used, "plain", "at_once", rng), "at most", HARD_COST
            )
        )
    if "all" in by_group:
        own = by_group["all"]
        means = [np.minimum(times(own, name, "hedged"), FAILED).mean(axis=1) for name in (used, "plain")]
        section.require(
            RequiredNumber(
                "all: mean time, hedged / RRT-Connect", bootstrap(np.stack(means, axis=1), _ratio_of_means, rng),
                "at most", ALL_MEAN, remark=f"({len(own)} problems)",
            )
        )  # fmt: skip
        section.require(
            RequiredNumber("all: cost / RRT-Connect", cost_ratio(own, used, "plain", "at_once", rng), "at most", COST)
        )


def _ratio_of_means(block: FloatArray) -> FloatArray:
    """(r,) of pairs (r, n, 2)."""
    first, second = block.mean(axis=1).T
    return np.asarray(first / second)
