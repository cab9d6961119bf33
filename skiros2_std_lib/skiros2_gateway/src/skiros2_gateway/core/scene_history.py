"""Where elements and robots were at earlier times, in the cell or in a bag."""

from __future__ import annotations

from bisect import bisect_right
from operator import itemgetter
from typing import Any

from skiros2_gateway.core.patch import without_none
from skiros2_gateway.core.recorded_bag import RecordedScene
from skiros2_live.core.scene_view import SceneView

#: The tables of the live view that have a history.
TABLES = ("elements", "frames", "bodies")

#: The shortest time between two entries of one key (s).
_PERIOD = 0.2
#: Entries kept; a frame takes some 400 bytes, an element some kB.
_MAX_ENTRIES = 100_000

_time_of = itemgetter(0)


class SceneHistory:
    """The entries of `TABLES` over time. Not thread-safe.

    :param max_entries: with more, the older half of the time is discarded.
    """

    def __init__(self, max_entries: int = _MAX_ENTRIES) -> None:
        self._entries: dict[tuple[str, str], list[tuple[float, Any]]] = {}
        self._count = 0
        self._limit = self._max = max_entries

    def add(self, table: str, key: str, time: float, value: Any) -> None:
        """Adds the value of a key; of values that follow within 0.2 s, the last one is kept.

        :param time: s since the epoch, not before the key's last one.
        :param value: JSON data, which must not change afterwards; None: the key was removed.
        """
        entries = self._entries.setdefault((table, key), [])
        if entries and entries[-1][1] == value:
            return
        if len(entries) > 1 and time - entries[-2][0] < _PERIOD:
            entries[-1] = (time, value)
            return
        entries.append((time, value))
        self._count += 1
        if self._count > self._limit:
            self._discard()

    def at(self, time: float) -> dict[str, dict[str, Any]]:
        """Returns the tables at a time (s since the epoch). Of frames, the first value also holds before its time."""
        document: dict[str, dict[str, Any]] = {table: {} for table in TABLES}
        for (table, key), entries in self._entries.items():
            number = bisect_right(entries, time, key=_time_of)
            value = entries[max(0, number - 1)][1] if number or table == "frames" else None
            if value is not None:
                document[table][key] = value
        return document

    def _discard(self) -> None:
        first = min((entries[0][0] for entries in self._entries.values() if len(entries) > 1), default=0.0)
        last = max(entries[-1][0] for entries in self._entries.values())
        middle = (first + last) / 2.0
        for entries in self._entries.values():
            del entries[: max(0, bisect_right(entries, middle, key=_time_of) - 1)]
        gone = [key for key, entries in self._entries.items() if entries[-1][1] is None and entries[-1][0] <= middle]
        for key in gone:
            del self._entries[key]
        self._count = sum(map(len, self._entries.values()))
        self._limit = max(self._max, 2 * self._count)


def read_history(scene: RecordedScene, view: SceneView) -> SceneHistory:
    """Returns the history of the scene in a bag. Takes seconds for a long one."""
    history = SceneHistory(max_entries=10 * _MAX_ENTRIES)
    for name, (urdf, prefix) in scene.descriptions.items():
        history.add("bodies", name, scene.start, without_none(view.robot(urdf, prefix)))
    for time, eid, element in scene.elements:
        history.add("elements", eid, time, without_none(view.element(element)) if element is not None else None)
    for time, name, frame in scene.frames:
        history.add("frames", name, time, frame)
    return history
