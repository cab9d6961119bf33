"""The base class of runnable skills: state, progress and hooks."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from enum import Enum
from typing import Any

from skiros2_common.core.errors import Refused
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.property import is_bool
from skiros2_common.core.skill_description import ParamOptions, SkillDescription

log = logging.getLogger(__name__)

__all__ = ["FailureKind", "ParamOptions", "SkillCore", "SkillDescription", "State", "as_state"]

State = Enum("State", "Success Failure Running Idle Uninitialized")

_RUNNING: State = State.Running


class SkillCore(SkillDescription):
    """A runnable skill with state, progress and hooks to override.

    The thread that ticks the task calls all hooks, one at a time. `getState`, `hasState`, `waitState` and the progress
    properties are thread-safe.
    """

    _declares_itself = False

    #: Whether a failure of the skill follows from another one and is not the cause: it cleans up, then fails.
    fails_late = False
    #: The most severe kind of the failures since the start.
    failure_kind = FailureKind.RETRYABLE

    #: Called by `wake`; set by the executor while the skill runs in a task.
    request_tick: Callable[[], None] = staticmethod(lambda: None)

    #: Shared by all skills, because few are waited for.
    _state_change = threading.Condition()

    _waiting = 0  # threads in `waitState`
    _id = -1
    _expand_on_start = False
    _progress_code, _progress_msg, _progress_period = 0, "", 0.0
    _started_at = progressed_at = 0.0

    def __init__(self) -> None:
        super().__init__()
        self._description: SkillDescription = SkillDescription()
        self._state = State.Uninitialized
        self._children: list[Any] = []

    @property
    def skill_description(self) -> SkillDescription:
        """The description given to `setDescription`, without the additions of this implementation."""
        return self._description

    # -- state -------------------------------------------------------------------------------------------------

    @property
    def id(self) -> int:
        """The number within the task; -1 outside of a task."""
        return self._id

    @property
    def state(self) -> State:
        return self._state

    def getState(self) -> State:
        return self._state

    def hasState(self, state: State) -> bool:
        return self._state == state

    def _setState(self, state: State) -> None:
        if state.__class__ is not State:
            log.error("%s: expected a State, got %r", self.printState(), state)
            state = as_state(state, State.Failure)
        self._state = state
        if self._waiting:  # rare; a later waiter sees the new state
            with self._state_change:
                self._state_change.notify_all()

    def waitState(self, state: State, isset: bool = True) -> None:
        """Blocks until the skill has the state (`isset`), or no longer has it. Must not be called in a hook."""
        with self._state_change:
            self._waiting += 1
            try:
                self._state_change.wait_for(lambda: (self._state == state) == isset)
            finally:
                self._waiting -= 1

    @property
    def expand_on_start(self) -> bool:
        """Whether a compound expands its subtree again at each start."""
        return self._expand_on_start

    @property
    def works_in_background(self) -> bool:
        """Whether the skill runs code outside of its hooks. If so after its end, the instance is not reused."""
        return False

    # -- progress ----------------------------------------------------------------------------------------------

    @property
    def progress_code(self) -> int:
        """0 at the start, incremented by `step`, negative after a failure."""
        return self._progress_code

    @property
    def progress_msg(self) -> str:
        return self._progress_msg

    @property
    def progress_period(self) -> float:
        """Time between the last two progress reports (s)."""
        return self._progress_period

    @property
    def progress_time(self) -> float:
        """Time from the start to the last progress report (s)."""
        return max(0.0, self.progressed_at - self._started_at)

    def _setProgress(self, msg: Any, code: int | None = None) -> None:
        """Reports progress. Without a code, increments the last one."""
        now = time.monotonic()
        self._progress_code = self._progress_code + 1 if code is None else code
        self._progress_msg = msg if isinstance(msg, str) else str(msg)
        self._progress_period = now - self.progressed_at
        self.progressed_at = now

    def begin_progress(self) -> None:
        self._started_at = self.progressed_at = time.monotonic()
        self._progress_code, self._progress_msg, self._progress_period = 0, "", 0.0
        self.failure_kind = FailureKind.RETRYABLE

    def startError(self, msg: str, code: int, kind: FailureKind = FailureKind.RETRYABLE) -> bool:
        """For `onStart`: reports why the skill cannot start, as `fail` does. Returns False."""
        SkillCore.fail(self, msg, code, kind)
        return False

    def step(self, msg: str = "") -> State:
        """For `execute`: the skill continues."""
        now = time.monotonic()  # `_setProgress` inlined for speed: most ticks call this
        self._progress_code += 1
        self._progress_msg = msg if msg.__class__ is str else str(msg)
        self._progress_period = now - self.progressed_at
        self.progressed_at = now
        return _RUNNING

    def fail(self, msg: str, code: int, kind: FailureKind = FailureKind.RETRYABLE) -> State:
        """For `execute`: the skill failed. A positive code is negated. `kind`: whether it may be tried again."""
        self.failure_kind = self.failure_kind.worst(kind)
        self._setProgress(msg, -abs(int(code)))
        return State.Failure

    def success(self, msg: str = "") -> State:
        """For `execute`: the skill succeeded."""
        self._setProgress(msg)
        return State.Success

    # -- description -------------------------------------------------------------------------------------------

    def setDescription(self, description: SkillDescription, label: str = "") -> None:  # type: ignore[override]
        """Copies a description; the label, by default the class name, names the implementation."""
        description.generateDefParams()
        description.generateDefConditions()  # for later additions to it
        SkillDescription.setDescription(self, *description.getDescription())
        self._options = {key: list(options) for key, options in description.options.items()}
        self._available_for_planning = description.available_for_planning
        self.allowed_when_stopped = description.allowed_when_stopped
        self.is_reaction = description.is_reaction
        self._duration = description.duration
        self._on_preempt = description.on_preempt
        self._source_locations = dict(description._source_locations)
        self._description = description
        self._label = label or self.__class__.__name__

    def modifyDescription(self, skill: Any) -> None:
        """To override: adds parameters or conditions to the description, or narrows a parameter's type."""

    def declare(self) -> None:
        """Declares the description; called once when the skill is loaded."""
        self.createDescription()
        if not self._label:
            self._label = self.__class__.__name__
        self.modifyDescription(self)
        self.generateDefParams()
        self.generateDefConditions()

    def save_declared(self) -> None:
        """Saves the declared conditions and options for `_restore_declared`; called when the skill is loaded."""
        self._declared = (
            list(self._pre_conditions),
            list(self._hold_conditions),
            list(self._post_conditions),
            dict(self._options),
        )

    def restore_declared(self, params: ParamHandler) -> None:
        """Sets the parameters of a new skill run and discards conditions that an earlier run added."""
        pre, hold, post, options = self._declared
        self._params = params
        self._pre_conditions, self._hold_conditions, self._post_conditions = list(pre), list(hold), list(post)
        self._options = dict(options)

    # -- conditions --------------------------------------------------------------------------------------------

    def hasPreCond(self) -> bool:
        return bool(self._pre_conditions)

    def hasPostCond(self) -> bool:
        return bool(self._post_conditions)

    def checkPreCond(self, verbose: bool = False) -> list[str]:
        """The keys of unsatisfied pre-conditions, which are reported as progress with code -1."""
        return self._check(self._pre_conditions, "Pre-condition failed", -1, verbose)

    def checkHoldCond(self, verbose: bool = False) -> list[str]:
        """The keys of unsatisfied hold-conditions, which are reported as progress with code -2."""
        return self._check(self._hold_conditions, "Hold-condition failed", -2, verbose)

    def checkPostCond(self, verbose: bool = False) -> list[str]:
        """The keys of unsatisfied post-conditions, which are reported as progress with code -2."""
        return self._check(self._post_conditions, "Post-condition failed", -2, verbose)

    def _check(self, conditions: Sequence[Any], title: str, code: int, verbose: bool) -> list[str]:
        unsatisfied = [c for c in conditions if not c.evaluate(self._params, self._wmi)]
        if unsatisfied:
            self._setProgress(f"{title}: " + "; ".join(c.getDescription() for c in unsatisfied), code)
            if verbose:
                log.info("%s: %s", self.printState(), self._progress_msg)
        return list(dict.fromkeys(key for c in unsatisfied for key in c.getKeys()))

    # -- parameters --------------------------------------------------------------------------------------------

    def specifyParam(self, key: str, values: Any) -> None:
        """Sets a parameter."""
        self._params.specify(key, values)

    def specifyParamDefault(self, key: str, values: Any) -> None:
        """Sets a parameter and its default."""
        self._params.specifyDefault(key, values)

    def specifyParams(self, input_params: ParamHandler, keep_default: bool = True) -> None:
        """Copies values from other parameters by key; with `keep_default`, defaults take precedence."""
        self._params.specifyParams(input_params, keep_default)

    def specifyParamsDefault(self, input_params: ParamHandler) -> None:
        """Copies values from other parameters by key and makes them the defaults."""
        self._params.specifyParamsDefault(input_params)

    # -- running -----------------------------------------------------------------------------------------------

    def expand(self, skill: Any) -> None:
        """To override in compounds: adds the children to `skill`."""

    def hasChildren(self) -> bool:
        return bool(self._children)

    def start(self, params: ParamHandler | None = None) -> State:
        """Starts the skill: sets the parameters and calls `onStart`. Returns the state: Failure if `onStart` fails.

        :raises Refused: the skill is running.
        """
        if self._state is State.Running:
            raise Refused(f"{self._type}-{self._label} is already running")
        if params is not None:
            self.specifyParams(params, False)
        self.begin_progress()
        self._setState(State.Failure if self.onStart() is False else State.Running)
        return self._state

    def preempt(self) -> State:
        """Ends a running skill with the state that `onPreempt` returns. Returns the state."""
        if self._state is State.Running:
            self._setState(as_state(self.onPreempt(), State.Failure))
        return self._state

    def reset(self) -> State:
        """Resets the skill to Idle. Returns the state."""
        self.onReset()
        self.begin_progress()
        self._setState(State.Idle)
        return self._state

    def onReset(self) -> None:
        """To override: called when the skill is reset."""

    def onStart(self) -> bool | None:
        """To override: called at the start, with all parameters set. Return False to fail the start."""
        return True

    def onPreempt(self) -> Any:
        """To override: called to end the skill. Returns the final state (or a bool; True is Success), or Running if
        the skill needs more time."""
        self._setProgress("Preempted", -1)
        return State.Failure

    def execute(self) -> State | None:
        """To override: one tick. Returns `step(...)`, `success(...)` or `fail(...)`."""
        return State.Success

    def onEnd(self) -> bool | None:
        """To override: called after the last `execute` or the preemption. Return False to fail the skill."""
        return True

    def wake(self) -> None:
        """Requests an immediate tick, when an awaited event occurred. Thread-safe; no effect after the task ended."""
        self.request_tick()

    # -- printing ----------------------------------------------------------------------------------------------

    def printState(self, verbose: bool = False) -> str:
        """`type-label(State.X)`; with `verbose`, also the parameters."""
        text = f"{self._type}-{self._label}({self._state})"
        return f"{text}[{self._params.printState().strip()}]" if verbose else text

    def printProgress(self) -> str:
        """`code: message`."""
        return f"{self.progress_code}: {self.progress_msg}"


def as_state(result: Any, default: State) -> State:
    """Converts the result of a hook to a state: a state, a bool (True is Success), or None (the default)."""
    if isinstance(result, State):
        return result
    if result is None:
        return default
    if is_bool(result):
        return State.Success if result else State.Failure
    raise TypeError(f"expected a State, True, False or None, got {type(result).__name__} {result!r}")
