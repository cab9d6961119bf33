"""When the ticks of a task were, as exactly as its progress tells.

A bag has when a message came, some milliseconds after the tick. Each node tells how long it was from its start to its
last report, to the microsecond: so the times between ticks are known, and only the first is taken from the bag.
"""

from __future__ import annotations

from collections.abc import Sequence

from skiros2_bags.testing.recording import Seen, Told

#: A tick ends at least so much before its message comes (s).
_EARLIER = 1e-4


def tick_times(told: Sequence[Told]) -> list[float]:
    """The time of the tick before each message (s, by the clock of the bag), never falling."""
    times: list[float] = []
    begun: dict[tuple[int, ...], float] = {}  # when the present run of a node began
    before: dict[tuple[int, ...], Seen] = {}
    for message in told:
        now = {node.place: node for node in message.nodes}
        fresh = [n for place, n in now.items() if place not in before or before[place].seconds != n.seconds]
        known = [
            begun[n.place] + n.seconds for n in fresh if n.place in begun and n.seconds >= before[n.place].seconds > 0.0
        ]
        latest = message.time - _EARLIER
        time = min(max(known), latest + 0.05) if known else latest
        times.append(max(time, times[-1]) if times else time)
        for node in fresh:
            if node.place not in begun or node.seconds < before[node.place].seconds or before[node.place].state == ".":
                begun[node.place] = times[-1] - node.seconds
        before = now
    return times
