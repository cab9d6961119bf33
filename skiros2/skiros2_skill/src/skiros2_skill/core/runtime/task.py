"""A task: a tree under a root, with an id and a blackboard of its own."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.core.explanation import EXCEPTION, PREEMPT, Explanation
from skiros2_common.core.params import Param
from skiros2_skill.core.engine.breakpoints import Break, Breakpoints
from skiros2_skill.core.engine.devices import free_devices
from skiros2_skill.core.engine.endings import bury, give_up, preempt_all
from skiros2_skill.core.engine.executor import Executor, Halt
from skiros2_skill.core.engine.failures import Failure
from skiros2_skill.core.tree.groups import Root, Skill
from skiros2_skill.core.tree.hook_guard import LeftBehind, Stuck
from skiros2_skill.core.tree.node import all_nodes
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)

#: Ids travel as int16.
MAX_ID = 32767

#: What a root's progress code is when its task has ended.
ENDED_SUCCESS, ENDED_FAILURE = 1, -1


@dataclass(eq=False)
class _Allowance:
    """How many ticks a command has asked for that are to come."""

    ticks: int


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
    """A tree that is ticked until it ends, by one thread at a time.

    :param task_id: 0 to 32767.
    :param wmi: the world model as the task sees it.
    :param author: who asked for the task.
    :param breakpoints: where it pauses by itself.
    """

    def __init__(self, task_id: int, wmi: Any, author: str = "", breakpoints: Breakpoints | None = None) -> None:
        self.id = task_id
        self.author = author
        self.root = Root(f"task_{task_id}", wmi)
        self.root._id = task_id
        self._wmi = wmi
        self._executor = Executor(wmi, self.wake, breakpoints)
        self._paused = threading.Event()
        self._allowance: _Allowance | None = None
        self._deciding = threading.Lock()
        self._decided = False
        #: When it was asked to end, or given more time for that (s, monotonic); None: it was not.
        self.preempted_at: float | None = None
        self._stopping = False  # all that ran was preempted
        self._reason = "Preempted"  # why
        self._gives_up = False
        self._stuck: Stuck | None = None
        self._tells_all = True
        self._numbering = threading.Lock()
        #: How often `take_changed` has answered yes.
        self.changes = 0
        self.ended = threading.Event()
        #: What `wake` calls; set by the ticker.
        self.waker: Callable[[], None] = lambda: None

    @property
    def state(self) -> State:
        return self.root.state

    # -- commands, from any thread -----------------------------------------------------------------------------

    def preempt(self) -> bool:
        """Asks the task to end. It fails at the next tick, paused or not, whatever a hook still answers, and starts no
        more skills. Returns whether it had not ended before."""
        with self._deciding:
            if self._decided:
                return False
            if self.preempted_at is None:
                self.preempted_at = time.monotonic()
                self._executor.halts = True
            return True

    def pause(self) -> None:
        """No more ticks; everything keeps its state."""
        self._paused.set()
        self._executor.changed = True

    def hold(self, reason: str) -> None:
        """Pauses the task and says so in its progress."""
        self._paused.set()
        self.root._setProgress(reason, 0)
        self._executor.changed = True

    def resume(self, ticks: int = 0) -> None:
        """Ticks again; given a number, pauses after that many ticks."""
        self._allowance = _Allowance(ticks) if ticks else None
        self.root._setProgress("", 0)
        self._paused.clear()

    def wake(self) -> None:
        """Asks for a tick at once."""
        self.waker()

    @property
    def paused(self) -> bool:
        return self._paused.is_set()

    @property
    def wants_tick(self) -> bool:
        """Whether the task has something to do now."""
        return not self.ended.is_set() and (self.preempted_at is not None or not self._paused.is_set())

    @property
    def has_seen_world(self) -> bool:
        """Whether nothing has changed in the world model since the last tick looked at it."""
        return self._executor.has_seen_world

    @property
    def place(self) -> str:
        """The hook that is being called, "" when none is."""
        return self._executor.inside.place

    # -- a tick that does not end, from the thread that looks after it ------------------------------------------

    def leave_behind(self, now: float, seconds: float) -> str:
        """Takes the task away from a thread whose hook does not return; another one may tick it then.

        :param seconds: how long the tick has taken.
        :returns: what was left behind, in words; "" when the hook has returned just now.
        """
        stuck = self._executor.inside.take()
        if stuck is None:
            return ""
        self.preempted_at = now
        self._stuck = stuck
        stuck.reason = f"{stuck.place} has not returned for {seconds:.1f} s and was left behind"
        return stuck.reason

    def give_up(self, now: float) -> None:
        """The nodes that were preempted and still go on are ended at the next tick."""
        self.preempted_at = now
        self._gives_up = True

    # -- the ticking thread ------------------------------------------------------------------------------------

    def tick(self) -> State:
        """One tick. Sets `ended` when the task has ended. What a tick raises ends the task as a failure."""
        allowance = self._allowance  # a command while this tick is under way allows for the next ones
        try:
            state = self._guarded_tick()
        except LeftBehind:
            return State.Running  # the task is another thread's now
        if state is not State.Running:
            state = self._decide(state)
            self._close(state)
        elif allowance is not None:
            allowance.ticks -= 1
            if not allowance.ticks and allowance is self._allowance:
                self.pause()
        return state

    def _decide(self, state: State) -> State:
        """The state that a task ends with: one that was preempted meanwhile has failed."""
        with self._deciding:
            self._decided = True
            overruled = self.preempted_at is not None and not self._stopping
        if overruled:
            self._stopping = True
            self._executor.failures.note(self.root, Failure(PREEMPT, ENDED_FAILURE, self._reason))
            self.root._setState(State.Failure)
            return State.Failure
        return state

    def _guarded_tick(self) -> State:
        try:
            try:
                return self._tick()
            except Halt:
                return self._stop(PREEMPT, self._reason)
        except Break as reached:
            self.hold(str(reached))
            return State.Running
        except LeftBehind:
            raise
        except FOREIGN_ERRORS as error:
            log.exception("task %s: the tick raised; the task ends", self.id)
            return self._stop(EXCEPTION, f"the tick raised {type(error).__name__}: {error}")

    def _tick(self) -> State:
        if self._stuck is not None:
            stuck, self._stuck = self._stuck, None
            self._reason += f"; {stuck.reason}"
            bury(self._executor, stuck)
            self._stopping = False
        if self._gives_up:
            self._gives_up = False
            give_up(self._executor)
        if self.preempted_at is not None and not self._stopping:
            return self._stop(PREEMPT, self._reason)
        return self._executor.tick(self.root)

    def _stop(self, stage: str, reason: str) -> State:
        """Preempts all that runs."""
        self._executor.failures.note(self.root, Failure(stage, ENDED_FAILURE, reason))
        self._reason, self._stopping = reason, True
        self._executor.halts = False
        if self.preempted_at is None:
            self.preempted_at = time.monotonic()
        preempt_all(self._executor, self.root)
        self.root._setState(State.Failure)
        return self._executor.tick(self.root)

    def _close(self, state: State) -> None:
        for node in self.nodes():
            if isinstance(node, SkillWrapper):
                if node.locked:  # the tick has raised between the lock and the start
                    free_devices(node, self._wmi)
                node.release()
        code = ENDED_SUCCESS if state is State.Success else ENDED_FAILURE
        self.root._setProgress(self._verdict(state), code)
        self._executor.changed = True
        self.ended.set()

    def _verdict(self, state: State) -> str:
        """The root's last message: why the task failed."""
        if state is State.Success:
            return "End"
        if self._stopping:
            return self._reason
        cause = self._executor.failures.cause()
        if cause is None:
            return "Failure"
        node, failure = cause
        return f"{node._type}-{node._label}({node._state.name}): {failure.message}"

    def explanations(self) -> list[Explanation]:
        """Why nodes failed, each kind of failure of a node once, in the order in which they failed last.

        Any thread, also when the task has ended. The last 100 are kept.
        """
        return self._executor.failures.explanations()

    def cause(self) -> Explanation | None:
        """The failure because of which the task failed; None when no node failed."""
        cause = self._executor.failures.cause()
        return cause[1] if cause is not None else None

    def nodes(self) -> Iterator[Any]:
        """All nodes, each before its children."""
        return all_nodes(self.root)

    def take_changed(self) -> bool:
        """Whether a state or progress has changed since this was asked last."""
        changed = self._executor.changed
        self._executor.changed = False
        self.changes += changed
        return changed

    def progress(self) -> list[NodeProgress]:
        """The state of every node, each before its children; of those for which there are ids. Any thread."""
        with self._numbering:
            self._number_nodes()
        reason = "" if self.ended.is_set() or not self.paused else "paused"
        return [
            NodeProgress(
                id=node.id,
                parent_id=node.parent.id if node.parent is not None else -1,
                parent_label=node.parent.label if node.parent is not None else "",
                type=node.type,
                label=node.label if not isinstance(node, Skill) else node.label or node.processor.printType(),
                processor=node.processor.printType() if node.children or not isinstance(node, SkillWrapper) else "",
                state=node.state,
                progress_code=node.progress_code,
                progress_period=node.progress_period,
                progress_time=node.progress_time,
                progress_message=node.progress_msg or (reason if node is self.root else ""),
                params=node._params.getParamMap(),  # as it is: a node that waits is not described for this
            )
            for node in self.nodes()
            if node._id >= 0
        ]

    def _number_nodes(self) -> None:
        nodes = list(self.nodes())
        new = [node for node in nodes if node._id < 0]
        if not new:
            return
        used = {node._id for node in nodes}
        free = (number for number in range(MAX_ID + 1) if number not in used)
        for node in new:
            node._id = next(free, -1)
        if nodes[-1]._id < 0 and self._tells_all:
            self._tells_all = False
            log.warning("task %s has %s nodes; only the first %s are told of", self.id, len(nodes), MAX_ID + 1)
