"""Waiting and counting."""

from __future__ import annotations

import sys
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_std_skills import clock
from skiros2_std_skills.utility_primitives import counter, wait


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The clock that the skills wait by; set its one item."""
    now = [100.0]
    monkeypatch.setattr(clock, "now", lambda: now[0])
    return now


def started(cls: type, **params: Any) -> Any:
    skill = cls()
    assert skill.init(None)
    for key, value in params.items():
        skill.specifyParam(key, value)
    assert skill.start()
    return skill


def test_wait_ends_after_its_duration(time: list[float]) -> None:
    skill = started(wait, Duration=2.0)
    assert skill.tick() is State.Running
    time[0] += 1.9
    assert skill.tick() is State.Running
    assert skill.progress_msg == "Waiting: 1.9 of 2.0 s"
    time[0] += 0.2
    assert skill.tick() is State.Success


def test_wait_of_zero_ends_immediately(time: list[float]) -> None:
    assert started(wait).tick() is State.Success


def test_wait_restarts_at_each_start(time: list[float]) -> None:
    skill = started(wait, Duration=2.0)
    time[0] += 3.0
    assert skill.tick() is State.Success
    skill.start()
    assert skill.tick() is State.Running


def test_wait_starts_with_simulated_time(time: list[float]) -> None:
    time[0] = 0.0
    skill = started(wait, Duration=2.0)
    assert skill.tick() is State.Running
    time[0] = 500.0
    assert skill.tick() is State.Running
    time[0] = 502.0
    assert skill.tick() is State.Success


def test_preempted_wait_fails(time: list[float]) -> None:
    assert started(wait, Duration=2.0).preempt() is State.Failure


@pytest.mark.parametrize("ticks", [1, 3])
def test_counting_succeeds_at_the_given_tick(ticks: int) -> None:
    skill = started(counter, CountTarget=ticks)
    assert [skill.tick() for _ in range(ticks)] == [State.Running] * (ticks - 1) + [State.Success]


def test_counting_restarts_at_each_start() -> None:
    skill = started(counter, CountTarget=2)
    skill.tick()
    assert skill.preempt() is State.Failure
    assert skill.progress_msg == "Stopped at 1"
    skill.start()
    assert skill.tick() is State.Running


def test_time_outside_ros_is_system_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rospy", None)  # type: ignore[arg-type]
    monkeypatch.setattr(clock.time, "monotonic", lambda: 42.0)
    assert clock.now() == 42.0


def test_time_in_a_node_is_ros_time(monkeypatch: pytest.MonkeyPatch) -> None:
    class Rospy:
        class core:
            is_initialized = staticmethod(lambda: True)

        get_time = staticmethod(lambda: 7.0)

    monkeypatch.setitem(clock.sys.modules, "rospy", Rospy)
    assert clock.now() == 7.0
