"""A task that is ticked by a test."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.tree.skill_node import SkillWrapper
from skiros2_skill.testing.fake_clock import FakeClock
from skiros2_skill.testing.trace import Trace, TracedNode

#: Real time for the threads of skills between two ticks with a fake clock (s).
_THREAD_TIME = 0.001


class BenchTask(Task):
    """A task that is ticked by `tick` or `run` and records a trace.

    :param clock: advances by one period per tick.
    :param period: of the ticks (s).
    """

    def __init__(self, wmi: WorldModelPort, clock: FakeClock | None = None, period: float = 0.04) -> None:
        super().__init__(0, wmi, "test")
        self._clock = clock
        self._period = period
        self._threads_before = threading.active_count()
        self._woken = threading.Event()
        self.waker = self._woken.set
        self.trace = Trace()

    def tick(self, times: int = 1) -> State:
        """Ticks the task, unless it has ended. Returns its state."""
        state = self.state
        for _ in range(times):
            if self.ended.is_set():
                break
            self._woken.clear()
            state = super().tick()
            self.trace.add(_traced(self.root))
            if self._clock is not None:
                self._clock.advance(self._period)
        return state

    def run(self, ticks: int = 1000) -> BenchTask:
        """Ticks until the task ends, at most `ticks` times. Threads of skills run between ticks."""
        while ticks and self.tick() is State.Running:
            ticks -= 1
            if ticks and threading.active_count() > self._threads_before:
                self._woken.wait(self._period if self._clock is None else _THREAD_TIME)
        return self

    # -- inspection --------------------------------------------------------------------------------------------

    @property
    def skill(self) -> Any:
        """The first child of the root."""
        return self.root.children[0]

    def node(self, name: str) -> Any:
        """The node with a label, type or processor symbol.

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
        """The values on the blackboard, by key; None for unset parameters."""
        return {key: param.value for key, param in self.root.params.items()}

    @property
    def why(self) -> str:
        """Why nodes failed, for people; use it as the message of an assertion."""
        return "\n".join([self.root.progress_msg, *map(str, self.explanations()), str(self.trace)])


def _traced(root: Any) -> Iterator[TracedNode]:
    """The nodes of a tree, parents before children. Not recursive, because trees may be deeper than Python's stack."""
    pending: list[tuple[Any, tuple[int, ...]]] = [(root, ())]
    while pending:
        node, indices = pending.pop()
        yield TracedNode(indices, _name(node), node.state, node.progress_code)
        pending += [(child, (*indices, index)) for index, child in enumerate(node.children)][::-1]


def _name(node: Any) -> str:
    if node.parent is None:
        return "root"  # its label has the task's id
    if node.label:
        return str(node.label)
    return str(node.type.rpartition(":")[2] if isinstance(node, SkillWrapper) else node.processor.printType())
