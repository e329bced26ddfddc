"""A thousand requests, good and bad, of eight clients, while the scene changes fifty times a second."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.nodes.random_requests import gap_message, gap_scene, random_request
from bsp_informed_planner.benchmarks.nodes.running_nodes import node_parameters, nodes_as_processes
from bsp_informed_planner.benchmarks.nodes.soak import resident_mib
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, median
from bsp_informed_planner.nodes.client import SuiteClient, SuiteUnavailableError
from bsp_informed_planner.nodes.error_codes import ErrorCode

CLIENTS = 8
RATE = 50.0
#: Longest wait for an answer [s].
PATIENCE = 20.0


def stress_part(quick: bool) -> Part:
    """Requests without an answer, nodes that died, memory that grew."""
    cases: list[Parameters] = [{"requests": 160 if quick else 1000, "seconds": 8.0 if quick else 60.0}]
    return Part("stress", "Good and bad requests while the scene changes", cases, measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """All requests are sent and the scene changes until the time is over, whichever takes longer."""
    per_client = int(parameters["requests"]) // CLIENTS
    seeds = rng.integers(1 << 31, size=CLIENTS + 1).tolist()
    codes: list[str] = []
    latencies: list[float] = []
    unanswered: list[str] = []
    with nodes_as_processes(node_parameters("point", allow_empty_scene=True)) as (make, processes):
        clients = [make() for _ in range(CLIENTS)]
        updater = make()
        updater.publish_scene(gap_scene(0.5))
        memory = {name: resident_mib(process.pid) for name, process in processes.processes.items()}
        stopping = threading.Event()
        sent = [0]

        def update() -> None:
            generator, begin = np.random.default_rng(seeds[-1]), time.monotonic()
            while not stopping.is_set():
                updater.publish_message(gap_message(generator))
                sent[0] += 1
                time.sleep(max(begin + sent[0] / RATE - time.monotonic(), 0.0))

        def ask(client: SuiteClient, seed: int) -> None:
            generator = np.random.default_rng(seed)
            for _ in range(per_client):
                request = random_request(generator)
                begin = time.monotonic()
                try:
                    response = client.plan(request, PATIENCE)
                except SuiteUnavailableError as error:
                    unanswered.append(str(error))
                    continue
                latencies.append(time.monotonic() - begin)
                codes.append(_name(response.error_code))

        begin = time.monotonic()
        threads = [threading.Thread(target=ask, args=pair) for pair in zip(clients, seeds, strict=False)]
        changes = threading.Thread(target=update)
        for thread in (changes, *threads):
            thread.start()
        for thread in threads:
            thread.join()
        answering = time.monotonic() - begin
        time.sleep(max(begin + float(parameters["seconds"]) - time.monotonic(), 0.0))
        elapsed = time.monotonic() - begin
        stopping.set()
        changes.join()
        died = [name for name, process in processes.processes.items() if process.poll() is not None]
        grown = {name: resident_mib(process.pid) - memory[name] for name, process in processes.processes.items()}
    return {
        "requests": per_client * CLIENTS,
        "answers": len(codes),
        "unanswered": unanswered,
        "codes": dict(Counter(codes)),
        "latencies": latencies,
        "scenes": sent[0],
        "answering_seconds": answering,
        "seconds": elapsed,
        "died": died,
        "grown_mib": grown,
    }


def _name(code: int) -> str:
    return ErrorCode(code).name if code in set(ErrorCode) else str(code)


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """What was answered, and that nothing was lost."""
    for row in rows:
        section.text(
            f"{CLIENTS} clients send {row['requests']} requests for a point robot, about half of them wrong in some "
            f"way, while {row['scenes']} scenes are published in {row['seconds']:.0f} s. Memory that the nodes held "
            "more at the end: " + ", ".join(f"{name} {size:.0f} MiB" for name, size in row["grown_mib"].items()) + "."
        )
        section.table(["answer", "times"], Counter(dict(row["codes"])).most_common())
        lost = int(row["requests"]) - int(row["answers"])
        unknown = sum(count for name, count in row["codes"].items() if name in ("CRASH", "FAILURE"))
        for name, count in (
            ("requests without an answer", lost),
            ("answers that name no reason", unknown),
            ("nodes that ended", len(row["died"])),
        ):
            section.require(RequiredNumber(name, float(count), "exactly", 0.0, "", f"of {row['requests']} requests"))
        latencies = column([{"value": value} for value in row["latencies"]], "value")
        section.require(
            RequiredNumber(
                "answers a second under this load", len(latencies) / float(row["answering_seconds"]), "reported"
            )
        )
        section.require(
            RequiredNumber("time to an answer under this load", median(1e3 * latencies, rng), "reported", unit="ms")
        )
