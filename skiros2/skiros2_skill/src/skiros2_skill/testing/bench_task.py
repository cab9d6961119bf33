"""A task that a test ticks."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.tree.skill_node import SkillWrapper
from skiros2_skill.testing.fake_clock import FakeClock
from skiros2_skill.testing.trace import Seen, Trace

#: What the threads of skills get between two ticks when the clock is a fake (s of the machine's time).
_MOMENT = 0.001


class BenchTask(Task):
    """A task as a manager has it, ticked by `tick` or `run`, with a trace of all it does.

    :param clock: a period of it passes with each tick.
    :param period: of the ticks (s).
    """

    def __init__(self, wmi: Any, clock: FakeClock | None = None, period: float = 0.04) -> None:
        super().__init__(0, wmi, "test")
        self._clock = clock
        self._period = period
        self._threads_before = threading.active_count()
        self._woken = threading.Event()
        self.waker = self._woken.set
        self.trace = Trace()

    def tick(self, times: int = 1) -> State:
        """One tick, or some; none after the end. Returns Running, or how the task has ended."""
        state = self.state
        for _ in range(times):
            if self.ended.is_set():
                break
            self._woken.clear()
            state = super().tick()
            self.trace.add(_seen(self.root))
            if self._clock is not None:
                self._clock.advance(self._period)
        return state

    def run(self, ticks: int = 1000) -> BenchTask:
        """Ticks until the task ends, at most so often; between two ticks threads that were started get some time."""
        while ticks and self.tick() is State.Running:
            ticks -= 1
            if ticks and threading.active_count() > self._threads_before:
                self._woken.wait(self._period if self._clock is None else _MOMENT)
        return self

    # -- looking at it -----------------------------------------------------------------------------------------

    @property
    def skill(self) -> Any:
        """The node of the first skill."""
        return self.root.children[0]

    def node(self, name: str) -> Any:
        """The node with that label or type, or what its processor prints.

        :raises UnknownName: there is none.
        :raises WrongValue: there are several.
        """
        found = [n for n in self.nodes() if name in (n.label, n.type, n.type.rpartition(":")[2], _name(n))]
        if len(found) == 1:
            return found[0]
        if found:
            raise WrongValue(f"{len(found)} nodes are called {name!r}:\n{self.trace}")
        raise UnknownName(f"no node is called {name!r}; there are: {', '.join(map(_name, self.nodes()))}")

    @property
    def blackboard(self) -> dict[str, Any]:
        """The values on the blackboard, by key; None for one that is not set."""
        return {key: param.value for key, param in self.root.params.items()}

    @property
    def why(self) -> str:
        """Why nodes of the task failed, for people: the message of a failed assertion."""
        return "\n".join([self.root.progress_msg, *map(str, self.explanations()), str(self.trace)])


def _seen(root: Any) -> Iterator[Seen]:
    """The nodes of a tree, each before its children; it may be deeper than Python's stack."""
    waiting: list[tuple[Any, tuple[int, ...]]] = [(root, ())]
    while waiting:
        node, place = waiting.pop()
        yield Seen(place, _name(node), node.state, node.progress_code)
        waiting += [(child, (*place, index)) for index, child in enumerate(node.children)][::-1]


def _name(node: Any) -> str:
    if node.parent is None:
        return "root"  # its label has the task's id
    if node.label:
        return str(node.label)
    return str(node.type.rpartition(":")[2] if isinstance(node, SkillWrapper) else node.processor.printType())
