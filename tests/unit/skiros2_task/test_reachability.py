"""Relaxed reachability."""

from __future__ import annotations

import threading

from skiros2_task.core.reachability import Deadline, explore
from skiros2_task.core.task import PlanStep
from support.transport_task import transport_task

R, G, A, B, P = (
    "cora:Robot-0",
    "rparts:GripperEffector-0",
    "skiros:Location-0",
    "skiros:Location-1",
    "skiros:Product-0",
)


def test_facts_reached_by_plans_are_reachable() -> None:
    task = transport_task(1, 2, 1)
    reached = explore(task, Deadline(10.0))
    state = task.init
    for step in (
        PlanStep("pick", (R, G, A, P)),
        PlanStep("drive", (R, A, B)),
        PlanStep("place", (R, G, B, P)),
    ):
        assert state <= reached.true
        state = task.ground(step).apply(state)
    assert state <= reached.true
    assert reached.complete


def test_explore_stops_when_cancelled() -> None:
    cancelled = threading.Event()
    cancelled.set()
    assert not explore(transport_task(1, 2, 1), Deadline(60.0, cancelled)).complete


def test_explore_is_incomplete_after_deadline() -> None:
    assert not explore(transport_task(1, 2, 1), Deadline(-1.0)).complete
