"""The message log of a task."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from skiros2_runs.core.frame import Frame
from skiros2_runs.core.states import ENDS, IDLE, RUNNING

#: The most lines kept.
MAX_LINES = 2000

#: The shortest time between lines of a node whose message alone changes (s).
_PERIOD = 1.0

#: The most characters of a message kept.
_LONGEST = 500


@dataclass(frozen=True)
class LogLine:
    """:param time: s since the epoch.
    :param node: the node's id.
    :param name: the node's name.
    :param path: the node's child indices from the root.
    """

    time: float
    node: int
    name: str
    state: int
    message: str
    path: tuple[int, ...] = ()


class MessageLog:
    """:ivar lines: oldest first.
    :ivar dropped: the number of discarded lines.
    """

    def __init__(self) -> None:
        self.lines: deque[LogLine] = deque(maxlen=MAX_LINES)
        self._last: dict[int, LogLine] = {}
        self.dropped = 0

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def count(self) -> int:
        """The number of lines ever added."""
        return self.dropped + len(self.lines)

    def record(self, frame: Frame, indices: Sequence[int]) -> None:
        """Adds a line for each node with a new state or message.

        The start of a node precedes the changes of its children; its end follows them.

        :param indices: of the nodes that may have changed.
        """
        if len(indices) > 1:
            paths = frame.shape.index_paths
            indices = sorted(indices, key=lambda i: (*paths[i], math.inf) if frame.state(i) in ENDS else paths[i])
        for index in indices:
            self._add(frame, index)

    def _add(self, frame: Frame, index: int) -> None:
        state, message, node = frame.state(index), frame.message(index), frame.shape.id(index)
        last = self._last.get(node)
        name = frame.shape.name(index)
        if last is None and not message and (state == IDLE or (index and not frame.shape.is_skill(index))):
            return  # control-flow nodes have no messages
        if last is not None and last.state == state and last.name == name:
            if last.message == _short(message) or not message:
                return
            if state == RUNNING and frame.time - last.time < _PERIOD:
                return
        line = LogLine(frame.time, node, name, state, _short(message), frame.shape.index_paths[index])
        self._last[node] = line
        if state == IDLE and not message:
            return
        if len(self.lines) == MAX_LINES:
            self.dropped += 1
        self.lines.append(line)


def _short(message: str) -> str:
    return message if len(message) <= _LONGEST else f"{message[: _LONGEST - 1]}…"
