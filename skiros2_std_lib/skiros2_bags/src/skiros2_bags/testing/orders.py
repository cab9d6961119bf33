"""The orders and times of events that a recording leaves open.

Message times do not determine the order of messages within `WINDOW`, or the exact time of a tick.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from skiros2_bags.testing.recording import (
    ActionMessage,
    ClockTick,
    Event,
    Recording,
    SignalMessage,
    TaskProgress,
    WorldChange,
)
from skiros2_skill.core.engine.hooks import PREEMPTED

#: Messages closer than this in the bag may have arrived in another order (s).
WINDOW = 0.02

#: Uncertainty of the time of a tick (s); plus one clock step in simulated time.
JITTER = 0.005


@dataclass(frozen=True)
class Ordering:
    """A choice of the uncertain orders, times and causes.

    :param orders: (order of a message, its new order).
    :param time_shifts: (order of a progress message, time shift of its tick in s).
    :param preempting: orders of progress messages in which primitives that are replaced by their recorded progress have
        failed because the tree has preempted them, and not by themselves.
    :param late: orders of changes by primitives that are replaced by their recorded progress, recorded after it.
    :param results: orders of progress messages in which primitives that go on have received a result after a feedback.
    :param lost: orders of feedback that the client has lost: it arrived before `send_goal` had returned.
    :param counts: whether running primitives count a step for each feedback: then it arrives when they count it.
        Otherwise it arrives some time after it was recorded.
    """

    orders: tuple[tuple[int, float], ...] = ()
    time_shifts: tuple[tuple[int, float], ...] = ()
    preempting: frozenset[int] = frozenset()
    results: frozenset[int] = frozenset()
    late: frozenset[int] = frozenset()
    lost: frozenset[int] = frozenset()
    counts: bool = True


def alternatives(recording: Recording, ordering: Ordering, at: Event) -> Iterator[Ordering]:
    """Yields alternative orderings near an event, the most likely first."""
    if not isinstance(at, TaskProgress):
        return
    if later := _after_own_change(recording, at) - dict(ordering.orders).keys():
        yield replace(ordering, orders=(*ordering.orders, *((order, at.order + 0.5) for order in sorted(later))))
    causes = [ordering]
    if at.order not in ordering.preempting and any(node.code == PREEMPTED for node in at.frame.nodes.values()):
        causes.insert(0, replace(ordering, preempting=ordering.preempting | {at.order}))
        yield causes[0]
    if at.order not in ordering.results:
        yield replace(ordering, results=ordering.results | {at.order})
    shifts: tuple[float, ...] = ()
    if at.order not in dict(ordering.time_shifts):
        step = JITTER + _clock_step(e for e in recording.events if isinstance(e, ClockTick))
        shifts = (step, -step, 3 * step, -3 * step, 9 * step, -9 * step)  # a busy machine receives the clock late
    shifted = [replace(ordering, time_shifts=(*ordering.time_shifts, (at.order, shift))) for shift in shifts]
    yield from shifted[:2]
    for early in _early_feedback(recording, at):
        for number in range(1, len(early) + 1):
            if not ordering.lost.issuperset(early[:number]):
                yield replace(ordering, lost=ordering.lost | set(early[:number]))
    near = [e for e in recording.events if abs(e.time - at.time) <= WINDOW and _is_input(e)]
    near.sort(key=lambda e: abs(e.order - at.order))
    moved = dict(ordering.orders)
    for event in near:
        if event.order not in moved:
            order = at.order + 0.5 if event.order < at.order else at.order - 0.5
            for cause in causes:
                yield replace(cause, orders=(*ordering.orders, (event.order, order)))
    yield from shifted[2:]
    if ordering.counts:
        yield replace(ordering, counts=False)


def _after_own_change(recording: Recording, at: TaskProgress) -> set[int]:
    """Returns the orders of changes by others that a tick has not seen, as they came after its own first change: the
    world model publishes all changes in their order. A busy machine takes long for a tick.
    """
    before = max((e.order for e in recording.progress if e.run is at.run and e.order < at.order), default=0)
    changes = [e for e in recording.changes if before < e.order < at.order]
    own = min((e.order for e in changes if e.change.author == at.run.robot), default=at.order)
    return {e.order for e in changes if e.order > own and e.change.author != at.run.robot}


def _early_feedback(recording: Recording, at: TaskProgress) -> Iterator[list[int]]:
    """Yields the orders of feedback recorded before the tick that sent its goal had ended, for each running goal of the
    task's manager, latest goals first. Clients of actionlib drop feedback that arrives before `send_goal` has returned.
    """
    past = [e for e in recording.action_messages if e.order < at.order]
    ended = {e.goal_id for e in past if e.part == "result"}
    goals = [e for e in past if e.part == "goal" and e.caller == at.run.robot and e.goal_id not in ended]
    for goal in reversed(goals):
        ticks = (e.time for e in recording.progress if e.run is at.run and e.order > goal.order)
        until = next(ticks, at.time) + WINDOW
        answers = (e for e in past if e.goal_id == goal.goal_id and e.part == "feedback")
        if early := [e.order for e in answers if e.time <= until]:
            yield early


def _is_input(event: Event) -> bool:
    """Whether an event may have arrived in another order than it was recorded."""
    if isinstance(event, ActionMessage):
        return event.part == "cancel"
    return isinstance(event, WorldChange | SignalMessage)


def _clock_step(ticks: Iterable[ClockTick]) -> float:
    """Returns the median period of the clock (s)."""
    times = [tick.now for tick, _ in zip(ticks, range(100), strict=False)]
    steps = sorted(b - a for a, b in itertools.pairwise(times))
    return steps[len(steps) // 2] if steps else 0.0
