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
from skiros2_common.core.explanation import EXCEPTION, POST, START
from skiros2_common.core.mutations import mutations
from skiros2_skill.core import blackboard
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
from skiros2_skill.core.wrapper import SkillWrapper

log = logging.getLogger(__name__)

#: What is noted while a node's devices are freed.
FREEING = "the release of its devices"

_RUNNING: State = State.Running
_SUCCESS: State = State.Success
_FAILURE: State = State.Failure
_Wake = Callable[[], None]
_Children = SkillInterface.execute  # what a compound without an `execute` of its own has


class Executor:
    """Ticks the nodes of one task.

    :param wmi: the world model as this task sees it.
    :param wake: asks for a tick at once; from any thread.
    :param breakpoints: where the task pauses by itself.
    """

    def __init__(self, wmi: Any, wake: _Wake = lambda: None, breakpoints: Breakpoints | None = None) -> None:
        self._wmi = wmi
        self._wake = wake
        self._pauses = Pauses(breakpoints)
        #: Nodes that were preempted and need more time.
        self.ending: list[SkillWrapper] = []
        self.failures = Failures(wmi)
        self.hooks = Hooks(self.failures)
        self.inside = self.hooks.inside
        self.readings = Readings(wmi, self.inside)
        #: Whether a state or a progress has changed since it was last set to False.
        self.changed = True

    def tick(self, root: SkillInterface) -> State:
        """One tick of a tree. Nodes that were preempted and need more time are ticked too."""
        self.readings.look()
        for node in list(self.ending):
            self._tick_ending(node)
        state: State = root._state
        if state is not _SUCCESS and state is not _FAILURE:
            state = self.execute(root)
        if self.ending:
            return _RUNNING
        if self._pauses and state is _RUNNING:
            self._pauses.at_end_of_tick()
        return state

    @property
    def has_seen_world(self) -> bool:
        """Whether nothing has changed in the world model since it was looked at last. Any thread."""
        return self.readings.are_up_to_date

    # -- one node ----------------------------------------------------------------------------------------------

    def execute(self, node: Any) -> State:
        """One tick of a node that groups others; nodes call it from `visit`."""
        if node._state is not _RUNNING:
            node._start_progress()
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
        mark = mutations.mark
        if node.is_compound:
            state = self._tick_children(node)
        else:
            state = self.hooks.execute(node)
            node.steady_stamp = -1 if node.volatile else node.seen_stamp
        if state is not _RUNNING or mutations.mark != mark:
            return self.go_on(node, state)
        self._copy_progress(node)
        self.readings.look()
        return _RUNNING

    def go_on(self, node: SkillWrapper, state: State) -> State:
        """After the tick of a skill, or its children, that ended or in which something changed."""
        self._copy_progress(node)
        if self._give_changes(node):
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
        if self._pauses:
            self._pauses.before(node)
        node._start_progress()
        try:
            candidates = node.candidates()
            stamp, present = self.readings.stamp, self.readings.present(node)
        except SkirosError as error:
            return self._refuse(node, Failure(START, START_RAISED, str(error)))
        failure = self.inside.call(node, "the choice of its parameters", choose, node, candidates, self._wmi, present)
        return self._begin(node, stamp) if failure is None else self._refuse(node, failure)

    def _begin(self, node: SkillWrapper, stamp: int) -> bool:
        """Makes the subtree and calls `onStart`.

        :param stamp: when its parameters were read.
        """
        instance = node.getInstance()
        instance._start_progress()
        instance._waker = self._wake
        node._input = {key: p._values for key, p in node._params._params.items()}
        self.set_state(node, _RUNNING)
        instance._setState(_RUNNING)
        node.is_compound = isinstance(instance, SkillBase)
        node.runs_after_children = node.is_compound and type(instance).execute is not _Children
        node.given_mark = mark = mutations.mark
        refused = self.hooks.on_start(node, self._start_instance)
        self._copy_progress(node)
        if refused is RAISED:
            self.end(node, _FAILURE)
            return False
        if refused:
            self._close(node, _FAILURE)
            return False
        is_as_read = mutations.mark == mark
        self._give_changes(node)
        self.readings.begin(node, stamp if is_as_read else -1)
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
        if not node.runs_after_children:
            return state
        if node.seen_stamp != self.readings.stamp:
            failure = self.readings.renew(node)
            if failure is not None:
                self._failed(node, failure)
        return self.hooks.execute(node, state)

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
        state = self.hooks.on_end(node, state, preempted)
        self._copy_progress(node)
        return self._close(node, state)

    def _close(self, node: SkillWrapper, state: State) -> State:
        """The node has ended: its parameters go up, its implementation is free for others."""
        if not self._give_changes(node):
            state = _FAILURE
        self.free(node)
        if state is _SUCCESS and blackboard.give_fixed(node, node.slots):
            self.readings.note_parameter()
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

    def _give_changes(self, node: SkillWrapper) -> bool:
        """Writes what the skill changed: its elements to the world model, its parameters to the nodes above.

        False when the world model refused; the progress tells why.
        """
        if node.given_mark == mutations.mark:
            return True  # nothing has changed since
        node.given_mark = mutations.mark
        written = True
        try:
            self.inside.call(
                node, "the writing of its elements", blackboard.write_elements, node.element_slots, self._wmi
            )
        except SkirosError as error:
            blackboard.drop_changes(node.element_slots, self._wmi)
            text = f"{node.label}: the world model refused what the skill changed: {error}"
            node.getInstance()._setProgress(text, EXECUTE_RAISED)
            self._copy_progress(node)
            self._note(node, Failure(EXCEPTION, EXECUTE_RAISED, text))
            log.error("%s", text)
            written = False
        node.watch = None
        if blackboard.give_changed(node, node.slots):
            self.readings.note_parameter()
        self.readings.look()
        return written

    def set_state(self, node: SkillInterface, state: State) -> None:
        node._setState(state)
        self.changed = True

    def _copy_progress(self, node: SkillWrapper) -> None:
        if node.copy_progress():
            self.changed = True
