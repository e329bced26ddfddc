"""Time, size and memory of decompositions against the number of facets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.charts import (
    COLOURS,
    label,
    legend,
    legend_below,
    logarithmic,
    medians_with_spread,
    new_figure,
    stacked_bars,
)
from bsp_informed_planner.benchmarks.decomposition.scenes import FACETS_OF_BOX, clutter, fresh, shelving
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import Estimate, column, growth_exponent, median
from bsp_informed_planner.benchmarks.stopwatch import peak_memory, time_calls
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.scene.scene import Scene

SIZES = (10, 30, 100, 300, 1000, 3000, 10000)
# The exponent is of these sizes and larger: below, fixed costs count most.
EXPONENT_FROM = 100
FAMILIES = (("shelving", 3), ("clutter", 3), ("shelving", 2), ("clutter", 2))
STAGES = ("scene", "partition", "cutting", "graph")
COUNTS = ("leaves", "portals", "candidates", "edges", "splits")
MILLISECONDS_OF_1000_FACETS = 50.0


def growth_part(quick: bool, sizes: Sequence[int] = SIZES) -> Part:
    """Times and sizes."""
    scenes = 2 if quick else 12
    cases = _cases(sizes, scenes, repeats=3 if quick else 7)
    return Part("growth", "Time and size against the number of facets", cases, measure, summarise, Mode.ALONE)


def memory_part(quick: bool) -> Part:
    """Memory, each scene in a process of its own."""
    cases = _cases((10000,) if quick else (1000, 3000, 10000), 1, repeats=1)
    return Part("memory", "Memory", cases[:2] if quick else cases, measure_memory, summarise_memory, Mode.FRESH)


def _cases(sizes: Sequence[int], scenes: int, repeats: int) -> list[Parameters]:
    return [
        {"kind": kind, "dimension": dimension, "facets": size, "repeats": repeats}
        for size in sizes
        for kind, dimension in FAMILIES
        for _ in range(scenes)
    ]


def _scene(parameters: Parameters, rng: np.random.Generator) -> tuple[Scene, DecompositionOptions]:
    dimension, facets = int(parameters["dimension"]), int(parameters["facets"])
    boxes = max(1, round(facets / FACETS_OF_BOX[dimension]))
    make = shelving if parameters["kind"] == "shelving" else clutter
    return make(rng, boxes, dimension), DecompositionOptions(dimension=dimension)


def _family(parameters: Parameters) -> str:
    return f"{parameters['kind']}, {parameters['dimension']}D"


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Times one scene."""
    scene, options = _scene(parameters, rng)
    timings = []

    def run(copy: Scene) -> None:
        timings.append(decompose(copy, options).timings)

    times = time_calls(run, lambda: fresh(scene), repeats=int(parameters["repeats"]), seconds=2.0)
    result = decompose(scene, options)
    stages = np.median(
        [(t.scene_seconds, t.partition_seconds, t.portal_seconds, t.graph_seconds) for t in timings[1:]], axis=0
    )
    return {
        "family": _family(parameters),
        "size": parameters["facets"],
        "facets": len(scene.obstacles) * FACETS_OF_BOX[options.dimension],
        "leaves": len(result.leaves),
        "portals": result.portal_count,
        "candidates": result.candidate_count,
        "edges": result.edge_count,
        "splits": result.split_count,
        "wall": times.wall,
        "fastest": times.fastest,
        "processor": times.processor,
        "repeats": times.repeats,
        **dict(zip(STAGES, stages.tolist(), strict=True)),
    }


def measure_memory(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Memory of one scene; in a fresh process."""
    scene, options = _scene(parameters, rng)
    grown = peak_memory(lambda: decompose(scene, options))
    return {
        "family": _family(parameters),
        "facets": len(scene.obstacles) * FACETS_OF_BOX[options.dimension],
        "bytes": grown,
    }


def _families(rows: Sequence[Row]) -> dict[str, list[Row]]:
    names = list(dict.fromkeys(str(row["family"]) for row in rows))
    return {name: [row for row in rows if row["family"] == name] for name in names}


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """Tables, exponents and pictures."""
    families = _families(rows)
    section.text(
        "Scenes of boxes: *shelving* (boards, backs, items; many coplanar facets) and *clutter* (boxes turned at "
        "random, overlapping), in space and in the plane. In the plane a box has four facets that count. Times are "
        "from the scene object to cells, portals, candidates and clearances: medians over repeated calls, then over "
        "scenes. "
        "*Processor* is the time that the process had a processor: where it is below the wall-clock time, other "
        "processes of the machine were in the way; the fastest call suffers from them least."
    )
    table = []
    for family, own in families.items():
        for size in sorted({int(row["size"]) for row in own}):
            at = [row for row in own if row["size"] == size]
            counts = [round(float(np.median(column(at, name)))) for name in ("facets", *COUNTS)]
            times = [1e3 * float(np.median(column(at, name))) for name in ("wall", "fastest", "processor")]
            table.append([family, *counts, *times, 1e3 * float(column(at, "wall").max())])
    section.table(
        ["scenes", "facets", *COUNTS, "time [ms]", "fastest call [ms]", "processor [ms]", "slowest scene [ms]"], table
    )
    _exponents(families, section, rng)
    _required_times(families, section, rng)
    section.picture("growth", _growth_figure(families), "Time and number of cells against the number of facets")
    section.picture(
        "stages",
        _stage_figure(families),
        "Shares of the stages: scene to facets, partitioning, cutting of portals, candidates and clearances",
    )


def _exponents(families: dict[str, list[Row]], section: Section, rng: np.random.Generator) -> None:
    table = []
    for family, own in families.items():
        large = [row for row in own if float(row["facets"]) >= 0.9 * EXPONENT_FROM]
        sizes = column(large, "facets")
        if len(np.unique(sizes)) < 2:
            continue
        exponents = [
            growth_exponent(sizes, np.maximum(column(large, name), 1e-9), rng)
            for name in ("fastest", "wall", "leaves", "edges")
        ]
        table.append([family, *exponents])
    if not table:
        return
    section.text(
        f"Growth exponents, i.e. slopes in the picture below, from {EXPONENT_FROM} facets on "
        "(intervals: scenes resampled within each size)."
    )
    section.table(["scenes", "time, fastest call", "time, median call", "leaves", "edges"], table)
    worst = max((row[1] for row in table if isinstance(row[1], Estimate)), key=lambda exponent: exponent.value)
    section.require(
        RequiredNumber(
            f"growth exponent of time (fastest calls), the largest of {len(table)} families of scenes",
            worst,
            "reported",
        )
    )


def _required_times(families: dict[str, list[Row]], section: Section, rng: np.random.Generator) -> None:
    for size, limit in ((1000, MILLISECONDS_OF_1000_FACETS), (10000, None)):
        times = {
            family: median(column([row for row in own if row["size"] == size], "wall"), rng).scaled(1e3)
            for family, own in families.items()
            if any(row["size"] == size for row in own)
        }
        if not times:
            continue
        slowest = max(times, key=lambda family: times[family].value)
        name = f"{size:,} facets, the slowest of {len(times)} families of scenes"
        remark = f"({slowest})"
        if limit is None:
            section.require(RequiredNumber(name, times[slowest], "reported", unit="ms", remark=remark))
        else:
            section.require(RequiredNumber(name, times[slowest], "at most", limit, "ms", remark))


def _growth_figure(families: dict[str, list[Row]]) -> Figure:
    figure, (left, right) = new_figure("Decomposition against the number of facets", 2)
    for (family, own), colour in zip(families.items(), COLOURS, strict=False):
        facets = column(own, "facets")
        medians_with_spread(left, facets, 1e3 * column(own, "wall"), family, colour)
        medians_with_spread(right, facets, column(own, "leaves"), family, colour)
    for axes in (left, right):
        logarithmic(axes)
    left.plot(
        [1000], [MILLISECONDS_OF_1000_FACETS], marker="v", color="#b0182b", linestyle="", label="limit at 1,000 facets"
    )
    label(left, "facets", "time [ms]", "Time (band: 10th to 90th percentile of scenes)")
    label(right, "facets", "leaves of the tree", "Cells, free and solid")
    legend(left)
    legend(right)
    return figure


def _stage_figure(families: dict[str, list[Row]]) -> Figure:
    figure, panels = new_figure("Where the time goes", len(families), width=3.4, height=3.6)
    for axes, (family, own) in zip(panels, families.items(), strict=True):
        sizes = sorted({int(row["size"]) for row in own})
        shares = []
        for size in sizes:
            at = [row for row in own if row["size"] == size]
            stages = np.array([np.median(column(at, stage)) for stage in STAGES])
            shares.append((100.0 * stages / stages.sum()).tolist())
        stacked_bars(axes, [f"{size:,}" for size in sizes], shares, STAGES)
        axes.tick_params(axis="x", rotation=60)
        label(axes, "facets", "share of time [%]" if axes is panels[0] else "", family)
    legend_below(figure, panels[-1])
    return figure


def summarise_memory(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table."""
    section.text(
        "By how much the peak of resident memory grows during one decomposition, in a process of its own with all "
        "kernels loaded (VmHWM of Linux, elsewhere ru_maxrss: compiled code allocates outside of what tracemalloc "
        "sees). The graph's edges are implicit and take no memory."
    )
    section.table(
        ["scenes", "facets", "memory [MB]"],
        [[row["family"], row["facets"], 1e-6 * float(row["bytes"])] for row in rows],
    )
