"""What a skill is (`SkillDescription`) and what runs it (`SkillCore`)."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from enum import Enum
from typing import Any

from skiros2_common.core import conditions as cond
from skiros2_common.core.errors import Refused
from skiros2_common.core.names import full_name
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element

State = Enum("State", "Success Failure Running Idle Uninitialized")
ParamOptions = Enum("ParamOptions", "Consume Output Unspecify Lock RespectType")

#: The property that tells whether a device is free, and its value when it is.
DEVICE_STATE = "skiros:StateProperty"
DEVICE_IDLE = "Idle"


class SkillDescription:
    """The name of a skill, its parameters and its conditions. Subclasses declare them in `createDescription`."""

    def __init__(self) -> None:
        self._type = full_name(self.__class__.__name__)
        self._label = ""
        self._params = ParamHandler()
        self._options: dict[str, list[Any]] = {}
        self._pre_conditions: list[Any] = []
        self._hold_conditions: list[Any] = []
        self._post_conditions: list[Any] = []
        self._available_for_planning = True
        self._wmi: Any = None

    # -- reading -----------------------------------------------------------------------------------------------

    @property
    def params(self) -> ParamHandler:
        """The parameters."""
        return self._params

    @property
    def label(self) -> str:
        """The name of the implementation; "" for a description."""
        return self._label

    @property
    def type(self) -> str:
        """The skill's class in the ontology, such as `skiros:Pick`."""
        return self._type

    @property
    def wmi(self) -> Any:
        """The world model as the skill sees it; None before the skill is loaded."""
        return self._wmi

    @property
    def pre_conditions(self) -> list[Any]:
        return self._pre_conditions

    @property
    def hold_conditions(self) -> list[Any]:
        return self._hold_conditions

    @property
    def post_conditions(self) -> list[Any]:
        return self._post_conditions

    @property
    def options(self) -> dict[str, list[Any]]:
        """The `ParamOptions` of each parameter that has some."""
        return self._options

    @property
    def available_for_planning(self) -> bool:
        """Whether the task manager may plan with the skill."""
        return self._available_for_planning

    def setAvailableForPlanning(self, available: bool = True) -> None:
        """Says whether the task manager may plan with the skill."""
        self._available_for_planning = available

    def getDescription(self) -> SkillDescription:
        """A copy of the description alone."""
        copy = SkillDescription()
        SkillDescription.setDescription(
            copy, self._type, self._params, self._pre_conditions, self._hold_conditions, self._post_conditions
        )
        copy._options = {key: list(options) for key, options in self._options.items()}
        copy._available_for_planning = self._available_for_planning
        return copy

    def setDescription(self, typein: str, paramsin: ParamHandler, prein: Any, holdin: Any, postin: Any) -> None:
        """Takes copies of the parameters and conditions of another skill."""
        self._type = typein
        self._params = ParamHandler(paramsin.getCopy())
        self._pre_conditions = [c.copy() for c in prein]
        self._hold_conditions = [c.copy() for c in holdin]
        self._post_conditions = [c.copy() for c in postin]

    # -- declaring ---------------------------------------------------------------------------------------------

    def createDescription(self) -> None:
        """To override: declares the parameters and conditions."""

    def addParam(
        self,
        key: str,
        value: Any,
        param_type: Any,
        options: Any = [],  # noqa: B006 - the contract's default, never changed
        description: str = "",
    ) -> None:
        """Declares a parameter; one of that key is redefined.

        :param value: a default, a Python type (no default), a list of one type, or an abstract `Element`.
        :param param_type: one of `ParamTypes`.
        :param options: one of `ParamOptions` or a list of them; a text stands for the description.
        """
        if isinstance(options, str):
            options, description = [], options
        self._params.addParam(key, value, param_type, description)
        chosen = list(options) if isinstance(options, (list, tuple, set)) else [options]
        self._options.pop(key, None)
        if chosen:
            self._options[key] = chosen

    def generateDefParams(self) -> None:
        """Adds what every skill has: `Robot`, unless the skill declares its own."""
        if not self._params.hasParam("Robot"):
            self._params.addParam("Robot", Element("sumo:Agent"), ParamTypes.Inferred, "The robot that runs the skill")

    def generateDefConditions(self) -> None:
        """Adds the conditions that follow from the parameters' options, where they are not there yet."""
        for key, options in self._options.items():
            for option in options:
                self._add_option_conditions(key, option)

    def _add_option_conditions(self, key: str, option: Any) -> None:
        if option == ParamOptions.Consume:
            _add_new(self._post_conditions, self.getGenerateCond(f"{key}Consumed", key, False))
        elif option == ParamOptions.Unspecify:
            _add_new(self._post_conditions, self.getIsSpecifiedCond(f"{key}Unset", key, False))
        elif option == ParamOptions.Lock:
            idle = self.getPropCond(f"{key}Idle", DEVICE_STATE, key, "=", DEVICE_IDLE, True)
            busy = self.getPropCond(f"{key}Locked", DEVICE_STATE, key, "=", DEVICE_IDLE, False)
            freed = self.getPropCond(f"{key}Freed", DEVICE_STATE, key, "=", DEVICE_IDLE, True)
            _add_new(self._pre_conditions, idle)
            _add_new(self._hold_conditions, busy)
            _add_new(self._post_conditions, freed)
        elif option == ParamOptions.RespectType:
            wanted = self._params.getParamMap()[key].element_type
            _add_new(self._pre_conditions, self.getOnTypeCond(f"{key}OfType", key, wanted))

    def getOutputParams(self) -> dict[str, Param]:
        """The parameters with the option Output, by key."""
        return {k: p for k, p in self._params.items() if ParamOptions.Output in self._options.get(k, ())}

    def addPreCondition(self, condition: Any) -> None:
        """Adds a condition that has to hold when the skill starts."""
        self._pre_conditions.append(condition)

    def addHoldCondition(self, condition: Any) -> None:
        """Adds a condition that has to hold at each tick while the skill runs."""
        self._hold_conditions.append(condition)

    def addPostCondition(self, condition: Any) -> None:
        """Adds a condition that has to hold when the skill has succeeded."""
        self._post_conditions.append(condition)

    # -- making conditions -------------------------------------------------------------------------------------

    def getOrCond(self, desired_state: bool) -> cond.ConditionOr:
        """True when one of the parts added to it holds."""
        return cond.ConditionOr(desired_state)

    def getIsSpecifiedCond(self, clabel: str, subj: str, desired_state: bool) -> cond.ConditionIsSpecified:
        """True when the parameter holds an element of the scene."""
        return cond.ConditionIsSpecified(clabel, subj, desired_state)

    def getGenerateCond(self, clabel: str, subj: str, desired_state: bool) -> cond.ConditionGenerate:
        """Likewise; as an effect the skill makes (true) or removes (false) the element."""
        return cond.ConditionGenerate(clabel, subj, desired_state)

    def getHasPropCond(self, clabel: str, olabel: str, subj: str, desired_state: bool) -> cond.ConditionHasProperty:
        """True when the property has a value."""
        return cond.ConditionHasProperty(clabel, olabel, subj, desired_state)

    def getPropCond(
        self, clabel: str, olabel: str, subj: str, operator: str, value: Any, desired_state: bool
    ) -> cond.ConditionProperty:
        """True when the property compares so with the value (`= > < >= <=`)."""
        return cond.ConditionProperty(clabel, olabel, subj, operator, value, desired_state)

    def getAbstractRelationCond(
        self, clabel: str, olabel: str, subj: str, obj: str, desired_state: bool
    ) -> cond.AbstractConditionRelation:
        """True when the ontology allows the relation between the two."""
        return cond.AbstractConditionRelation(clabel, olabel, subj, obj, desired_state)

    def getRelationCond(
        self, clabel: str, olabel: str, subj: str, obj: str, desired_state: bool
    ) -> cond.ConditionRelation:
        """True when the relation, or one under it, holds."""
        return cond.ConditionRelation(clabel, olabel, subj, obj, desired_state)

    def getOnTypeCond(self, clabel: str, subj: str, value: str) -> cond.ConditionOnType:
        """True when the value's class is that class or under it."""
        return cond.ConditionOnType(clabel, subj, value)

    # -- other forms -------------------------------------------------------------------------------------------

    def getModifiedParams(self) -> list[str]:
        """The keys of the parameters that post-conditions speak of: what the skill changes."""
        return list(dict.fromkeys(key for c in self._post_conditions for key in c.getKeys()))

    def printInfo(self, verbose: bool = False) -> str:
        """`type-label` with the parameters; with `verbose` the conditions too."""
        text = f"{self._type}-{self._label} [{self._params.printState().strip()}]"
        return f"{text}\n{self.printConditions()}" if verbose else text

    def printConditions(self) -> str:
        """The conditions, a line each."""
        kinds = (("Pre", self._pre_conditions), ("Hold", self._hold_conditions), ("Post", self._post_conditions))
        return "\n".join(f"{kind}: {c.getDescription()}" for kind, some in kinds for c in some)

    def toElement(self) -> Element:
        """The skill as an element of the world model, with its parameters and conditions as children."""
        element = Element(self._type, self._label)
        element.setProperty("skiros:AvailableForPlanning", self._available_for_planning)
        for param in self._params.values():
            element.addRelation("-1", "skiros:hasParam", param.toElement())
        for relation, some in (
            ("skiros:hasPreCondition", self._pre_conditions),
            ("skiros:hasHoldCondition", self._hold_conditions),
            ("skiros:hasPostCondition", self._post_conditions),
        ):
            for condition in some:
                element.addRelation("-1", relation, condition.toElement())
        return element


def _add_new(known: list[Any], condition: Any) -> None:
    if not any(c.isEqual(condition) for c in known):
        known.append(condition)


class SkillCore(SkillDescription):
    """A skill that runs: its state, its progress, and the hooks that authors override.

    All hooks are called by the thread that ticks the task, one at a time. `getState`, `hasState`, `waitState`
    and the progress properties may be read by any thread.
    """

    def __init__(self) -> None:
        super().__init__()
        self._description: SkillDescription = SkillDescription()
        self._state = State.Uninitialized
        self._state_change = threading.Condition()
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
        if state is not self._state:
            with self._state_change:
                self._state = state
                self._state_change.notify_all()

    def waitState(self, state: State, isset: bool = True) -> None:
        """Blocks until the skill has that state (`isset`), or no longer has it. Not to be called in a hook."""
        with self._state_change:
            self._state_change.wait_for(lambda: (self._state == state) == isset)

    @property
    def expand_on_start(self) -> bool:
        """Whether a compound's subtree is made anew at each start."""
        return self._expand_on_start

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
        self._setProgress(msg, -abs(code))
        return False

    def step(self, msg: str = "") -> State:
        """For `execute`: the skill goes on."""
        self._setProgress(msg)
        return State.Running

    def fail(self, msg: str, code: int) -> State:
        """For `execute`: the skill has failed. The code is made negative."""
        self._setProgress(msg, -abs(code))
        return State.Failure

    def success(self, msg: str = "") -> State:
        """For `execute`: the skill has succeeded."""
        self._setProgress(msg)
        return State.Success

    # -- description -------------------------------------------------------------------------------------------

    def setDescription(self, description: SkillDescription, label: str = "") -> None:  # type: ignore[override]
        """Takes over what a description declares; the label, by default the class name, names the implementation."""
        description.createDescription()
        description.generateDefParams()
        description.generateDefConditions()
        SkillDescription.setDescription(
            self,
            description.type,
            description.params,
            description.pre_conditions,
            description.hold_conditions,
            description.post_conditions,
        )
        self._options = {key: list(options) for key, options in description.options.items()}
        self._available_for_planning = description.available_for_planning
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

    # -- conditions --------------------------------------------------------------------------------------------

    def hasPreCond(self) -> bool:
        return bool(self._pre_conditions)

    def hasPostCond(self) -> bool:
        return bool(self._post_conditions)

    def checkPreCond(self, verbose: bool = False) -> bool:
        """Whether all pre-conditions hold; one that does not is reported as progress, with code -1."""
        return self._check(self._pre_conditions, "Pre-condition failed", -1)

    def checkHoldCond(self, verbose: bool = False) -> bool:
        """Whether all hold-conditions hold; one that does not is reported as progress, with code -2."""
        return self._check(self._hold_conditions, "Hold-condition failed", -2)

    def checkPostCond(self, verbose: bool = False) -> bool:
        """Whether all post-conditions hold; one that does not is reported as progress, with code -3."""
        return self._check(self._post_conditions, "Post-condition failed", -3)

    def _check(self, some: Sequence[Any], what: str, code: int) -> bool:
        failed = [c for c in some if not c.evaluate(self._params, self._wmi)]
        if failed:
            self._setProgress(f"{what}: " + "; ".join(c.getDescription() for c in failed), code)
        return not failed

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

    def start(self, params: ParamHandler | None = None) -> bool:
        """Starts the skill: takes the parameters and calls `onStart`. False when the skill refuses.

        :raises Refused: the skill runs already.
        """
        if self._state is State.Running:
            raise Refused(f"{self._type}-{self._label} runs already")
        if params is not None:
            self.specifyParams(params, False)
        self._start_progress()
        if self.onStart() is False:
            self._setState(State.Failure)
            return False
        self._setState(State.Running)
        return True

    def preempt(self) -> State:
        """Ends a running skill: `onPreempt` tells the state it ends with. Returns the state."""
        if self._state is State.Running:
            self._setState(as_state(self.onPreempt(), State.Failure))
        return self._state

    def reset(self) -> None:
        """Makes the skill ready to start again."""
        self.onReset()
        self._start_progress()
        self._setState(State.Idle)

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

    # -- printing ----------------------------------------------------------------------------------------------

    def printState(self, verbose: bool = False) -> str:
        """`type-label(state)`; with `verbose` the parameters too."""
        text = f"{self._type}-{self._label}({self._state.name})"
        return f"{text}[{self._params.printState().strip()}]" if verbose else text

    def printProgress(self) -> str:
        """`code: message`."""
        return f"{self._progress_code}: {self._progress_msg}"


def as_state(answer: Any, default: State) -> State:
    """The state that a hook's answer stands for: a state, a bool (True: Success), or None (the default)."""
    if isinstance(answer, State):
        return answer
    if answer is None:
        return default
    if isinstance(answer, bool):
        return State.Success if answer else State.Failure
    raise TypeError(f"expected a State, True, False or None, got {type(answer).__name__} {answer!r}")
