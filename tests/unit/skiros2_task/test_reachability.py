"""What may come about when nothing is undone."""

from __future__ import annotations

import threading

from skiros2_task.core.reachability import Patience, explore
from skiros2_task.core.simulation import after
from skiros2_task.core.task import PlanStep
from support.transport_task import transport_task

R, G, A, B, P = (
    "cora:Robot-0",
    "rparts:GripperEffector-0",
    "skiros:Location-0",
    "skiros:Location-1",
    "skiros:Product-0",
)


def test_all_that_a_plan_reaches_is_found() -> None:
    task = transport_task(1, 2, 1)
    reached = explore(task, Patience(10.0))
    state = task.init
    for step in (
        PlanStep("pick", (R, G, A, P)),
        PlanStep("drive", (R, A, B)),
        PlanStep("place", (R, G, B, P)),
    ):
        assert state <= reached.true
        state = after(task, state, step)
    assert state <= reached.true
    assert reached.complete


def test_who_cancels_it_is_not_kept_waiting() -> None:
    cancelled = threading.Event()
    cancelled.set()
    assert not explore(transport_task(1, 2, 1), Patience(60.0, cancelled)).complete


def test_without_time_it_is_said_that_not_all_was_found() -> None:
    assert not explore(transport_task(1, 2, 1), Patience(-1.0)).complete
