"""Starts, ticks and ends the nodes of a task.

An executor belongs to one task and is used by one thread at a time. The parameters of running nodes are refreshed only
when something has changed; see `Parameters`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError
from skiros2_common.core.explanation import EXCEPTION, PARAMETER, POST, PREEMPT, START, Explanation
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.revision import local_revision
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.engine.blackboard import Blackboard, add_slots, has_changed_in_place, scope
from skiros2_skill.core.engine.breakpoints import BreakpointReached, Breakpoints, TaskBreakpoints
from skiros2_skill.core.engine.devices import free_devices
from skiros2_skill.core.engine.failures import (
    EXECUTE_RAISED,
    PREEMPT_RAISED,
    START_RAISED,
    Failure,
    Failures,
    check_conditions,
)
from skiros2_skill.core.engine.hooks import RAISED, Hooks, refusal_text
from skiros2_skill.core.engine.parameters import Parameters
from skiros2_skill.core.engine.selection import Take, preview, select_implementation, take
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

    def __init__(self, wmi: WorldModelPort, wake: _Wake = lambda: None, breakpoints: Breakpoints | None = None) -> None:
        self._wmi, self._wake = wmi, wake
        self.breakpoints = TaskBreakpoints(breakpoints)
        self._root: SkillInterface | None = None
        self.ending: list[SkillWrapper] = []  # preempted nodes that are still running
        self.on_preempting: Callable[[SkillWrapper], None] = lambda node: None  # called before each preemption
        self.failures = Failures(wmi)
        self.hooks = Hooks(self.failures)
        self.guard = self.hooks.guard
        self.parameters = Parameters(wmi, self.guard, wake)
        #: Whether the task was preempted and its nodes are not preempted yet.
        self.halt_requested = False
        #: Whether a state or progress has changed; the reader resets it.
        self.changed = True

    def tick(self, root: SkillInterface) -> State:
        """Ticks a tree once, and the nodes that are still ending. Returns the state of the tree."""
        if self._root is not root:
            self._root = root
            self.parameters.blackboard = Blackboard(ParamHandler() if isinstance(root, SkillWrapper) else root._params)
        self.parameters.update_revision()
        for node in list(self.ending):
            self._tick_ending(node)
        state: State = root.state
        if state is not _SUCCESS and state is not _FAILURE:
            state = self.execute(root)
        if self.breakpoints and state is _RUNNING and not self.ending:
            self.breakpoints.raise_if_reached()
        return _RUNNING if self.ending else state

    # -- one node ----------------------------------------------------------------------------------------------

    def execute(self, node: SkillInterface) -> State:
        """Ticks a group; called from `visit`."""
        if node.state is not _RUNNING:
            node.begin_progress()
            _set_scope(node)
            node.processor.reset()
            self.set_state(node, _RUNNING)
        state: State = node.processor.processChildren(node.children, self)
        if state is not _RUNNING:
            self.set_state(node, state)
        return state

    def execute_skill(self, node: SkillWrapper) -> State:
        """Ticks a skill; called from `visit`."""
        if node.state is not _RUNNING:
            if not self._start(node):
                return _FAILURE
        elif self.ending and node in self.ending:
            return _RUNNING
        if node.stale or node.volatile or self.parameters.world_changed:
            failure = self.parameters.refresh(node)
            if failure is not None:
                return self.fail_running(node, failure)
        local, version = local_revision.current, self.parameters.world_version
        if node.is_compound:
            state = self._tick_children(node)
        else:
            state = self.hooks.execute(node)
            node.steady = not (node.volatile or node.lent or node.stale)
        if state is not _RUNNING or local_revision.current != local or (node.lent and has_changed_in_place(node.lent)):
            return self._finish_tick(node, state, version)
        self._copy_progress(node)
        self.parameters.update_revision()
        return _RUNNING

    def finish_execute(self, node: SkillWrapper, answer: object, error: Exception | SystemExit | None = None) -> State:
        """Handles what the `execute` of a primitive has returned or raised; called from `visit`."""
        state = self.hooks.execute_state(node, answer) if error is None else self.hooks.execute_raised(node, error)
        return self._finish_tick(node, state, self.parameters.world_version)

    def _finish_tick(self, node: SkillWrapper, state: State, version: int) -> State:
        """Writes back what a tick has changed since a version of the world model, and ends the node unless it runs."""
        self._copy_progress(node)
        if self._write_back(node, state, version):
            return _RUNNING if state is _RUNNING else self.end(node, state)
        return self.end(node, _FAILURE) if state is not _RUNNING else self.fail_running(node)

    def preempt(self, node: SkillInterface) -> State:
        """Preempts a node, leaves first; called from `visitPreempt`. Returns Running while it is still ending."""
        if not node.hasState(_RUNNING):
            state: State = node.state
            return state
        for child in node.children:
            if child.hasState(_RUNNING):
                child.visitPreempt(self)
        if not isinstance(node, SkillWrapper):
            self.set_state(node, _FAILURE)
            return _FAILURE
        if node in self.ending:
            return _RUNNING
        self.on_preempting(node)
        self.parameters.try_pull(node)
        state = self.hooks.on_preempt(node)
        self._copy_progress(node)
        if state is _RUNNING:
            self.ending.append(node)
            node.steady = False
            return _RUNNING
        return self.end(node, state, preempted=True)

    # -- start -------------------------------------------------------------------------------------------------

    def _start(self, node: SkillWrapper) -> bool:
        """Selects an implementation and starts it. Returns False if that failed; the node's progress has the reason."""
        if self.halt_requested:
            raise Halt
        if self.breakpoints:
            self.breakpoints.before_start(node)
        node.begin_progress()
        node.has_started = False
        node.evaluated = {}
        version = self.parameters.world_version
        failure = self.select(node, take)
        return self._start_run(node, version) if failure is None else self._fail_start(node, failure)

    def select(self, node: SkillWrapper, take: Take) -> Failure | None:
        """Selects an implementation of a node; see `select_implementation`."""
        _set_scope(node)
        try:
            candidates, revisions = node.candidates(), self.parameters.revisions(node)
        except SkirosError as error:
            return Failure(START, START_RAISED, str(error))
        arguments = (node, candidates, self._wmi, revisions, self.parameters.blackboard, take)
        return self.guard.call(node, "the inference of its parameters", select_implementation, *arguments)

    def _start_run(self, node: SkillWrapper, version: int) -> bool:
        """Expands the subtree and calls `onStart`. Its parameters were read in this version of the world model."""
        instance = node.instance
        instance.begin_progress()
        instance.request_tick = self._wake
        node.input_values = {key: list(p.current) for key, p in node._params._params.items()}
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
        is_current = local_revision.current == local and self.parameters.world_version == version
        if local_revision.current != local:
            add_slots(node, node.slots)
        self.parameters.push(node, everything=True, removes=False)
        self.parameters.start(node, is_current)
        self.parameters.update_revision()
        return True

    def _start_instance(self, node: SkillWrapper) -> str:
        """Expands the node and calls `onStart`. Returns why it refuses; "" when it does not."""
        instance = node.instance
        if isinstance(instance, SkillBase) and (not node.expanded or instance.expand_on_start):
            node.wrapper_expand()
            node.expanded = True
        node.processor.reset()
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
        if self.breakpoints:
            self.breakpoints.at_failure(failure.conditions)

    def fail_running(self, node: SkillWrapper, failure: Failure | None = None) -> State:
        """Preempts a running node and fails it, with its present progress or with a failure."""
        if failure is not None:
            self._report_failure(node, failure)
        message, code = node.progress_msg, node._progress_code
        self.preempt(node)
        if node in self.ending:  # the node has failed, though its end takes more ticks
            node.failure_progress = (message, code)
            return _FAILURE
        node._setProgress(message, code)
        self.set_state(node, _FAILURE)
        return _FAILURE

    def _tick_children(self, node: SkillWrapper) -> State:
        try:
            state: State = node.processor.processChildren(node.children, self)
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
        instance = node.instance
        for child in node.children:
            if child.state is _RUNNING:
                child.visitPreempt(self)
        self.free(node)
        if state is _SUCCESS and node.post_conditions and not preempted:
            arguments = (POST, node.post_conditions, node._params, self._wmi, node.evaluated)
            failure = self.guard.call(node, "its conditions", check_conditions, *arguments)
            if failure is not None:
                instance._setProgress(failure.message, failure.code)
                self._record(node, failure)
                state = _FAILURE
        if state is _FAILURE and not preempted and node.children and instance._progress_code >= 0:
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
        self.parameters.end(node)
        self.free(node)
        node.instance._setState(state)
        if isinstance(node.instance, SkillBase):
            node.end_run()  # the subtree still belongs to this instance
        else:
            node.release()
        self.set_state(node, state)
        if self.breakpoints:
            self.breakpoints.after_end(node)
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
            node.instance._setProgress(text, EXECUTE_RAISED)
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
    node.blackboard_keys = scope(node.parent.blackboard_keys, node.remaps) if node.parent is not None else node.remaps


def preview_start(executor: Executor, root: SkillInterface, node: SkillWrapper) -> Explanation | None:
    """Selects an implementation of a node and finds its parameters without starting it.

    :param executor: of no task.
    :param root: of the tree, which is never ticked.
    :returns: why the node would not start; None if it would.
    """
    executor.parameters.blackboard = Blackboard(root._params)
    executor.parameters.update_revision()
    _set_scope(root)
    failure = executor.select(node, preview)
    if failure is None:
        return None
    executor.failures.record(node, failure)
    return executor.failures.explanations()[-1]


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
    else:
        executor.on_preempting(node)
    executor.parameters.end(node)
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
        node.instance._setProgress(text, PREEMPT_RAISED)
        executor.failures.record(node, Failure(PREEMPT, PREEMPT_RAISED, text))
        node.abandoned = True
        executor.end(node, _FAILURE, preempted=True)


SkillInterface.executor_class = Executor
