"""Jobs: results, errors, order, activities, shutdown."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Any

import pytest

from skiros2_common.core.errors import Refused
from skiros2_gui.app.jobs import Jobs
from skiros2_gui.app.problems import Problems


class Desk:
    """The window's thread: delivers until a condition is true."""

    def __init__(self) -> None:
        self.problems = Problems()
        self._woken: queue.SimpleQueue[None] = queue.SimpleQueue()
        self.jobs = Jobs(self.problems, lambda: self._woken.put(None))
        self.seen: list[Any] = []

    def until(self, condition: Callable[[], bool]) -> None:
        while not condition():
            self._woken.get(timeout=10)
            self.jobs.deliver()


@pytest.fixture
def desk() -> Desk:
    return Desk()


def test_call_runs_in_worker_and_result_is_delivered_here(desk: Desk) -> None:
    def done(worker: threading.Thread) -> None:
        desk.seen += [worker, threading.current_thread()]

    desk.jobs.run(threading.current_thread, done)
    desk.until(lambda: bool(desk.seen))
    assert desk.seen[0] is not threading.main_thread()
    assert desk.seen[1] is threading.current_thread()


def test_error_goes_to_callback_or_error_bar(desk: Desk) -> None:
    def refuse() -> None:
        raise Refused("task 3 runs already")

    desk.jobs.run(refuse, failed=desk.seen.append, activity="starting")
    desk.until(lambda: bool(desk.seen))
    assert desk.problems.newest is None
    desk.jobs.run(refuse, activity="starting")
    desk.until(lambda: desk.problems.newest is not None)
    assert desk.problems.history[0].line == "starting: task 3 runs already"


def test_system_exit_of_a_call_is_an_error(desk: Desk) -> None:
    desk.jobs.run(lambda: exit(3), failed=desk.seen.append)
    desk.until(lambda: bool(desk.seen))
    assert "tried to exit the program" in str(desk.seen[0])


def test_failing_callback_is_reported(desk: Desk) -> None:
    desk.jobs.run(lambda: 1, lambda number: number.missing, activity="counting")  # type: ignore[attr-defined]
    desk.until(lambda: desk.problems.newest is not None)
    desk.jobs.run(lambda: 2, desk.seen.append)
    desk.until(lambda: desk.seen == [2])
    assert desk.problems.history[0].activity == "showing the result of counting"


def test_calls_of_one_queue_run_in_order(desk: Desk) -> None:
    gate = threading.Event()
    running = []

    def slow() -> str:
        running.append("slow")
        assert gate.wait(10)
        return "slow"

    desk.jobs.run(slow, desk.seen.append, queue="world")
    desk.jobs.run(lambda: running.append("next") or "next", desk.seen.append, queue="world")
    desk.jobs.run(lambda: "beside", desk.seen.append)
    desk.until(lambda: desk.seen == ["beside"])
    assert running == ["slow"]
    gate.set()
    desk.until(lambda: len(desk.seen) == 3)
    assert desk.seen == ["beside", "slow", "next"]
    assert running == ["slow", "next"]


def test_call_without_queue_does_not_wait(desk: Desk) -> None:
    gate = threading.Event()
    for _ in range(40):
        desk.jobs.run(lambda: gate.wait(10), desk.seen.append)
    desk.jobs.run(lambda: gate.wait(10), desk.seen.append, queue="/robot")
    desk.jobs.run(lambda: "stopped", desk.seen.append, queue="")
    desk.until(lambda: bool(desk.seen))
    assert desk.seen == ["stopped"]
    gate.set()
    desk.until(lambda: len(desk.seen) == 42)


def test_activities_list_running_calls(desk: Desk) -> None:
    gate = threading.Event()
    reported: list[list[str]] = []
    desk.jobs.on_busy(lambda: reported.append(desk.jobs.activities))
    desk.jobs.run(lambda: gate.wait(10), desk.seen.append, activity="loading the scene")
    assert desk.jobs.activities == ["loading the scene"]
    gate.set()
    desk.until(lambda: bool(desk.seen))
    assert reported == [["loading the scene"], []]


def test_closed_jobs_deliver_and_start_nothing(desk: Desk) -> None:
    began, gate, ended = threading.Event(), threading.Event(), threading.Event()

    def slow() -> None:
        began.set()
        gate.wait(10)
        ended.set()

    desk.jobs.run(slow, desk.seen.append, desk.seen.append)
    assert began.wait(10)
    desk.jobs.close()
    gate.set()
    assert ended.wait(10)
    desk.jobs.run(lambda: 1, desk.seen.append)
    desk.jobs.deliver()
    assert desk.seen == []
    assert desk.jobs.activities == []
