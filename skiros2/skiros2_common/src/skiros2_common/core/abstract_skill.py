"""What runs a skill: its state, its progress and its hooks."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from enum import Enum
from typing import Any

from skiros2_common.core.errors import Refused
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.property import is_bool
from skiros2_common.core.skill_description import ParamOptions, SkillDescription

log = logging.getLogger(__name__)

__all__ = ["ParamOptions", "SkillCore", "SkillDescription", "State", "as_state"]

State = Enum("State", "Success Failure Running Idle Uninitialized")

_RUNNING: State = State.Running


class SkillCore(SkillDescription):
    """A skill that runs: its state, its progress, and the hooks that authors override.

    All hooks are called by the thread that ticks the task, one at a time. `getState`, `hasState`, `waitState`
    and the progress properties may be read by any thread.
    """

    _declares_itself = False

    #: What `wake` calls; set by the executor while the skill runs in a task.
    _waker: Callable[[], None] = staticmethod(lambda: None)

    #: Of all skills; those that are waited for are few.
    _state_change = threading.Condition()

    def __init__(self) -> None:
        super().__init__()
        self._description: SkillDescription = SkillDescription()
        self._state = State.Uninitialized
        self._waiting = 0  # threads in `waitState`
        self._id = -1
        self._children: list[Any] = []
        self._expand_on_start = False
        self._progress_code = 0
        self._progress_msg = ""
        self._progress_period = 0.0
        self._started_at = 0.0
        self._progressed_at = 0.0

    # -- state -------------------------------------------------------------------------------------------------

    @property
    def id(self) -> int:
        """The number within the task; -1 when the skill is in none."""
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
        if self._waiting:  # rarely; one that comes now finds the new state
            with self._state_change:
                self._state_change.notify_all()

    def waitState(self, state: State, isset: bool = True) -> None:
        """Blocks until the skill has that state (`isset`), or no longer has it. Not to be called in a hook."""
        with self._state_change:
            self._waiting += 1
            try:
                self._state_change.wait_for(lambda: (self._state == state) == isset)
            finally:
                self._waiting -= 1

    @property
    def expand_on_start(self) -> bool:
        """Whether a compound's subtree is made anew at each start."""
        return self._expand_on_start

    @property
    def _is_working(self) -> bool:
        """Whether code of the skill goes on outside of its hooks. If so when it has ended, it is not used again."""
        return False

    # -- progress ----------------------------------------------------------------------------------------------

    @property
    def progress_code(self) -> int:
        """0 at the start, counted up by `step`, negative after a failure."""
        return self._progress_code

    @property
    def progress_msg(self) -> str:
        return self._progress_msg

    @property
    def progress_period(self) -> float:
        """Time between the last two reports of progress (s)."""
        return self._progress_period

    @property
    def progress_time(self) -> float:
        """Time from the start to the last report of progress (s)."""
        return max(0.0, self._progressed_at - self._started_at)

    def _setProgress(self, msg: Any, code: int | None = None) -> None:
        """Reports progress. Without a code the last one counts up by one."""
        now = time.monotonic()
        self._progress_code = self._progress_code + 1 if code is None else code
        self._progress_msg = msg if isinstance(msg, str) else str(msg)
        self._progress_period = now - self._progressed_at
        self._progressed_at = now

    def _start_progress(self) -> None:
        self._started_at = self._progressed_at = time.monotonic()
        self._progress_code, self._progress_msg, self._progress_period = 0, "", 0.0

    def startError(self, msg: str, code: int) -> bool:
        """For `onStart`: reports why the skill cannot start and returns False."""
        self._setProgress(msg, -abs(int(code)))
        return False

    def step(self, msg: str = "") -> State:
        """For `execute`: the skill goes on."""
        now = time.monotonic()  # as `_setProgress`, but quicker: most ticks of most skills come here
        self._progress_code += 1
        self._progress_msg = msg if msg.__class__ is str else str(msg)
        self._progress_period = now - self._progressed_at
        self._progressed_at = now
        return _RUNNING

    def fail(self, msg: str, code: int) -> State:
        """For `execute`: the skill has failed. The code is made negative."""
        self._setProgress(msg, -abs(int(code)))
        return State.Failure

    def success(self, msg: str = "") -> State:
        """For `execute`: the skill has succeeded."""
        self._setProgress(msg)
        return State.Success

    # -- description -------------------------------------------------------------------------------------------

    def setDescription(self, description: SkillDescription, label: str = "") -> None:  # type: ignore[override]
        """Takes over what a description declares; the label, by default the class name, names the implementation."""
        description.generateDefParams()
        description.generateDefConditions()  # of what was added to it since
        SkillDescription.setDescription(self, *description.getDescription())
        self._options = {key: list(options) for key, options in description.options.items()}
        self._available_for_planning = description.available_for_planning
        self._duration = description.duration
        self._places = dict(description._places)
        self._description = description
        self._label = label or self.__class__.__name__

    def modifyDescription(self, skill: Any) -> None:
        """To override: adds parameters or conditions, or narrows a parameter's type, once the skill is described."""

    def _create(self) -> None:
        """Declares everything once, when the skill is loaded."""
        self.createDescription()
        if not self._label:
            self._label = self.__class__.__name__
        self.modifyDescription(self)
        self.generateDefParams()
        self.generateDefConditions()

    def _save_declared(self) -> None:
        """The skill is loaded: what it has declared so far is what it starts with each time."""
        self._declared = (
            list(self._pre_conditions),
            list(self._hold_conditions),
            list(self._post_conditions),
            dict(self._options),
        )

    def _restore_declared(self, params: ParamHandler) -> None:
        """The skill is to start: takes these parameters, and forgets conditions that it added as it ran before."""
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
        """The keys of the pre-conditions that do not hold; these are reported as progress, with code -1."""
        return self._check(self._pre_conditions, "Pre-condition failed", -1, verbose)

    def checkHoldCond(self, verbose: bool = False) -> list[str]:
        """The keys of the hold-conditions that do not hold; these are reported as progress, with code -2."""
        return self._check(self._hold_conditions, "Hold-condition failed", -2, verbose)

    def checkPostCond(self, verbose: bool = False) -> list[str]:
        """The keys of the post-conditions that do not hold; these are reported as progress, with code -2."""
        return self._check(self._post_conditions, "Post-condition failed", -2, verbose)

    def _check(self, some: Sequence[Any], what: str, code: int, verbose: bool) -> list[str]:
        failed = [c for c in some if not c.evaluate(self._params, self._wmi)]
        if failed:
            self._setProgress(f"{what}: " + "; ".join(c.getDescription() for c in failed), code)
            if verbose:
                log.info("%s: %s", self.printState(), self._progress_msg)
        return list(dict.fromkeys(key for c in failed for key in c.getKeys()))

    # -- parameters --------------------------------------------------------------------------------------------

    def specifyParam(self, key: str, values: Any) -> None:
        """Sets a parameter."""
        self._params.specify(key, values)

    def specifyParamDefault(self, key: str, values: Any) -> None:
        """Sets a parameter and makes the values its default."""
        self._params.specifyDefault(key, values)

    def specifyParams(self, input_params: ParamHandler, keep_default: bool = True) -> None:
        """Takes values from other parameters by key; with `keep_default`, a default stays."""
        self._params.specifyParams(input_params, keep_default)

    def specifyParamsDefault(self, input_params: ParamHandler) -> None:
        """Takes values from other parameters by key and makes them the defaults."""
        self._params.specifyParamsDefault(input_params)

    # -- running -----------------------------------------------------------------------------------------------

    def expand(self, skill: Any) -> None:
        """To override in compounds: adds the children to `skill`."""

    def hasChildren(self) -> bool:
        return bool(self._children)

    def start(self, params: ParamHandler | None = None) -> State:
        """Starts the skill: takes the parameters and calls `onStart`. Returns the state, Failure when it refuses.

        :raises Refused: the skill runs already.
        """
        if self._state is State.Running:
            raise Refused(f"{self._type}-{self._label} runs already")
        if params is not None:
            self.specifyParams(params, False)
        self._start_progress()
        self._setState(State.Failure if self.onStart() is False else State.Running)
        return self._state

    def preempt(self) -> State:
        """Ends a running skill: `onPreempt` tells the state it ends with. Returns the state."""
        if self._state is State.Running:
            self._setState(as_state(self.onPreempt(), State.Failure))
        return self._state

    def reset(self) -> State:
        """Makes the skill ready to start again. Returns the state."""
        self.onReset()
        self._start_progress()
        self._setState(State.Idle)
        return self._state

    def onReset(self) -> None:
        """To override: called when the skill is made ready to start again."""

    def onStart(self) -> bool | None:
        """To override: called at the start, with all parameters set. False fails the start."""
        return True

    def onPreempt(self) -> Any:
        """To override: the skill is to end. Returns the state it ends with, Running when it needs more time,
        or a bool (True: Success)."""
        self._setProgress("Preempted", -1)
        return State.Failure

    def execute(self) -> State | None:
        """To override: one tick. Returns `step(...)`, `success(...)` or `fail(...)`."""
        return State.Success

    def onEnd(self) -> bool | None:
        """To override: called after the last `execute` or after the preemption. False makes it a failure."""
        return True

    def wake(self) -> None:
        """Asks for a tick at once: what the skill waited for is there. Any thread; nothing when the task has ended."""
        self._waker()

    # -- printing ----------------------------------------------------------------------------------------------

    def printState(self, verbose: bool = False) -> str:
        """`type-label(State.X)`; with `verbose` the parameters too."""
        text = f"{self._type}-{self._label}({self._state})"
        return f"{text}[{self._params.printState().strip()}]" if verbose else text

    def printProgress(self) -> str:
        """`code: message`."""
        return f"{self.progress_code}: {self.progress_msg}"


def as_state(answer: Any, default: State) -> State:
    """The state that a hook's answer stands for: a state, a bool (True: Success), or None (the default)."""
    if isinstance(answer, State):
        return answer
    if answer is None:
        return default
    if is_bool(answer):
        return State.Success if answer else State.Failure
    raise TypeError(f"expected a State, True, False or None, got {type(answer).__name__} {answer!r}")
