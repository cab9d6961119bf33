"""A task: one run of a tree on a manager, with its own id and blackboard."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import FOREIGN_ERRORS, RobotStopped
from skiros2_common.core.explanation import EXCEPTION, PREEMPT, STOP, Explanation
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.names import local_name
from skiros2_common.core.params import Param
from skiros2_common.core.signals import SignalSource
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_runs.core.states import TaskState
from skiros2_skill.core.engine.breakpoints import BreakpointReached, Breakpoints
from skiros2_skill.core.engine.devices import free_devices
from skiros2_skill.core.engine.evidence import Evidence
from skiros2_skill.core.engine.executor import Executor, StartsBlocked
from skiros2_skill.core.engine.failures import Failure
from skiros2_skill.core.engine.hook_guard import HookAbandoned, HungHook
from skiros2_skill.core.engine.skill_run import SkillRun
from skiros2_skill.core.runtime.preemption import PreemptHandlers
from skiros2_skill.core.tree.node import ControlNode, Root, SkillInterface, all_nodes
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)

#: Ids are int16 in messages.
MAX_ID = 32767

#: The progress code of the root of an ended task.
ENDED_SUCCESS, ENDED_FAILURE = 1, -1


@dataclass(eq=False)
class _StepBudget:
    """The remaining ticks that a command has requested."""

    ticks: int


@dataclass(frozen=True)
class NodeSnapshot:
    """A node of a task at one moment."""

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
    :param author: the client that has started the task.
    :param breakpoints: pause the task.
    :param signals: for hold-conditions on signals; None: no signal is published.
    :param goal: of which the task is a step; "": none.
    """

    def __init__(
        self, task_id: int, wmi: WorldModelPort, author: str = "", breakpoints: Breakpoints | None = None,
        signals: SignalSource | None = None, goal: str = "",
    ) -> None:  # fmt: skip
        self.id = task_id
        self.author = author
        self.root = Root(f"task_{task_id}", wmi)
        self.root._id = task_id
        self._wmi = wmi
        self._executor = Executor(wmi, self.wake, breakpoints)
        self._executor.hooks.task = goal or self._executor.hooks.task
        self._executor.parameters.signals = signals or self._executor.parameters.signals
        self._paused = threading.Event()
        self._step_budget: _StepBudget | None = None
        self._deciding = threading.Lock()
        self._decided = False
        #: Whether it runs on while the robot is stopped.
        self.allowed_when_stopped = False
        #: When the task was preempted, or its time to end was extended (s, monotonic); None: it was not preempted.
        self.preempted_at: float | None = None
        self._stopping = False  # all running nodes were preempted
        self._handlers = PreemptHandlers(self._executor, self.root, wmi)
        self._reason, self._stage, self._preempted_by = "Preempted", PREEMPT, ""
        self._abandons_ending = False
        self._hung: HungHook[SkillRun] | None = None
        self._node_ids = _NodeIds()
        #: Counts the changes of states and progress that `update_revision` has seen.
        self.revision = 0
        self.ended = threading.Event()
        #: Called by `wake`; set by the scheduler.
        self.waker: Callable[[], None] = lambda: None

    @property
    def state(self) -> State:
        """The state of the tree's root."""
        return self.root.state

    @property
    def evidence(self) -> Evidence:
        """Of what the engine does with the task. For the thread that ticks it."""
        return self._executor.hooks.evidence

    @property
    def status(self) -> TaskState:
        """The state of the task as clients see it."""
        if not self.ended.is_set():
            other = TaskState.PAUSED if self.paused else TaskState.RUNNING
            return TaskState.ENDING if self._handlers.is_active else other
        if self.state is State.Success:
            return TaskState.SUCCEEDED
        cause = self.cause()
        return TaskState.PREEMPTED if cause is not None and cause.stage == PREEMPT else TaskState.FAILED

    # -- commands, from any thread -----------------------------------------------------------------------------

    def preempt(self, stop: str = "", shuts_down: bool = False, by: str = "") -> bool:
        """Requests the end of the task: it fails at the next tick, even if paused, and starts no more skills, except
        the `on_preempt` of its skills. A request while such a handler runs abandons it.

        :param stop: the stop of the robot that fails the task: no handler runs; "": a command preempts it.
        :param shuts_down: no handler runs, because the manager shuts down.
        :param by: the client that preempts it; "" if unknown.
        :returns: False if it had ended before.
        """
        with self._deciding:
            if self._decided:
                return False
            if self.preempted_at is None:
                if stop:
                    self._reason, self._stage = stop, STOP
                self._preempted_by = by
                self.preempted_at = time.monotonic()
                self._executor.blocks_starts = True
            if stop:
                self._handlers.forbid(stop)
            self._handlers.on_stop(shuts_down)
            return True

    @property
    def grace_start(self) -> float | None:
        """When the preempted task, or its `on_preempt`, had to begin to end (s, monotonic); None: not preempted."""
        return None if self.preempted_at is None else max(self.preempted_at, self._handlers.deadline)

    def pause(self, reason: str = "") -> None:
        """Stops ticking the task; all nodes keep their state.

        :param reason: shown as the progress of the root.
        """
        self._paused.set()
        if reason:
            self.root._setProgress(reason, 0)
        self._executor.changed = True

    def resume(self, ticks: int = 0) -> None:
        """Continues a paused task.

        :param ticks: pauses after this many ticks; 0: does not.
        """
        self._step_budget = _StepBudget(ticks) if ticks else None
        self.root._setProgress("", 0)
        self._paused.clear()

    def wake(self) -> None:
        """Requests a tick at once."""
        self.waker()

    @property
    def paused(self) -> bool:
        return self._paused.is_set()

    @property
    def wants_tick(self) -> bool:
        """Whether the task is to be ticked."""
        return not self.ended.is_set() and (self.preempted_at is not None or not self._paused.is_set())

    @property
    def is_current(self) -> bool:
        """Whether the world model has not changed since the task's last refresh."""
        return self._executor.parameters.is_current

    def is_affected_by(self, changed: Collection[str]) -> bool:
        """Whether a change of the world model may change a hold-condition of a running node. Any thread.

        :param changed: see `changed_ids`.

        While another thread ticks the task, an outdated answer costs a superfluous tick, or delays one to the next
        period.
        """
        runs = self._executor.runs.copy().values()  # in one step, while another thread may change it
        return any(condition.affected_by(changed, run.params) for run in runs for condition in run.hold_conditions)

    @property
    def current_hook(self) -> str:
        """The hook that is being called, "" when none is."""
        return self._executor.guard.current

    # -- hung hooks, from the watchdog ------------------------------------------------------------------------

    def abandon_hook(self, now: float, seconds: float) -> str:
        """Abandons a hook that does not return; another thread may tick the task afterwards.

        :param now: s, monotonic.
        :param seconds: the duration of the tick.
        :returns: the reason, for people; "" when the hook has just returned.
        """
        hung = self._executor.guard.abandon()
        if hung is None:
            return ""
        self.preempted_at = now
        self._hung = hung
        hung.reason = f"{hung.name} has not returned for {seconds:.1f} s and was abandoned"
        return hung.reason

    def abandon_ending(self, now: float) -> None:
        """Ends, at the next tick, the preempted nodes that are still running.

        :param now: s, monotonic.
        """
        self.preempted_at = now
        self._abandons_ending = True

    # -- the ticking thread ------------------------------------------------------------------------------------

    def tick(self) -> State:
        """Ticks the task once. Sets `ended` when it has ended. An exception in the tick fails the task."""
        budget = self._step_budget  # a command during this tick sets the budget of the next ones
        try:
            state = self.evidence.tick(self._executor.guard, self._guarded_tick)
        except HookAbandoned:
            return State.Running  # another thread ticks the task now
        if state is not State.Running:
            state = self._decide(state)
            self._close(state)
        elif budget is not None:
            budget.ticks -= 1
            if not budget.ticks and budget is self._step_budget:
                self.pause()
        return state

    def _decide(self, state: State) -> State:
        """The final state: a task that was preempted during its last tick has failed."""
        with self._deciding:
            self._decided = True
            overruled = self.preempted_at is not None and not self._stopping
        if overruled:
            self._stopping = True
            self._executor.failures.record(self.root, self._ended_by(self._stage, self._reason))
            self.root._setState(State.Failure)
            return State.Failure
        return state

    def _guarded_tick(self) -> State:
        try:
            try:
                return self._tick()
            except StartsBlocked:
                return self._stop(self._stage, self._reason)
        except BreakpointReached as reached:
            self.pause(str(reached))
            return State.Running
        except HookAbandoned:
            raise
        except FOREIGN_ERRORS as error:
            log.exception("task %s: the tick raised; the task ends", self.id)
            return self._stop(EXCEPTION, f"the tick raised {type(error).__name__}: {error}")

    def _tick(self) -> State:
        if self._hung is not None:
            hung, self._hung = self._hung, None
            self._handlers.begin()
            self._reason += f"; {hung.reason}"
            self._executor.end_hung(hung)
            self._stopping = False
        if self._abandons_ending:
            self._abandons_ending = False
            self._executor.abandon_ending()
        if self.preempted_at is not None and not self._stopping:
            return self._stop(self._stage, self._reason)
        return self._handlers.tick(self._executor.tick(self.root))

    def _stop(self, stage: str, reason: str) -> State:
        """Preempts all running nodes."""
        self._handlers.begin(reason if stage != PREEMPT else "")
        self._executor.failures.record(self.root, self._ended_by(stage, reason))
        self._reason, self._stopping = reason, True
        self._executor.blocks_starts = False
        if self.preempted_at is None:
            self.preempted_at = time.monotonic()
        self._executor.preempt_all(self.root)
        self.root._setState(State.Failure)
        return self._handlers.tick(self._executor.tick(self.root))

    def _ended_by(self, stage: str, reason: str) -> Failure:
        """The failure of a task that is ended from outside, with the skills that run."""
        kind = FailureKind.SAFETY if stage == STOP else FailureKind.RETRYABLE
        running = _running_skills(self.root)
        return Failure(stage, _code(stage), reason, by=self._preempted_by, running=running, kind=kind)

    def _close(self, state: State) -> None:
        self._executor.failures.settle()
        for node in self.nodes():
            if node.run is not None:
                if node.run.locks:  # the tick has raised after locking, before the start
                    free_devices(node.run, self._wmi)
                node.run.release()
        code = ENDED_SUCCESS if state is State.Success else ENDED_FAILURE
        self.root._setProgress(self._final_message(state), code)
        self._executor.changed = True
        self.ended.set()

    def _final_message(self, state: State) -> str:
        """The last progress message of the root: why the task failed."""
        if state is State.Success:
            return "End"
        if self._stopping:
            return "; ".join([self._reason, *self._handlers.problems])
        cause = self._executor.failures.cause()
        if cause is None:
            return "Failure"
        node, failure = cause
        return f"{node.type}-{node.label}({node.state.name}): {failure.message}"

    def explanations(self) -> list[Explanation]:
        """Why nodes failed: each kind of failure of a node once, ordered by its last occurrence.

        Any thread, also after the end of the task. The last 100 are kept.
        """
        return self._executor.failures.explanations()

    def cause(self) -> Explanation | None:
        """The failure that made the task fail; None when no node failed."""
        cause = self._executor.failures.cause()
        return cause[1] if cause is not None else None

    def nodes(self) -> Iterator[SkillInterface]:
        """All nodes, parents before children."""
        return all_nodes(self.root)

    def update_revision(self) -> bool:
        """Increments the revision if a state or progress has changed since the last call. Returns whether it has."""
        changed = self._executor.changed
        self._executor.changed = False
        self.revision += changed
        return changed

    def progress(self) -> list[NodeSnapshot]:
        """The progress of the nodes, parents before children; nodes without an id are omitted. Any thread."""
        self._node_ids.assign(self)
        reason = "" if self.ended.is_set() or not self.paused else "paused"
        return [_progress_of(node, reason if node is self.root else "") for node in self.nodes() if node._id >= 0]


def _progress_of(node: SkillInterface, reason: str) -> NodeSnapshot:
    """:param reason: the message of a node without one."""
    return NodeSnapshot(
        id=node.id,
        parent_id=node.parent.id if node.parent is not None else -1,
        parent_label=node.parent.label if node.parent is not None else "",
        type=node.type,
        label=node.label if not isinstance(node, ControlNode) else node.label or node.processor.printType(),
        processor=node.processor.printType() if node.children or not isinstance(node, SkillWrapper) else "",
        state=node.state,
        progress_code=node.progress_code,
        progress_period=node.progress_period,
        progress_time=node.progress_time,
        progress_message=node.progress_msg or reason,
        params=node.present_params.getParamMap(),
    )


def _running_skills(root: SkillInterface) -> list[str]:
    """The names of the running skills that have no running skill below them."""
    names, with_running_children = [], set()
    for node in reversed([*all_nodes(root)]):
        is_running = isinstance(node, SkillWrapper) and node.state is State.Running
        if is_running and node not in with_running_children:
            names.append(node.label or local_name(node.type))
        if is_running or node in with_running_children:
            with_running_children.add(node.parent)
    return list(dict.fromkeys(reversed(names)))


def _code(stage: str) -> int:
    """The code of the failure that ends a task."""
    return RobotStopped.CODE if stage == STOP else ENDED_FAILURE


class _NodeIds:
    """Assigns ids to the nodes of a task. Any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._overflow_logged = False

    def assign(self, task: Task) -> None:
        """Assigns ids to the nodes that have none, as long as there are free ones."""
        with self._lock:
            nodes = list(task.nodes())
            new = [node for node in nodes if node._id < 0]
            if not new:
                return
            used = {node._id for node in nodes}
            free = (number for number in range(MAX_ID + 1) if number not in used)
            for node in new:
                node._id = next(free, -1)
            if nodes[-1]._id < 0 and not self._overflow_logged:
                self._overflow_logged = True
                log.warning("task %s has %s nodes; only the first %s are reported", task.id, len(nodes), MAX_ID + 1)
