"""The tick: how a node starts, runs and ends.

An executor belongs to one task and is used by one thread at a time. What a node reads is read again only when it has
changed since; see `Readings`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError
from skiros2_common.core.explanation import EXCEPTION, PARAMETER, POST, START
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.revision import local_revision
from skiros2_skill.core.blackboard import Blackboard, add_slots, has_changed_in_place, scope
from skiros2_skill.core.breakpoints import Break, Breakpoints
from skiros2_skill.core.choice import choose
from skiros2_skill.core.compound import SkillBase
from skiros2_skill.core.devices import free_devices
from skiros2_skill.core.failures import (
    EXECUTE_RAISED,
    START_RAISED,
    Failure,
    Failures,
    unmet,
)
from skiros2_skill.core.hooks import RAISED, Hooks, refusal
from skiros2_skill.core.inside import LeftBehind
from skiros2_skill.core.node import SkillInterface
from skiros2_skill.core.pauses import Pauses
from skiros2_skill.core.readings import Readings
from skiros2_skill.core.sharing import Sharing
from skiros2_skill.core.wrapper import SkillWrapper

log = logging.getLogger(__name__)

#: What is noted while a node's devices are freed.
FREEING = "the release of its devices"

_RUNNING: State = State.Running
_SUCCESS: State = State.Success
_FAILURE: State = State.Failure
_Wake = Callable[[], None]
_Children = SkillInterface.execute  # what a compound without an `execute` of its own has


class Halt(Exception):
    """The task was preempted in this tick: no more skills are started."""


class Executor:
    """Ticks the nodes of one task.

    :param wmi: the world model as this task sees it.
    :param wake: asks for a tick at once; from any thread.
    :param breakpoints: where the task pauses by itself.
    """

    def __init__(self, wmi: Any, wake: _Wake = lambda: None, breakpoints: Breakpoints | None = None) -> None:
        self._wmi, self._wake = wmi, wake
        self._pauses = Pauses(breakpoints)
        #: Nodes that were preempted and need more time.
        self.ending: list[SkillWrapper] = []
        self.failures = Failures(wmi)
        self.hooks = Hooks(self.failures)
        self.inside = self.hooks.inside
        self.readings = Readings(wmi, self.inside)
        #: Whether the task was preempted, and this is not carried out yet.
        self.halts = False
        self._sharing = Sharing(wmi, self.readings)
        #: Whether a state or a progress has changed since it was last set to False.
        self.changed = True

    def tick(self, root: SkillInterface) -> State:
        """One tick of a tree. Nodes that were preempted and need more time are ticked too."""
        if self.readings.board is None:
            self.readings.board = Blackboard(ParamHandler() if isinstance(root, SkillWrapper) else root._params)
        self.readings.look()
        for node in list(self.ending):
            self._tick_ending(node)
        state: State = root._state
        if state is not _SUCCESS and state is not _FAILURE:
            state = self.execute(root)
        if self._pauses and state is _RUNNING and not self.ending:
            self._pauses.at_end_of_tick()
        return _RUNNING if self.ending else state

    @property
    def has_seen_world(self) -> bool:
        """Whether nothing has changed in the world model since it was looked at last. Any thread."""
        return self.readings.are_up_to_date

    # -- one node ----------------------------------------------------------------------------------------------

    def execute(self, node: Any) -> State:
        """One tick of a node that groups others; nodes call it from `visit`."""
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
        """One tick of a skill; nodes call it from `visit`."""
        if node._state is not _RUNNING:
            if not self._start(node):
                return _FAILURE
        elif self.ending and node in self.ending:
            return _RUNNING
        if node.seen_stamp != self.readings.stamp or node.volatile:
            failure = self.readings.renew(node)
            if failure is not None:
                return self.fail_running(node, failure)
        mark, version = local_revision.current, self.readings.version
        if node.is_compound:
            state = self._tick_children(node)
        else:
            state = self.hooks.execute(node)
            node.steady_stamp = -1 if node.volatile or node.lent else node.seen_stamp
        if state is not _RUNNING or local_revision.current != mark or (node.lent and has_changed_in_place(node.lent)):
            return self.go_on(node, state, version)
        self._copy_progress(node)
        self.readings.look()
        return _RUNNING

    def go_on(self, node: SkillWrapper, state: State, version: int) -> State:
        """After the tick of a skill, or its children, that ended or in which something changed.

        :param version: of the world model before the tick.
        """
        self._copy_progress(node)
        if self._settle(node, state, version):
            return _RUNNING if state is _RUNNING else self.end(node, state)
        return self.end(node, _FAILURE) if state is not _RUNNING else self.fail_running(node)

    def preempt(self, node: Any) -> State:
        """Ends a running node, leaves first; nodes call it from `visitPreempt`. Running: it needs more time."""
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
        self.readings.pull_if_possible(node)
        state = self.hooks.on_preempt(node)
        self._copy_progress(node)
        if state is _RUNNING:
            self.ending.append(node)
            node.steady_stamp = -1
            return _RUNNING
        return self.end(node, state, preempted=True)

    # -- start -------------------------------------------------------------------------------------------------

    def _start(self, node: SkillWrapper) -> bool:
        """Chooses an implementation and starts it. False when that failed; the node's progress tells why."""
        if self.halts:
            raise Halt
        if self._pauses:
            self._pauses.before(node)
        node._start_progress()
        node.has_started = False
        _set_scope(node)
        try:
            candidates = node.candidates()
            stamp, present = self.readings.stamp, self.readings.present(node)
        except SkirosError as error:
            return self._refuse(node, Failure(START, START_RAISED, str(error)))
        what = (choose, node, candidates, self._wmi, present, self.readings.board)
        failure = self.inside.call(node, "the choice of its parameters", *what)
        return self._begin(node, stamp) if failure is None else self._refuse(node, failure)

    def _begin(self, node: SkillWrapper, stamp: int) -> bool:
        """Makes the subtree and calls `onStart`.

        :param stamp: when its parameters were read.
        """
        instance = node.getInstance()
        instance._start_progress()
        instance._waker = self._wake
        node._input = {key: list(p._values) for key, p in node._params._params.items()}
        self.set_state(node, _RUNNING)
        instance._setState(_RUNNING)
        node.is_compound = isinstance(instance, SkillBase)
        node.runs_after_children = node.is_compound and type(instance).execute is not _Children
        mark = local_revision.current
        refused = self.hooks.on_start(node, self._start_instance)
        self._copy_progress(node)
        if refused:
            (self.end if refused is RAISED else self._close)(node, _FAILURE)
            return False
        node.has_started = True
        is_as_read = local_revision.current == mark and self.readings.stamp == stamp
        if local_revision.current != mark:
            add_slots(node, node.slots)
        self._sharing.share(node, everything=True, removes=False)
        self.readings.begin(node, self.readings.stamp if is_as_read else -1)
        self.readings.look()
        return True

    def _start_instance(self, node: SkillWrapper) -> str:
        """The answer of `onStart` when it is a no."""
        instance = node.getInstance()
        if isinstance(instance, SkillBase) and (not node.expanded or instance.expand_on_start):
            node.wrapper_expand()
            node.expanded = True
        node._processor.reset()
        answer = refusal(instance.onStart())
        node.adopt_description()  # onStart may declare parameters
        return answer

    def _refuse(self, node: SkillWrapper, failure: Failure) -> bool:
        self.set_state(node, _FAILURE)
        return self._failed(node, failure)

    # -- run ---------------------------------------------------------------------------------------------------

    def _failed(self, node: SkillWrapper, failure: Failure) -> bool:
        """Tells and notes a failure of a node. Returns False."""
        node._setProgress(failure.message, failure.code)
        self._note(node, failure)
        return False

    def _note(self, node: SkillWrapper, failure: Failure) -> None:
        self.inside.call(node, "the explanation of its failure", self.failures.note, node, failure)
        if self._pauses:
            self._pauses.at_failure(failure.conditions)

    def fail_running(self, node: SkillWrapper, failure: Failure | None = None) -> State:
        """Preempts a running node; it fails with the progress that it has now, or for that reason."""
        if failure is not None:
            self._failed(node, failure)
        message, code = node._progress_msg, node._progress_code
        self.preempt(node)
        if node in self.ending:  # it needs more time, but has failed already
            node.verdict = (message, code)
            return _FAILURE
        node._setProgress(message, code)
        self.set_state(node, _FAILURE)
        return _FAILURE

    def _tick_children(self, node: SkillWrapper) -> State:
        try:
            state: State = node._processor.processChildren(node._children, self)
        except (LeftBehind, Break):
            raise
        except FOREIGN_ERRORS as error:  # of a processor, or a node, with code of its own
            return self.hooks.raised(node, error, EXECUTE_RAISED)
        if state is _RUNNING:
            return state
        try:
            self.readings.pull(node)
        except SkirosError as error:
            self._failed(node, Failure(PARAMETER, EXECUTE_RAISED, str(error)))
            return _FAILURE
        return self.hooks.execute(node, state) if node.runs_after_children else state

    def _tick_ending(self, node: SkillWrapper) -> None:
        """One more tick of a node that was preempted and needs time."""
        state = self.hooks.execute(node, _FAILURE, late=True)
        self._copy_progress(node)
        if state is not _RUNNING:
            self.ending.remove(node)
            self.end(node, state, preempted=True)
            if node.verdict is not None:
                node._setProgress(*node.verdict)
                self.set_state(node, _FAILURE)
                node.verdict = None

    # -- end ---------------------------------------------------------------------------------------------------

    def end(self, node: SkillWrapper, state: State, preempted: bool = False) -> State:
        """After the last `execute` or the preemption: locks, post-conditions, `onEnd`, parameters."""
        instance = node.getInstance()
        for child in node._children:
            if child._state is _RUNNING:
                child.visitPreempt(self)
        self.free(node)
        if state is _SUCCESS and node._post_conditions and not preempted:
            failure = self.inside.call(
                node, "its conditions", unmet, POST, node._post_conditions, node._params, self._wmi
            )
            if failure is not None:
                instance._setProgress(failure.message, failure.code)
                self._note(node, failure)
                state = _FAILURE
        if state is _FAILURE and not preempted and node._children and instance._progress_code >= 0:
            cause = self.failures.cause_under(node)
            if cause is not None:  # the compound itself says nothing
                instance._setProgress(*cause)
        elif state is _SUCCESS and node.is_compound and not instance._progress_code:
            instance._setProgress("End", 1)
        state = self.hooks.on_end(node, state, preempted)
        self._copy_progress(node)
        if state is _SUCCESS and not node.is_compound:
            self._sharing.tell_unwritten(node)
        return self._close(node, state)

    def _close(self, node: SkillWrapper, state: State) -> State:
        """The node has ended: its parameters go up, its implementation is free for others."""
        if node.has_started:
            self._sharing.share(node, everything=True)
        self.free(node)
        node.getInstance()._setState(state)
        if isinstance(node.getInstance(), SkillBase):
            node.rest()  # it has made the subtree
        else:
            node.release()
        self.set_state(node, state)
        if self._pauses:
            self._pauses.after(node)
        self.readings.look()
        return state

    def free(self, node: SkillWrapper) -> None:
        """Frees the devices that the node has locked."""
        if node.locked:
            self.inside.call(node, FREEING, free_devices, node, self._wmi)

    # -- helpers -----------------------------------------------------------------------------------------------

    def _settle(self, node: SkillWrapper, state: State, version: int) -> bool:
        """As `Sharing.settle`. False when the world model refused, or does not answer; the progress tells why."""
        try:
            self.inside.call(node, "the writing of its elements", self._sharing.settle, node, state, version)
        except SkirosError as error:
            text = f"{node.label}: {error}"
            node.getInstance()._setProgress(text, EXECUTE_RAISED)
            self._copy_progress(node)
            self._note(node, Failure(EXCEPTION, EXECUTE_RAISED, text))
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
