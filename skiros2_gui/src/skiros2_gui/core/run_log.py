"""What the nodes of a task said, one line after the other."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from skiros2_gui.core.run_frame import Frame
from skiros2_gui.core.states import IDLE, RUNNING

#: So many lines of a task are kept, the last ones.
MOST_LINES = 2000

#: A node whose message alone changes is noted so often at most (s).
_PACE = 1.0

#: So many characters of a message are kept.
_LONGEST = 500


@dataclass(frozen=True)
class LogLine:
    """
    :param time: s since the epoch.
    :param node: its id.
    :param name: of the node.
    """

    time: float
    node: int
    name: str
    state: int
    message: str


class RunLog:
    """Of one task.

    :ivar dropped: how many of the oldest lines were given up.
    """

    def __init__(self) -> None:
        self._lines: deque[LogLine] = deque(maxlen=MOST_LINES)
        self._told: dict[int, LogLine] = {}
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._lines)

    @property
    def count(self) -> int:
        """How many lines there ever were."""
        return self.dropped + len(self._lines)

    @property
    def lines(self) -> Sequence[LogLine]:
        """Oldest first."""
        return self._lines

    def enter(self, frame: Frame, places: Sequence[int]) -> None:
        """Notes what is new.

        :param places: of the nodes whose state or message may have changed.
        """
        for place in places:
            self._note(frame, place)

    def _note(self, frame: Frame, place: int) -> None:
        state, message, node = frame.state(place), frame.message(place), frame.shape.id(place)
        told = self._told.get(node)
        name = frame.shape.name(place)
        if told is None and not message and (state == IDLE or (place and not frame.shape.is_skill(place))):
            return  # nodes that only group others have nothing to say
        if told is not None and told.state == state and told.name == name:
            if told.message == _short(message) or not message:
                return
            if state == RUNNING and frame.time - told.time < _PACE:
                return
        line = LogLine(frame.time, node, name, state, _short(message))
        self._told[node] = line
        if state == IDLE and not message:
            return
        if len(self._lines) == MOST_LINES:
            self.dropped += 1
        self._lines.append(line)


def _short(message: str) -> str:
    return message if len(message) <= _LONGEST else f"{message[: _LONGEST - 1]}…"
