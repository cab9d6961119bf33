"""The tick: how a node starts, runs and ends.

An executor belongs to one task and is used by one thread at a time. What a node reads (parameters above, elements,
hold-conditions) is read again only when a parameter of the task or the world model has changed since; `_stamp`
counts these changes.
"""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable
from typing import Any

from skiros2_common.core.abstract_skill import DEVICE_IDLE, DEVICE_STATE, ParamOptions, State, as_state
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.mutations import mutations
from skiros2_common.core.params import ParamHandler
from skiros2_skill.core import blackboard
from skiros2_skill.core.blackboard import Source
from skiros2_skill.core.compound import SkillBase
from skiros2_skill.core.inference import infer, inferable
from skiros2_skill.core.node import SkillInterface
from skiros2_skill.core.preemption import SkillPreempted
from skiros2_skill.core.wrapper import SkillWrapper

log = logging.getLogger(__name__)

#: What a locked device's state is while a skill has it.
DEVICE_BUSY = "Busy"

PRE_FAILED, HOLD_FAILED, POST_FAILED = -1, -2, -3
START_RAISED, EXECUTE_RAISED, PREEMPT_RAISED = -404, -405, -406

_RUNNING: State = State.Running
_SUCCESS: State = State.Success
_FAILURE: State = State.Failure
_Children = SkillInterface.execute  # what a compound without an `execute` of its own has


class Executor:
    """Ticks the nodes of one task.

    :param wmi: the world model as this task sees it.
    """

    def __init__(self, wmi: Any) -> None:
        self._wmi = wmi
        self._stamp = 0
        self._version = -1
        self._ending: list[SkillWrapper] = []
        #: Whether a state or a progress has changed since it was last set to False.
        self.changed = True

    def tick(self, root: SkillInterface) -> State:
        """One tick of a tree. Nodes that were preempted and need more time are ticked too."""
        self._look_at_world()
        for node in list(self._ending):
            self._tick_ending(node)
        state: State = root._state
        if state is not _SUCCESS and state is not _FAILURE:
            state = self.execute(root)
        return _RUNNING if self._ending else state

    # -- one node ----------------------------------------------------------------------------------------------

    def execute(self, node: Any) -> State:
        """One tick of a node; nodes call it from `visit`."""
        if isinstance(node, SkillWrapper):
            return self._execute_skill(node)
        if node._state is not _RUNNING:
            node._start_progress()
            node._processor.reset()
            self._set_state(node, _RUNNING)
        state: State = node._processor.processChildren(node._children, self)
        if state is not _RUNNING:
            self._set_state(node, state)
        return state

    def preempt(self, node: Any) -> State:
        """Ends a running node, leaves first; nodes call it from `visitPreempt`. Running: it needs more time."""
        if not node.hasState(_RUNNING):
            state: State = node._state
            return state
        for child in node._children:
            if child.hasState(_RUNNING):
                child.visitPreempt(self)
        if not isinstance(node, SkillWrapper):
            self._set_state(node, _FAILURE)
            return _FAILURE
        if node in self._ending:
            return _RUNNING
        state = self._guarded(node, lambda: as_state(node.getInstance().onPreempt(), _FAILURE), PREEMPT_RAISED)
        self._copy_progress(node)
        if state is _RUNNING:
            self._ending.append(node)
            return _RUNNING
        return self._end(node, _FAILURE if state is State.Idle else state, preempted=True)

    # -- start -------------------------------------------------------------------------------------------------

    def _execute_skill(self, node: SkillWrapper) -> State:
        if node._state is not _RUNNING:
            if not self._start(node):
                return _FAILURE
        elif self._ending and node in self._ending:
            return _RUNNING
        if (node.seen_stamp != self._stamp or node.volatile) and not self._renew(node):
            return self._fail_running(node)
        return self._run(node)

    def _start(self, node: SkillWrapper) -> bool:
        """Chooses an implementation and starts it. False when that failed; the node's progress tells why."""
        node._start_progress()
        if node._instanciator is None:
            return self._refuse(node, f"{node.printState()} has no skill library to be taken from", START_RAISED)
        try:
            candidates = node._instanciator.candidates(node._type, node.asked_label)
        except SkirosError as error:
            return self._refuse(node, str(error), START_RAISED)
        reasons = []
        for implementation in candidates:
            reason = self._try(node, implementation)
            if reason is None:
                return self._begin(node)
            reasons.append(reason if len(candidates) == 1 else f"{implementation.label}: {reason}")
        return self._refuse(node, "; ".join(reasons), PRE_FAILED)

    def _try(self, node: SkillWrapper, implementation: Any) -> str | None:
        """Makes an implementation the node's, if parameters and pre-conditions allow. Returns why not."""
        params = ParamHandler(implementation.declared.params.getCopy())
        try:
            slots = blackboard.fix(node, params)
            blackboard.take(node, slots)
        except SkirosError as error:
            return str(error)
        given = {slot.param.key: slot.param.value for slot in slots if slot.source is Source.Fixed}
        blackboard.renew(slots, self._wmi)
        for key, value in given.items():
            if value is not None and not params.getParamValues(key):
                return f"parameter {key!r} is {value!r}, which is not in the scene"
        conditions = [*implementation.declared.pre_conditions, *node._own_pre_conditions]
        unset = {p.key for p in inferable(params)}
        try:
            if unset:
                nothing = infer(params, conditions, self._wmi, self._on_blackboard(node))
                if nothing is not None:
                    return f"Pre-condition failed: {nothing}"
            misfit = self._misfit(params, implementation.declared.params)
            if misfit:
                return misfit
            failed = [c for c in conditions if not c.evaluate(params, self._wmi)]
        except SkirosError as error:
            return f"Pre-condition failed: {error}"
        if failed:
            return "Pre-condition failed: " + "; ".join(c.getDescription() for c in failed)
        for slot in slots:
            if slot.param.key in unset and slot.param.isSpecified():
                slot.source = Source.Inferred
            slot.known = slot.param.values
        try:
            self._adopt(node, implementation, params)
        except SkirosError as error:
            return str(error)
        node.slots = slots
        node.element_slots = [slot for slot in slots if slot.param.is_element]
        return None

    def _adopt(self, node: SkillWrapper, implementation: Any, params: ParamHandler) -> None:
        """Gives the node an instance of the implementation, with these parameters."""
        instance = node.getInstance()
        if instance is None or node.implementation is not implementation:
            self.release(node)
            node.implementation = implementation
            instance = implementation.acquire()
            instance._params = params
            node.setInstance(instance)
            node.expanded = False
        else:
            instance._params = params
            node.adopt_description()

    def _begin(self, node: SkillWrapper) -> bool:
        """Locks devices, makes the subtree and calls `onStart`."""
        instance = node.getInstance()
        instance._start_progress()
        node._input = {key: list(p.values) for key, p in node._params.items()}
        self._set_state(node, _RUNNING)
        instance._setState(_RUNNING)
        node.volatile = any(self._is_volatile(c) for c in node._hold_conditions)
        node.runs_after_children = isinstance(instance, SkillBase) and type(instance).execute is not _Children
        node.seen_stamp = -1
        started: Any = self._guarded(node, lambda: self._start_instance(node), START_RAISED)
        self._copy_progress(node)
        if started is _FAILURE:  # raised
            self._end(node, _FAILURE)
            return False
        if started is False:
            if not node._progress_msg:
                node._setProgress(f"{node.label}: onStart returned False", PRE_FAILED)
            self._close(node, _FAILURE)
            return False
        self._give_changes(node)
        self._look_at_world()
        return True

    def _start_instance(self, node: SkillWrapper) -> bool:
        instance = node.getInstance()
        for key, options in node.options.items():
            if ParamOptions.Lock in options:
                self._lock(node, key)
        if isinstance(instance, SkillBase) and (not node.expanded or instance.expand_on_start):
            node.wrapper_expand()
            node.expanded = True
        node._processor.reset()
        answer = instance.onStart()
        node.adopt_description()  # onStart may declare parameters
        return answer is not False

    def _refuse(self, node: SkillWrapper, message: str, code: int) -> bool:
        node._setProgress(message, code)
        self._set_state(node, _FAILURE)
        return False

    def _misfit(self, params: ParamHandler, declared: ParamHandler) -> str | None:
        """Which element is of a class that its parameter does not allow."""
        for key, param in params.items():
            wanted = declared._params[key].element_type if param.is_element else ""
            for value in param.values if wanted else ():
                if value.isAbstract() or value.type == wanted or self._wmi.is_subclass(value.type, wanted):
                    continue
                return f"parameter {key!r} is {value!r}, expected a {wanted}"
        return None

    def _on_blackboard(self, node: SkillWrapper) -> set[str]:
        """The ids of the elements that the nodes above have as parameters."""
        ids: set[str] = set()
        above = node._parent
        while above is not None:
            for param in above._params.values():
                if param.is_element:
                    ids.update(v.id for v in param.values)
            above = above._parent
        return ids

    # -- run ---------------------------------------------------------------------------------------------------

    def _renew(self, node: SkillWrapper) -> bool:
        """Before a running node is ticked: its parameters and hold-conditions. False when one does not hold."""
        if node.seen_stamp == self._stamp:
            return not node.volatile or self._holds(node)
        try:
            blackboard.take(node, node.slots)
            blackboard.renew(node.slots, self._wmi)
        except SkirosError as error:
            node._setProgress(str(error), HOLD_FAILED)
            return False
        if node._hold_conditions and not self._holds(node):
            return False
        node.seen_stamp = self._stamp
        return True

    def _holds(self, node: SkillWrapper) -> bool:
        try:
            failed = [c for c in node._hold_conditions if not c.evaluate(node._params, self._wmi)]
        except SkirosError as error:
            node._setProgress(f"Hold-condition failed: {error}", HOLD_FAILED)
            return False
        if failed:
            descriptions = "; ".join(c.getDescription() for c in failed)
            node._setProgress(f"Hold-condition failed: {descriptions}", HOLD_FAILED)
        return not failed

    def _fail_running(self, node: SkillWrapper) -> State:
        """Preempts a running node; it fails with the progress that it has now."""
        message, code = node._progress_msg, node._progress_code
        self.preempt(node)
        if node in self._ending:  # it needs more time, but has failed already
            node.verdict = (message, code)
            return _FAILURE
        node._setProgress(message, code)
        self._set_state(node, _FAILURE)
        return _FAILURE

    def _run(self, node: SkillWrapper) -> State:
        mark = mutations.mark
        state = self._tick_children(node) if isinstance(node._instance, SkillBase) else self._call_execute(node)
        self._copy_progress(node)
        if state is _RUNNING and mutations.mark == mark:
            self._look_at_world()
            return _RUNNING  # nothing to write or to pass on
        if self._give_changes(node):
            return _RUNNING if state is _RUNNING else self._end(node, state)
        return self._end(node, _FAILURE) if state is not _RUNNING else self._fail_running(node)

    def _tick_children(self, node: SkillWrapper) -> State:
        state: State = node._processor.processChildren(node._children, self)
        if not node.runs_after_children:
            return state
        if node.seen_stamp != self._stamp:
            self._renew(node)
        return self._call_execute(node, state)

    def _call_execute(self, node: SkillWrapper, of_children: State | None = None) -> State:
        """What `execute` answers; None keeps the state of the children, where there are some."""
        try:
            answer = node._instance.execute()
        except Exception as error:
            return self._raised(node, error, EXECUTE_RAISED)
        if isinstance(answer, State):
            return answer
        if answer is None and of_children is not None:
            return of_children
        if isinstance(answer, bool):
            return as_state(answer, _FAILURE)
        text = f"{node.label}: execute returned {answer!r}, expected step(...), success(...) or fail(...)"
        node._instance._setProgress(text, EXECUTE_RAISED)
        return _FAILURE

    def _tick_ending(self, node: SkillWrapper) -> None:
        """One more tick of a node that was preempted and needs time."""
        state = self._call_execute(node, _FAILURE)
        self._copy_progress(node)
        if state is not _RUNNING:
            self._ending.remove(node)
            self._end(node, state, preempted=True)
            if node.verdict is not None:
                node._setProgress(*node.verdict)
                self._set_state(node, _FAILURE)
                node.verdict = None

    # -- end ---------------------------------------------------------------------------------------------------

    def _end(self, node: SkillWrapper, state: State, preempted: bool = False) -> State:
        """After the last `execute` or the preemption: locks, post-conditions, `onEnd`, parameters."""
        instance = node.getInstance()
        for child in node._children:
            if child._state is _RUNNING:
                child.visitPreempt(self)
        self._unlock(node)
        if state is _SUCCESS and node._post_conditions and not preempted:
            state = self._check_post(node)
        answer: Any = self._guarded(node, instance.onEnd, EXECUTE_RAISED)
        self._copy_progress(node)
        if answer is False or answer is _FAILURE:
            if answer is False and state is _SUCCESS:
                node._setProgress(node._progress_msg or f"{node.label}: onEnd returned False", POST_FAILED)
            state = _FAILURE
        return self._close(node, state)

    def _check_post(self, node: SkillWrapper) -> State:
        instance = node.getInstance()
        try:
            failed = [c for c in node._post_conditions if not c.evaluate(node._params, self._wmi)]
        except SkirosError as error:
            instance._setProgress(f"Post-condition failed: {error}", POST_FAILED)
            return _FAILURE
        if failed:
            descriptions = "; ".join(c.getDescription() for c in failed)
            instance._setProgress(f"Post-condition failed: {descriptions}", POST_FAILED)
            return _FAILURE
        return _SUCCESS

    def _close(self, node: SkillWrapper, state: State) -> State:
        """The node has ended: its parameters go up, its implementation is free for others."""
        if not self._give_changes(node):
            state = _FAILURE
        self._unlock(node)
        if state is _SUCCESS and blackboard.give_fixed(node, node.slots):
            self._stamp += 1
        node.getInstance()._setState(state)
        if not isinstance(node.getInstance(), SkillBase):
            self.release(node)
        self._set_state(node, state)
        self._look_at_world()
        return state

    def release(self, node: SkillWrapper) -> None:
        """Gives the node's implementation back for others to use."""
        if node.hasInstance():
            node.implementation.release(node.release_instance())

    # -- devices -----------------------------------------------------------------------------------------------

    def _lock(self, node: SkillWrapper, key: str) -> None:
        param = node._params._params.get(key)
        for device in param.values if param is not None else ():
            if not device.isAbstract():
                device.setProperty(DEVICE_STATE, DEVICE_BUSY)
                self._wmi.update_element(device)
                node.locked.append(device.id)

    def _unlock(self, node: SkillWrapper) -> None:
        while node.locked:
            device = self._wmi.find_element(node.locked.pop())
            if device is not None:
                device.setProperty(DEVICE_STATE, DEVICE_IDLE)
                self._wmi.update_element(device)

    # -- helpers -----------------------------------------------------------------------------------------------

    def _is_volatile(self, condition: Any) -> bool:
        relation = getattr(condition, "relation", None)
        return condition.volatile or (relation is not None and self._wmi.get_reasoner(relation) is not None)

    def _look_at_world(self) -> None:
        version = self._wmi.version if self._wmi is not None else 0
        if version != self._version or version == -1:
            self._version = version
            self._stamp += 1

    def _give_changes(self, node: SkillWrapper) -> bool:
        """Writes what the skill changed: its elements to the world model, its parameters to the nodes above.

        False when the world model refused; the progress tells why.
        """
        written = True
        try:
            blackboard.write_elements(node.element_slots, self._wmi)
        except SkirosError as error:
            blackboard.drop_changes(node.element_slots, self._wmi)
            node._setProgress(f"{node.label}: the world model refused what the skill changed: {error}", EXECUTE_RAISED)
            log.error("%s", node._progress_msg)
            written = False
        if blackboard.give_changed(node, node.slots):
            self._stamp += 1
        self._look_at_world()
        return written

    def _guarded(self, node: SkillWrapper, hook: Callable[[], Any], code: int) -> Any:
        """What a hook answers; Failure, with the traceback as progress, when it raises."""
        try:
            return hook()
        except Exception as error:
            return self._raised(node, error, code)

    def _raised(self, node: SkillWrapper, error: Exception, code: int) -> State:
        message = str(error) if isinstance(error, SkillPreempted) else traceback.format_exc()
        node.getInstance()._setProgress(message, code)
        log.error("%s: %s", node.printState(), message)
        return _FAILURE

    def _set_state(self, node: SkillInterface, state: State) -> None:
        node._setState(state)
        self.changed = True

    def _copy_progress(self, node: SkillWrapper) -> None:
        """The node shows the progress of its implementation."""
        instance = node._instance
        if instance._progressed_at != node._progressed_at:
            node._progress_code = instance._progress_code
            node._progress_msg = instance._progress_msg
            node._progress_period = instance._progress_period
            node._progressed_at = instance._progressed_at
            self.changed = True
