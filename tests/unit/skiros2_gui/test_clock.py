"""The window's time: ticks stay in their order when the wall clock is set."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

from skiros2_common.core.forward_clock import now
from skiros2_live.core.patch import TaskProgress
from skiros2_live.ros.managers import ManagerConnections


@pytest.mark.parametrize("days", [-1, 1])
def test_ticks_stay_in_order_when_the_clock_is_set_by_a_day(monkeypatch: pytest.MonkeyPatch, days: int) -> None:
    wall, elapsed, reported = 1e9, 0.0, list[TaskProgress]()
    monkeypatch.setattr(now, "_wall", lambda: wall + elapsed)
    monkeypatch.setattr(now, "_monotonic", lambda: elapsed)
    monkeypatch.setattr(now, "_last", 0.0)
    managers: Any = object.__new__(ManagerConnections)  # without a node
    managers._report = reported.append
    for number in range(6):
        managers._on_progress(SimpleNamespace(progress=[number]), "/robot")
        elapsed += 1.0
        wall += days * 86_400.0 * (number == 2)
    steps = [later.stamp - earlier.stamp for earlier, later in pairwise(reported)]
    assert steps == [1.0, 1.0, 1.0 + max(0, days) * 86_400.0, 1.0, 1.0]
