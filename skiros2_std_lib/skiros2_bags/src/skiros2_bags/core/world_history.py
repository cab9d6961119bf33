"""The changes of the world model in a bag, and the scene at any time."""

from __future__ import annotations

import gc
import struct
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from skiros2_bags.core.change_parser import change_from
from skiros2_bags.core.errors import BagError
from skiros2_bags.core.message import MONITOR, Message, check_md5
from skiros2_common.core.errors import SkirosError
from skiros2_world_model.core.changes import RESET, Change
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import Scene


@dataclass(frozen=True, eq=False)
class TimedChange:
    """A change of the world model.

    :param time: when it was recorded (s since the epoch).
    :param gap: describes the changes missing before this one; "" if it continues the previous change.
    """

    time: float
    change: Change
    gap: str = ""


def timed_changes(messages: Iterable[Message]) -> list[TimedChange]:
    """Returns the changes in the order given by their snapshot ids.

    A change that was recorded before its predecessor is moved behind it. A change whose predecessor is missing has a
    `gap`; so has the first change if it is not the whole scene.

    :param messages: of the type `WmMonitor`, oldest first.
    :raises BagError: a message cannot be read.
    """
    with gc_paused():
        received = [(message.time, read_change(message)) for message in messages]
        return list(_in_order(received))


def read_change(message: Message) -> Change:
    """Decodes a change.

    :raises BagError: the message cannot be read.
    """
    check_md5(message)
    try:
        return change_from(message.data)
    except (SkirosError, ValueError, TypeError, struct.error) as error:
        raise BagError(f"{message.location}: the change cannot be read: {error}") from error


def _in_order(received: list[tuple[float, Change]]) -> Iterator[TimedChange]:
    known = ""
    waiting: dict[str, tuple[float, Change]] = {}
    pending = {change.snapshot_id for _, change in received}
    for time, change in received:
        pending.discard(change.snapshot_id)
        if change.action != RESET and change.prev_snapshot_id != known and change.prev_snapshot_id in pending:
            waiting[change.prev_snapshot_id] = (time, change)
            continue
        gap = "" if change.action == RESET or change.prev_snapshot_id == known else _gap(known, change)
        yield TimedChange(time, change, gap)
        known = change.snapshot_id
        while known in waiting:
            late, change = waiting.pop(known)
            yield TimedChange(max(time, late), change)
            known = change.snapshot_id


def _gap(known: str, change: Change) -> str:
    first = f"the {change.action} {change.snapshot_id!r} of {change.author!r}"
    if not known:
        return f"the bag does not begin with the whole scene ({MONITOR} with action {RESET!r}) but with {first}"
    return f"changes of the world model are missing between {known!r} and {change.prev_snapshot_id!r}, before {first}"


def world_at(changes: Sequence[TimedChange], at: float, partial: bool = False) -> Scene:
    """Returns a new scene with all changes that were recorded up to a time.

    :param changes: in order.
    :param at: s since the epoch.
    :param partial: whether missing changes are accepted.
    :raises BagError: no change was recorded until then, or changes are missing and `partial` is False.
    """
    past = [timed for timed in changes if timed.time <= at]
    if not past:
        raise BagError(f"the bag holds no change of the world model until {at:.3f} s")
    begin = max((i for i, timed in enumerate(past) if timed.change.action == RESET), default=0)
    gap = next((timed for timed in past[begin:] if timed.gap), None)
    if gap is not None and not partial:
        raise BagError(f"the world at {at:.3f} s is not known, as at {gap.time:.3f} s {gap.gap}")
    scene = Scene()
    with gc_paused():
        for timed in past[begin:]:
            apply_change(scene, timed.change)
    return scene


@contextmanager
def gc_paused() -> Iterator[None]:
    """Disables the garbage collector: for work that creates many long-lived objects."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
