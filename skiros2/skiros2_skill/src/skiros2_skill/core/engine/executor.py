"""Starts, ticks and ends the nodes of a task.

An executor belongs to one task and is used by one thread at a time. The parameters of running nodes are refreshed only
when something has changed; see `Parameters`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError
from skiros2_common.core.explanation import EXCEPTION, PARAMETER, POST, PREEMPT, START
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.revision import local_revision
from skiros2_skill.core.engine.blackboard import Blackboard, add_slots, has_changed_in_place, scope
from skiros2_skill.core.engine.breakpoints import BreakpointReached, Breakpoints, TaskBreakpoints
from skiros2_skill.core.engine.checks import check_conditions
from skiros2_skill.core.engine.devices import free_devices
from skiros2_skill.core.engine.failures import EXECUTE_RAISED, PREEMPT_RAISED, START_RAISED, Failure, Failures
from skiros2_skill.core.engine.hooks import RAISED, Hooks, refusal_text
from skiros2_skill.core.engine.parameters import Parameters
from skiros2_skill.core.engine.selection import select_implementation
from skiros2_skill.core.tree.compound import SkillBase
from skiros2_skill.core.tree.hook_guard import HookAbandoned, HungHook
from skiros2_skill.core.tree.node import SkillInterface, all_nodes
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)

_RUNNING: State = State.Running
_SUCCESS: State = State.Success
_FAILURE: State = State.Failure
_Wake = Callable[[], None]
_Inherited = SkillInterface.execute  # the `execute` of a compound that does not override it


class Halt(Exception):
    """The task was preempted during this tick: no more skills are started."""


class Executor:
    """Ticks the nodes of one task.

    :param wmi: the world model as the task sees it.
    :param wake: requests a tick at once; any thread may call it.
    :param breakpoints: pause the task.
    """

    def __init__(self, wmi: Any, wake: _Wake = lambda: None, breakpoints: Breakpoints | None = None) -> None:
        self._wmi, self._wake = wmi, wake
        self._breakpoints = TaskBreakpoints(breakpoints)
        #: Preempted nodes that are still running.
        self.ending: list[SkillWrapper] = []
        self.failures = Failures(wmi)
        self.hooks = Hooks(self.failures)
        self.guard = self.hooks.guard
        self.parameters = Parameters(wmi, self.guard)
        #: Whether the task was preempted and its nodes are not preempted yet.
        self.halt_requested = False
        #: Whether a state or progress has changed; the reader resets it.
        self.changed = True

    def tick(self, root: SkillInterface) -> State:
        """Ticks a tree once, and the nodes that are still ending. Returns the state of the tree."""
        if self.parameters.blackboard is None:
            self.parameters.blackboard = Blackboard(ParamHandler() if isinstance(root, SkillWrapper) else root._params)
        self.parameters.update_revision()
        for node in list(self.ending):
            self._tick_ending(node)
        state: State = root._state
        if state is not _SUCCESS and state is not _FAILURE:
            state = self.execute(root)
        if self._breakpoints and state is _RUNNING and not self.ending:
            self._breakpoints.raise_if_reached()
        return _RUNNING if self.ending else state

    # -- one node ----------------------------------------------------------------------------------------------

    def execute(self, node: Any) -> State:
        """Ticks a group; called from `visit`."""
        if node._state is not _RUNNING:
            node._start_progress()
            _set_scope(node)
            node._processor.reset()
            self.set_state(node, _RUNNING)
        state: State = node._processor.processChildren(node._children, self)
        if state is not _RUNNING:
            self.set_state(node, state)
        return state

    def execute_skill(self, node: SkillWrapper) -> State:
        """Ticks a skill; called from `visit`."""
        if node._state is not _RUNNING:
            if not self._start(node):
                return _FAILURE
        elif self.ending and node in self.ending:
            return _RUNNING
        if node.seen_revision != self.parameters.revision or node.volatile:
            failure = self.parameters.refresh(node)
            if failure is not None:
                return self.fail_running(node, failure)
        local, version = local_revision.current, self.parameters.world_version
        if node.is_compound:
            state = self._tick_children(node)
        else:
            state = self.hooks.execute(node)
            node.steady_revision = -1 if node.volatile or node.lent else node.seen_revision
        if state is not _RUNNING or local_revision.current != local or (node.lent and has_changed_in_place(node.lent)):
            return self.finish_tick(node, state, version)
        self._copy_progress(node)
        self.parameters.update_revision()
        return _RUNNING

    def finish_tick(self, node: SkillWrapper, state: State, version: int) -> State:
        """Writes back what a tick has changed, and ends the node unless it stays Running.

        :param version: of the world model before the tick.
        """
        self._copy_progress(node)
        if self._write_back(node, state, version):
            return _RUNNING if state is _RUNNING else self.end(node, state)
        return self.end(node, _FAILURE) if state is not _RUNNING else self.fail_running(node)

    def preempt(self, node: Any) -> State:
        """Preempts a node, leaves first; called from `visitPreempt`. Returns Running while it is still ending."""
        if not node.hasState(_RUNNING):
            state: State = node._state
            return state
        for child in node._children:
            if child.hasState(_RUNNING):
                child.visitPreempt(self)
        if not isinstance(node, SkillWrapper):
            self.set_state(node, _FAILURE)
            return _FAILURE
        if node in self.ending:
            return _RUNNING
        self.parameters.try_pull(node)
        state = self.hooks.on_preempt(node)
        self._copy_progress(node)
        if state is _RUNNING:
            self.ending.append(node)
            node.steady_revision = -1
            return _RUNNING
        return self.end(node, state, preempted=True)

    # -- start -------------------------------------------------------------------------------------------------

    def _start(self, node: SkillWrapper) -> bool:
        """Selects an implementation and starts it. Returns False if that failed; the node's progress has the reason."""
        if self.halt_requested:
            raise Halt
        if self._breakpoints:
            self._breakpoints.before_start(node)
        node._start_progress()
        node.has_started = False
        _set_scope(node)
        try:
            candidates = node.candidates()
            revision, revisions = self.parameters.revision, self.parameters.revisions(node)
        except SkirosError as error:
            return self._fail_start(node, Failure(START, START_RAISED, str(error)))
        arguments = (node, candidates, self._wmi, revisions, self.parameters.blackboard)
        failure = self.guard.call(node, "the inference of its parameters", select_implementation, *arguments)
        return self._start_run(node, revision) if failure is None else self._fail_start(node, failure)

    def _start_run(self, node: SkillWrapper, revision: int) -> bool:
        """Expands the subtree and calls `onStart`.

        :param revision: at which its parameters were read.
        """
        instance = node.getInstance()
        instance._start_progress()
        instance._waker = self._wake
        node._input = {key: list(p._values) for key, p in node._params._params.items()}
        self.set_state(node, _RUNNING)
        instance._setState(_RUNNING)
        node.is_compound = isinstance(instance, SkillBase)
        node.runs_after_children = node.is_compound and type(instance).execute is not _Inherited
        local = local_revision.current
        refused = self.hooks.on_start(node, self._start_instance)
        self._copy_progress(node)
        if refused:
            (self.end if refused is RAISED else self._close)(node, _FAILURE)
            return False
        node.has_started = True
        is_current = local_revision.current == local and self.parameters.revision == revision
        if local_revision.current != local:
            add_slots(node, node.slots)
        self.parameters.push(node, everything=True, removes=False)
        self.parameters.start(node, self.parameters.revision if is_current else -1)
        self.parameters.update_revision()
        return True

    def _start_instance(self, node: SkillWrapper) -> str:
        """Expands the node and calls `onStart`. Returns why it refuses; "" when it does not."""
        instance = node.getInstance()
        if isinstance(instance, SkillBase) and (not node.expanded or instance.expand_on_start):
            node.wrapper_expand()
            node.expanded = True
        node._processor.reset()
        refusal = refusal_text(instance.onStart())
        node.adopt_description()  # onStart may declare parameters
        return refusal

    def _fail_start(self, node: SkillWrapper, failure: Failure) -> bool:
        self.set_state(node, _FAILURE)
        return self._report_failure(node, failure)

    # -- run ---------------------------------------------------------------------------------------------------

    def _report_failure(self, node: SkillWrapper, failure: Failure) -> bool:
        """Sets the progress of a failed node and records the failure. Returns False."""
        node._setProgress(failure.message, failure.code)
        self._record(node, failure)
        return False

    def _record(self, node: SkillWrapper, failure: Failure) -> None:
        self.guard.call(node, "the explanation of its failure", self.failures.record, node, failure)
        if self._breakpoints:
            self._breakpoints.at_failure(failure.conditions)

    def fail_running(self, node: SkillWrapper, failure: Failure | None = None) -> State:
        """Preempts a running node and fails it, with its present progress or with a failure."""
        if failure is not None:
            self._report_failure(node, failure)
        message, code = node._progress_msg, node._progress_code
        self.preempt(node)
        if node in self.ending:  # the node has failed, though its end takes more ticks
            node.failure_progress = (message, code)
            return _FAILURE
        node._setProgress(message, code)
        self.set_state(node, _FAILURE)
        return _FAILURE

    def _tick_children(self, node: SkillWrapper) -> State:
        try:
            state: State = node._processor.processChildren(node._children, self)
        except (HookAbandoned, BreakpointReached):
            raise
        except FOREIGN_ERRORS as error:  # raised by a library's own processor or node class
            return self.hooks.record_exception(node, error, EXECUTE_RAISED)
        if state is _RUNNING:
            return state
        try:
            self.parameters.pull(node)
        except SkirosError as error:
            self._report_failure(node, Failure(PARAMETER, EXECUTE_RAISED, str(error)))
            return _FAILURE
        return self.hooks.execute(node, state) if node.runs_after_children else state

    def _tick_ending(self, node: SkillWrapper) -> None:
        """Ticks a preempted node that is still running."""
        state = self.hooks.execute(node, _FAILURE, late=True)
        self._copy_progress(node)
        if state is not _RUNNING:
            self.ending.remove(node)
            self.end(node, state, preempted=True)
            if node.failure_progress is not None:
                node._setProgress(*node.failure_progress)
                self.set_state(node, _FAILURE)
                node.failure_progress = None

    # -- end ---------------------------------------------------------------------------------------------------

    def end(self, node: SkillWrapper, state: State, preempted: bool = False) -> State:
        """Ends a node: frees its devices, checks its post-conditions, calls `onEnd` and pushes its parameters."""
        instance = node.getInstance()
        for child in node._children:
            if child._state is _RUNNING:
                child.visitPreempt(self)
        self.free(node)
        if state is _SUCCESS and node._post_conditions and not preempted:
            arguments = (POST, node._post_conditions, node._params, self._wmi)
            failure = self.guard.call(node, "its conditions", check_conditions, *arguments)
            if failure is not None:
                instance._setProgress(failure.message, failure.code)
                self._record(node, failure)
                state = _FAILURE
        if state is _FAILURE and not preempted and node._children and instance._progress_code >= 0:
            cause = self.failures.cause_below(node)
            if cause is not None:  # the compound has not set a progress itself
                instance._setProgress(*cause)
        elif state is _SUCCESS and node.is_compound and not instance._progress_code:
            instance._setProgress("End", 1)
        state = self.hooks.on_end(node, state, preempted)
        self._copy_progress(node)
        if state is _SUCCESS and not node.is_compound:
            self.parameters.log_unwritten(node)
        return self._close(node, state)

    def _close(self, node: SkillWrapper, state: State) -> State:
        """Pushes the parameters of an ended node and releases its implementation."""
        if node.has_started:
            self.parameters.push(node, everything=True)
        self.free(node)
        node.getInstance()._setState(state)
        if isinstance(node.getInstance(), SkillBase):
            node.end_run()  # the subtree still belongs to this instance
        else:
            node.release()
        self.set_state(node, state)
        if self._breakpoints:
            self._breakpoints.after_end(node)
        self.parameters.update_revision()
        return state

    def free(self, node: SkillWrapper) -> None:
        """Unlocks the devices that the node has locked."""
        if node.locked:
            self.guard.call(node, "the release of its devices", free_devices, node, self._wmi)

    # -- helpers -----------------------------------------------------------------------------------------------

    def _write_back(self, node: SkillWrapper, state: State, version: int) -> bool:
        """Calls `Parameters.write_back`. Returns False if that failed; the node's progress has the reason."""
        try:
            self.guard.call(node, "the writing of its elements", self.parameters.write_back, node, state, version)
        except SkirosError as error:
            text = f"{node.label}: {error}"
            node.getInstance()._setProgress(text, EXECUTE_RAISED)
            self._copy_progress(node)
            self._record(node, Failure(EXCEPTION, EXECUTE_RAISED, text))
            log.error("%s", text)
            return False
        return True

    def set_state(self, node: SkillInterface, state: State) -> None:
        node._setState(state)
        self.changed = True

    def _copy_progress(self, node: SkillWrapper) -> None:
        if node.copy_progress():
            self.changed = True


def _set_scope(node: SkillInterface) -> None:
    node._scope = scope(node._parent._scope, node._remaps) if node._parent is not None else node._remaps


def preempt_all(executor: Executor, root: SkillInterface) -> None:
    """Preempts all running nodes of a tree, even when a library's own node class raises."""
    try:
        executor.preempt(root)
    except HookAbandoned:
        raise
    except Exception:
        log.exception("%s: a node could not be preempted", root.printState())
        for node in reversed(list(all_nodes(root))):
            if isinstance(node, SkillWrapper) and node.hasState(_RUNNING):
                executor.preempt(node)


def end_hung_node(executor: Executor, hung: HungHook) -> None:
    """Ends the node whose hook was abandoned, without calling its other hooks; its instance is never used again."""
    node = hung.node
    if node in executor.ending:
        executor.ending.remove(node)
    node.abandon()
    node._setProgress(hung.reason, PREEMPT_RAISED)
    executor.failures.record(node, Failure(PREEMPT, PREEMPT_RAISED, hung.reason))
    executor.set_state(node, _FAILURE)
    for child in node.children:
        if child.hasState(_RUNNING):
            child.visitPreempt(executor)
    executor.free(node)


def abandon_ending_nodes(executor: Executor) -> None:
    """Ends the preempted nodes that are still running; their instances are never used again."""
    for node in list(executor.ending):
        executor.ending.remove(node)
        text = "did not end in time after its preemption"
        node.getInstance()._setProgress(text, PREEMPT_RAISED)
        executor.failures.record(node, Failure(PREEMPT, PREEMPT_RAISED, text))
        node.abandoned = True
        executor.end(node, _FAILURE, preempted=True)


SkillInterface.executor_class = Executor
