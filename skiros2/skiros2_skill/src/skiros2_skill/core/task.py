"""A task: a tree under a root, with an id and a blackboard of its own."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.explanation import EXCEPTION, PREEMPT, Explanation
from skiros2_common.core.params import Param
from skiros2_skill.core.executor import Executor
from skiros2_skill.core.failures import Failure
from skiros2_skill.core.groups import Root
from skiros2_skill.core.wrapper import SkillWrapper

log = logging.getLogger(__name__)

#: Ids travel as int16.
MAX_ID = 32767

#: What a root's progress code is when its task has ended.
ENDED_SUCCESS, ENDED_FAILURE = 1, -1


@dataclass(frozen=True)
class NodeProgress:
    """What is told of one node of a task."""

    id: int
    parent_id: int
    parent_label: str
    type: str
    label: str
    processor: str
    state: State
    progress_code: int
    progress_period: float
    progress_time: float
    progress_message: str
    params: dict[str, Param]


class Task:
    """A tree that is ticked until it ends. All but `preempt`, `pause` and `resume` is for the ticking thread.

    :param task_id: 0 to 32767.
    :param wmi: the world model as the task sees it.
    :param author: who asked for the task.
    """

    def __init__(self, task_id: int, wmi: Any, author: str = "") -> None:
        self.id = task_id
        self.author = author
        self.root = Root("root", wmi)
        self.root._id = task_id
        self._executor = Executor(wmi, self.wake)
        self._paused = threading.Event()
        self._ticks_left = 0
        self._preempt_asked = threading.Event()
        self._preempted = False
        self.ended = threading.Event()
        #: What `wake` calls; set by the ticker.
        self.waker: Callable[[], None] = lambda: None

    @property
    def state(self) -> State:
        return self.root.state

    # -- commands, from any thread -----------------------------------------------------------------------------

    def preempt(self) -> None:
        """Asks the task to end. It does at the next tick, paused or not."""
        self._preempt_asked.set()

    def pause(self) -> None:
        """No more ticks; everything keeps its state."""
        self._paused.set()

    def resume(self, ticks: int = 0) -> None:
        """Ticks again; given a number, pauses after that many ticks."""
        self._ticks_left = ticks
        self._paused.clear()

    def wake(self) -> None:
        """Asks for a tick at once."""
        self.waker()

    @property
    def paused(self) -> bool:
        return self._paused.is_set()

    # -- the ticking thread ------------------------------------------------------------------------------------

    @property
    def wants_tick(self) -> bool:
        """Whether the task has something to do now."""
        return not self.ended.is_set() and (self._preempt_asked.is_set() or not self._paused.is_set())

    def tick(self) -> State:
        """One tick. Sets `ended` when the task has ended. What a tick raises ends the task as a failure."""
        try:
            state = self._tick()
        except Exception as error:
            log.exception("task %s: the tick raised; the task ends", self.id)
            state = State.Failure
            text = f"the tick raised {type(error).__name__}: {error}"
            self.root._setProgress(text, ENDED_FAILURE)
            self._executor.failures.note(self.root, Failure(EXCEPTION, ENDED_FAILURE, text))
            self.root._setState(state)
        if state is not State.Running:
            self._close(state)
        elif self._ticks_left:
            self._ticks_left -= 1
            if not self._ticks_left:
                self._paused.set()
        return state

    def _tick(self) -> State:
        if self._preempt_asked.is_set() and not self._preempted:
            self._preempted = True
            self._executor.preempt(self.root)
            self.root._setState(State.Failure)
            self._executor.failures.note(self.root, Failure(PREEMPT, ENDED_FAILURE, "Preempted"))
        return self._executor.tick(self.root)

    def _close(self, state: State) -> None:
        for node in self.nodes():
            if isinstance(node, SkillWrapper):
                node.release()
        code = ENDED_SUCCESS if state is State.Success else ENDED_FAILURE
        self.root._setProgress(self._verdict(state), code)
        self._executor.changed = True
        self.ended.set()

    def _verdict(self, state: State) -> str:
        """The root's last message: why the task failed."""
        if state is State.Success:
            return "Success"
        if self._preempted:
            return "Preempted"
        if self.root.progress_code == ENDED_FAILURE:
            return self.root.progress_msg
        cause = self._executor.failures.cause()
        return f"{cause[0].printState()}: {cause[1].message}" if cause is not None else "Failure"

    def explanations(self) -> list[Explanation]:
        """Why nodes failed, each kind of failure of a node once, in the order in which they failed last.

        Any thread, also when the task has ended. The last 100 are kept.
        """
        return self._executor.failures.explanations()

    def nodes(self) -> Iterator[Any]:
        """All nodes, each before its children."""
        stack: list[Any] = [self.root]
        while stack:
            node = stack.pop()
            yield node
            stack.extend(reversed(node.children))

    def take_changed(self) -> bool:
        """Whether a state or progress has changed since this was asked last."""
        changed = self._executor.changed
        self._executor.changed = False
        return changed

    def progress(self) -> list[NodeProgress]:
        """The state of every node, each before its children.

        :raises WrongValue: the tree has more nodes than there are ids.
        """
        self._number_nodes()
        return [
            NodeProgress(
                id=node.id,
                parent_id=node.parent.id if node.parent is not None else -1,
                parent_label=node.parent.label if node.parent is not None else "",
                type=node.type,
                label=node.label,
                processor=node.processor.printType() if node.children else "",
                state=node.state,
                progress_code=node.progress_code,
                progress_period=node.progress_period,
                progress_time=node.progress_time,
                progress_message=node.progress_msg,
                params=node.params.getParamMap(),
            )
            for node in self.nodes()
        ]

    def _number_nodes(self) -> None:
        nodes = list(self.nodes())
        new = [node for node in nodes if node._id < 0]
        if not new:
            return
        used = {node._id for node in nodes}
        free = (number for number in range(MAX_ID + 1) if number not in used)
        for node in new:
            number = next(free, None)
            if number is None:
                raise WrongValue(f"task {self.id} has {len(nodes)} nodes, more than {MAX_ID}")
            node._id = number
