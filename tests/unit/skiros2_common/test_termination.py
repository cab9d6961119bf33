"""Termination signals, and the end of child processes."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator

import pytest

from skiros2_common.core.processes import (
    TERMINATION_SIGNALS,
    Terminated,
    TerminationSignals,
    descendants,
    end_processes,
    exit_status,
)
from support.programs import ProcessId
from support.ros import wait_until


@pytest.fixture
def before() -> Iterator[list[object]]:
    """The handlers of the process; those that a test has left behind go."""
    handlers = [signal.getsignal(number) for number in TERMINATION_SIGNALS]
    yield list(handlers)
    for number, handler in zip(TERMINATION_SIGNALS, handlers, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("number", TERMINATION_SIGNALS)
def test_termination_signal_raises_terminated(number: signal.Signals, before: list[object]) -> None:
    with pytest.raises(Terminated, match=number.name) as ended, TerminationSignals():
        signal.raise_signal(number)
    assert exit_status(ended.value) == 128 + number
    assert [signal.getsignal(n) for n in TERMINATION_SIGNALS] == before


def test_later_signals_are_ignored(before: list[object]) -> None:
    with pytest.raises(Terminated) as ended, TerminationSignals():
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            signal.raise_signal(signal.SIGINT)
    assert ended.value.number == signal.SIGTERM


def test_deferred_signal_is_raised_at_the_end(before: list[object]) -> None:
    done = []
    with pytest.raises(Terminated), TerminationSignals() as signals:
        with signals.deferred():
            signal.raise_signal(signal.SIGTERM)
            done.append("what was held")
        done.append("what follows")
    assert done == ["what was held"]


def test_deferred_signal_is_raised_at_the_end_of_the_outermost_deferral_or_on_request(before: list[object]) -> None:
    done = []
    with pytest.raises(Terminated), TerminationSignals() as signals, signals.deferred():
        with signals.deferred():
            signal.raise_signal(signal.SIGTERM)
        done.append("what was held")
        signals.raise_received()
        done.append("what follows")
    assert done == ["what was held"]


def test_ignored_signal_stays_ignored(before: list[object]) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with TerminationSignals():
        signal.raise_signal(signal.SIGHUP)
    assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN


def test_end_processes_ends_descendants() -> None:
    deaf = subprocess.Popen(["bash", "-c", "trap '' INT; sleep 1000; true"], start_new_session=True)
    meek = subprocess.Popen(["sleep", "1000"], start_new_session=True)
    wait_until(lambda: descendants(deaf.pid))
    family = [ProcessId(pid) for pid in descendants(deaf.pid)]
    end_processes([deaf, meek], 0.01)
    assert (deaf.returncode, meek.returncode) == (-signal.SIGKILL, -signal.SIGINT)
    wait_until(lambda: not any(process.running for process in family))


def test_descendants_that_end_meanwhile_are_omitted() -> None:
    busy = subprocess.Popen(["bash", "-c", "while true; do (:) & done"])
    try:
        for _ in range(500):
            descendants(busy.pid)
    finally:
        busy.kill()
        busy.wait()
