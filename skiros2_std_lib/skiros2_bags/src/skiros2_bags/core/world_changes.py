"""The changes of the world model, from its messages in a bag."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from skiros2_bags.core.change_parser import change_from
from skiros2_bags.core.contract_types import MONITOR, check_md5
from skiros2_bags.core.errors import BagError
from skiros2_bags.core.garbage import without_collection
from skiros2_bags.core.message import Message
from skiros2_common.core.errors import SkirosError
from skiros2_world_model.core.changes import RESET, Change


@dataclass(frozen=True, eq=False)
class TimedChange:
    """A change of the world model.

    :param time: when it was recorded (s since the epoch).
    :param gap: what is missing before it; "" when it follows the one before.
    """

    time: float
    change: Change
    gap: str = ""


def timed_changes(messages: Iterable[Message]) -> list[TimedChange]:
    """The changes in the order in which they were made, which their snapshot ids tell.

    A message that came before its time waits for those before it. One whose predecessor never comes has a `gap`; so
    has the first of all when it does not tell the whole scene.

    :param messages: of the type `WmMonitor`, oldest first.
    :raises BagError: one cannot be read.
    """
    with without_collection():
        told = [(message.time, read_change(message)) for message in messages]
        return list(_in_order(told))


def read_change(message: Message) -> Change:
    """A change from its message.

    :raises BagError: it cannot be read.
    """
    check_md5(message)
    try:
        return change_from(message.data)
    except (SkirosError, ValueError, TypeError, struct.error) as error:
        raise BagError(f"{message.place}: the change cannot be read: {error}") from error


def _in_order(told: list[tuple[float, Change]]) -> Iterator[TimedChange]:
    known = ""
    waiting: dict[str, tuple[float, Change]] = {}
    coming = {change.snapshot_id for _, change in told}
    for time, change in told:
        coming.discard(change.snapshot_id)
        if change.action != RESET and change.prev_snapshot_id != known and change.prev_snapshot_id in coming:
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
