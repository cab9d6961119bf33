"""Calls that take too long are abandoned."""

import threading

import pytest

from skiros2_common.core.errors import Refused, TimedOut, WrongValue
from skiros2_world_model.core.triple_store import TimeLimit


def test_caller_gets_result_or_exception():
    limit = TimeLimit(60.0)
    assert [limit.run(lambda _, i=i: i, "counting") for i in range(100)] == list(range(100))

    def fail(_):
        raise WrongValue("no")

    with pytest.raises(WrongValue, match="no"):
        limit.run(fail, "failing")
    assert TimeLimit(0).run(lambda _: 1, "without a limit") == 1


def test_overdue_call_is_abandoned_and_its_event_set():
    told = threading.Event()

    def endless(abandoned):
        abandoned.wait()
        told.set()

    with pytest.raises(TimedOut, match=r"waiting: abandoned after 0\.05 s"):
        TimeLimit(0.05).run(endless, "waiting")
    assert told.wait(30)


def test_new_calls_are_refused_while_too_many_abandoned_ones_run():
    limit, end = TimeLimit(0.05), threading.Event()
    ended = [threading.Event(), threading.Event()]

    def stubborn(index):
        def work(_):
            end.wait()
            ended[index].set()

        return work

    for index in range(2):
        with pytest.raises(TimedOut):
            limit.run(stubborn(index), f"number {index}")
    with pytest.raises(Refused, match="other: refused while abandoned calls are still running: number 0; number 1"):
        limit.run(lambda _: None, "other")
    assert TimeLimit(5).run(lambda _: "fine", "that of others") == "fine"
    end.set()
    assert all(event.wait(30) for event in ended)
    while True:  # each is counted out a moment after it has ended
        try:
            assert limit.run(lambda _: "fine", "other") == "fine"
            break
        except Refused:
            continue


def test_many_threads_at_once():
    limit, together = TimeLimit(30), threading.Barrier(8)
    found = []

    def ask(i):
        found.append(limit.run(lambda _: (together.wait(), i)[1], "all at once"))

    threads = [threading.Thread(target=ask, args=(i,)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == list(range(8))
