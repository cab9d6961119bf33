"""Runs the `on_preempt` handlers of a preempted task: skills that descriptions state, such as putting an object down.

All running nodes are preempted first. When they have ended, the handlers run as children of the task's root, one after
another, innermost first, each once and with a deadline of its own.
"""

from __future__ import annotations

import logging
import time
from collections import deque
from dataclasses import dataclass

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError
from skiros2_common.core.explanation import PREEMPT
from skiros2_common.core.preempt_handler import PreemptHandler
from skiros2_common.core.source_location import format_error_line
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.engine.elements import refresh_elements
from skiros2_skill.core.engine.executor import Executor
from skiros2_skill.core.engine.failures import Failure
from skiros2_skill.core.engine.hook_guard import HookAbandoned
from skiros2_skill.core.engine.hooks import PREEMPTED
from skiros2_skill.core.engine.skill_run import SkillRun
from skiros2_skill.core.tree.node import SkillInterface
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)


@dataclass
class _Running:
    """A running handler.

    :param name: of the handler and of its declaring node, for people.
    """

    name: str
    node: SkillWrapper
    handler: PreemptHandler
    deadline: float


class PreemptHandlers:
    """The handlers of one task. For the thread that ticks it, except for properties, `on_stop` and `forbid`.

    :param executor: of the task.
    :param wmi: the world model as the task sees it.
    """

    def __init__(self, executor: Executor, root: SkillInterface, wmi: WorldModelPort) -> None:
        self._executor, self._root, self._wmi = executor, root, wmi
        self._collected: list[tuple[SkillRun, PreemptHandler]] | None = None  # None: nodes are not preempted yet
        self._pending: deque[tuple[SkillRun, PreemptHandler]] = deque()
        self._running: _Running | None = None
        self._abandoned = ""
        #: When the handlers have to begin to end (s, monotonic): the deadline of the running one; 0: none has run.
        self.deadline = 0.0
        #: Why handlers have failed, for people.
        self.problems: list[str] = []

    @property
    def is_active(self) -> bool:
        """Whether a handler runs or will be considered."""
        return self._running is not None or bool(self._collected or self._pending)

    def on_stop(self, shuts_down: bool) -> None:
        """Handles a request to stop the task. Abandons a running handler; when the manager shuts down, none runs."""
        if shuts_down or self._running is not None:
            self.forbid("the manager shuts down" if shuts_down else "the task was stopped again")

    def forbid(self, reason: str) -> None:
        """Ends the running handler at the next tick, and starts no others."""
        self._abandoned = self._abandoned or reason
        self.deadline = min(self.deadline, time.monotonic())

    def begin(self, error: str = "") -> None:
        """Collects the handlers of the nodes that are preempted from now on; no-op when called again.

        :param error: an internal error, after which no handlers run.
        """
        if error:
            self.forbid(error)
        elif self._collected is None:
            self._collected = []
            self._executor.on_preempting = self._collect

    def _collect(self, run: SkillRun) -> None:
        if self._collected is None or run.instance is None or not run.has_started:
            return
        handler = run.instance.on_preempt
        if handler is not None and all(known is not run for known, _ in self._collected):
            self._collected.append((run, handler))

    def tick(self, state: State) -> State:
        """Ticks the running handler, and starts the next one when no node is ending.

        :param state: of the task without handlers; Running while nodes are ending.
        :returns: Running until the last handler has ended, then `state`.
        """
        executor = self._executor
        if self._collected is None or (state is State.Running and self._running is None):
            return state
        if self._collected:
            self._pending = deque(sorted(self._collected, key=lambda pair: -pair[0].node.depth))  # innermost first
            self._collected = []
            executor.breakpoints.ignore_all()
        executor.on_preempting = lambda run: None
        if self._running is not None:
            self._tick_running(self._running)
        while self._running is None and not executor.ending and self._pending:
            self._start(*self._pending.popleft())
        return State.Running if self._running is not None or executor.ending else state

    def _start(self, run: SkillRun, handler: PreemptHandler) -> None:
        name = f"on_preempt of {run.name} ({handler})"
        final = self._executor.final.forbids_reaction()
        refusal = self._abandoned or (final.text if final is not None else "")
        if refusal:
            self._report(f"{name} was not run: {refusal}")
            return
        try:
            if not self._executor.guard.call(run, "the condition of its on_preempt", self._applies, run, handler):
                log.info("%s: %s is not needed", self._root.label, name)
                return
            child = _bound_node(run, handler)
        except HookAbandoned:
            raise
        except FOREIGN_ERRORS as error:
            text = str(error) if isinstance(error, SkirosError) else format_error_line(error)
            self._report(f"{name} was not run: {text}")
            return
        log.info("%s: %s runs for at most %g s", self._root.label, name, handler.seconds)
        self._root.addChild(child)
        self._executor.final.begin_reaction(child)
        self._root._setProgress(f"ending: {name}", 0)
        self._executor.changed = True
        self.deadline = time.monotonic() + handler.seconds
        self._running = _Running(name, child, handler, self.deadline)
        self._tick_running(self._running)

    def _applies(self, run: SkillRun, handler: PreemptHandler) -> bool:
        """Whether the condition of a handler holds for the present elements of its run."""
        refresh_elements(run.element_slots, self._wmi, None)
        return handler.condition is None or bool(handler.condition.evaluate(run.params, self._wmi))

    def _tick_running(self, running: _Running) -> None:
        node = running.node
        if self._abandoned or time.monotonic() >= running.deadline:
            self._executor.preempt_all(node)
            late = f"has not ended within {running.handler.seconds:g} s"
            self._end(f"{running.name} {f'was abandoned: {self._abandoned}' if self._abandoned else late}")
            return
        state = node.visit(self._executor)
        if state is not State.Running:
            self._end("" if state is State.Success else f"{running.name} has failed: {node.progress_msg}")

    def _end(self, problem: str) -> None:
        self._running = None
        self.deadline = min(self.deadline, time.monotonic())
        if problem:
            self._report(problem)

    def _report(self, problem: str) -> None:
        self.problems.append(problem)
        self._executor.failures.record(self._root, Failure(PREEMPT, PREEMPTED, problem))
        log.warning("%s: %s", self._root.label, problem)


def _bound_node(run: SkillRun, handler: PreemptHandler) -> SkillWrapper:
    """A node for a handler with the values of a preempted run, as far as this has any.

    :raises UnknownName: no library has the skill.
    """
    child = SkillWrapper(handler.skill, handler.label, run.node.library)
    own = run.params.getParamMap()
    for key, param in child.declared_params().items():
        source = own.get(handler.source_of(key, param))
        values = [v for v in source.current if not (isinstance(v, Element) and v.isAbstract())] if source else []
        if values:
            child.specifyParamDefault(key, values)
    return child
