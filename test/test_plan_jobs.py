"""Plans in threads of their own: each is answered once."""

from __future__ import annotations

import threading

import pytest
from suite import PATIENCE, until

from bsp_informed_planner.errors import QueueFullError
from bsp_informed_planner.nodes.newest_first import NewestFirstWorker
from bsp_informed_planner.nodes.plan_jobs import PlanJobs


def test_a_system_without_threads_to_spare_is_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    jobs: PlanJobs[str] = PlanJobs(2, 0)
    answers: list[str] = []
    start = threading.Thread.start

    def no_thread(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    for name in ("first", "second", "third"):
        monkeypatch.setattr(threading.Thread, "start", no_thread)
        jobs.submit(lambda name=name: name, str, answers.append)  # type: ignore[misc]
        monkeypatch.setattr(threading.Thread, "start", start)
    assert answers == ["can't start new thread"] * 3
    # They do not count any more, and what is left of them in the pool is not worked on.
    go_on = threading.Event()
    for name in ("fourth", "fifth"):
        jobs.submit(lambda name=name: str(go_on.wait(PATIENCE) and name), str, answers.append)  # type: ignore[misc]
    jobs.submit(lambda: "sixth", lambda error: type(error).__name__, answers.append)
    assert answers[3:] == [QueueFullError.__name__]
    go_on.set()
    until(lambda: len(answers) == 6)
    jobs.stop()
    assert sorted(answers[4:]) == ["fifth", "fourth"]


def test_an_answer_that_fails_leaves_room_for_others() -> None:
    jobs: PlanJobs[int] = PlanJobs(1, 0)
    answers: list[int] = []

    def fail(_: int) -> None:
        raise ValueError("nobody listens")

    jobs.submit(lambda: 1, lambda _: 0, fail)
    until(lambda: jobs._count == 0)
    jobs.submit(lambda: 2, lambda _: 0, answers.append)
    until(lambda: answers == [2])
    jobs.stop()


def test_a_worker_goes_on_after_an_item_that_fails() -> None:
    worked: list[int] = []

    def work(item: int) -> None:
        if item == 0:
            raise ValueError("no such item")
        worked.append(item)

    worker = NewestFirstWorker(work, "worker")
    worker.submit(0)
    until(lambda: not worker._pending)
    worker.submit(1)
    until(lambda: worked == [1])
    worker.stop()
