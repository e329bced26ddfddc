"""Plans for a long time: does memory stay flat?"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Benchmark, Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.charts import COLOURS, label, legend, new_figure
from bsp_informed_planner.benchmarks.nodes.random_requests import gap_message, gap_scene, random_request
from bsp_informed_planner.benchmarks.nodes.running_nodes import node_parameters, nodes_as_processes
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.compile_kernels import ensure_compiled
from bsp_informed_planner.nodes.client import SuiteUnavailableError

CLIENTS = 2
#: Longest wait for an answer, between two changes of the scene, and between two looks at the memory [s].
PATIENCE, UPDATE_PERIOD, LOOK_PERIOD = 20.0, 0.5, 1.0
#: Share of the time after which memory has to be flat: buffers and caches fill up before.
WARM_UP = 0.3
#: Growth that is allowed in 10,000 plans [MiB].
LIMIT = 10.0


def soak_benchmark(minutes: float) -> Benchmark:
    """One part, of so many minutes."""
    cases: list[Parameters] = [{"minutes": minutes}]
    part = Part("soak", "Memory of the nodes over many plans", cases, measure, summarise, Mode.ALONE)
    return Benchmark(
        name="soak",
        title="Soak test of the nodes",
        introduction="Good and bad requests for as long as one likes, while the scene changes; memory of the nodes.",
        parts=(part,),
        sources=("scene", "decomposition", "robots", "collision", "sampling", "planning", "nodes", "benchmarks"),
        prepare=ensure_compiled,
    )


def resident_mib(process: int) -> float:
    """Memory that a process holds [MiB]."""
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 2**20


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Requests one after the other of each client, until the time is over; memory once a second."""
    seeds = rng.integers(1 << 31, size=CLIENTS).tolist()
    plans = [0] * CLIENTS
    lost: list[str] = []
    with nodes_as_processes(node_parameters("point")) as (make, processes):
        clients = [make() for _ in range(CLIENTS)]
        updater = make()
        updater.publish_scene(gap_scene(0.5))
        begin = time.monotonic()
        end = begin + 60.0 * float(parameters["minutes"])

        def ask(index: int) -> None:
            generator = np.random.default_rng(seeds[index])
            while time.monotonic() < end:
                request = random_request(generator)
                try:
                    clients[index].plan(request, PATIENCE)
                    plans[index] += 1
                except SuiteUnavailableError as error:
                    lost.append(str(error))

        threads = [threading.Thread(target=ask, args=(index,)) for index in range(CLIENTS)]
        for thread in threads:
            thread.start()
        looks: list[dict[str, float]] = []
        next_look = begin
        while time.monotonic() < end:
            updater.publish_message(gap_message(rng))
            if time.monotonic() >= next_look:
                next_look += LOOK_PERIOD
                memory = {name: resident_mib(process.pid) for name, process in processes.processes.items()}
                looks.append({"seconds": time.monotonic() - begin, "plans": float(sum(plans)), **memory})
            time.sleep(UPDATE_PERIOD)
        for thread in threads:
            thread.join()
        died = [name for name, process in processes.processes.items() if process.poll() is not None]
    return {"plans": sum(plans), "lost": lost, "died": died, "looks": looks}


def growth(plans: Sequence[float], memory: Sequence[float]) -> float:
    """Slope of a line through memory over plans, after the warm-up, for 10,000 plans [MiB]."""
    x, y = np.array(plans), np.array(memory)
    late = x >= WARM_UP * x[-1]
    if np.ptp(x[late]) == 0.0:
        return float("nan")
    return 1e4 * float(np.polyfit(x[late], y[late], 1)[0])


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A picture, and the growth of each node."""
    for row in rows:
        looks = row["looks"]
        names = [name for name in looks[0] if name not in ("seconds", "plans")]
        section.text(
            f"{CLIENTS} clients had {row['plans']:,} answers in {looks[-1]['seconds'] / 60.0:.1f} minutes, about half "
            f"of them to requests that are wrong in some way; the scene changed every {UPDATE_PERIOD:g} s. The growth "
            f"is that of a line through the last {100 * (1 - WARM_UP):.0f} % of the plans."
        )
        figure, (axes,) = new_figure("Memory of the nodes", width=6.0)
        for name, colour in zip(names, COLOURS, strict=False):
            plans, memory = [look["plans"] for look in looks], [look[name] for look in looks]
            axes.plot(plans, memory, color=colour, label=name)
            section.require(
                RequiredNumber(f"growth of {name} in 10,000 plans", growth(plans, memory), "at most", LIMIT, "MiB")
            )
        label(axes, "answers", "memory [MiB]")
        legend(axes)
        section.picture("soak", figure, "Memory that each node holds, over the answers given")
        for name, count in (("requests without an answer", len(row["lost"])), ("nodes that ended", len(row["died"]))):
            section.require(RequiredNumber(name, float(count), "exactly", 0.0))
