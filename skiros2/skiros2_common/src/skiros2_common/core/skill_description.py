"""The description of a skill: its name, parameters and conditions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import Enum
from typing import Any, cast

from skiros2_common.core import conditions as cond
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.limits import NO_LIMITS, Limits
from skiros2_common.core.names import full_name
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.preempt_handler import Preemptible
from skiros2_common.core.source_location import SourceLocation, caller_location
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort

ParamOptions = Enum("ParamOptions", "Consume Output Unspecify Lock RespectType")

#: The property with the state of a device, and its value for a free device.
DEVICE_STATE = "skiros:StateProperty"
DEVICE_IDLE = "Idle"

#: The value types that programs and planners can pass.
_PLAIN_TYPES = (str, int, float, bool)


class SkillDescription(Preemptible):
    """The name of a skill, its parameters and its conditions. Subclasses declare them in `createDescription`.

    The constructor of a subclass declares them, with `Robot` and the conditions that follow from options.
    """

    #: Whether the constructor declares everything; implementations of skills do so when they are loaded.
    _declares_itself = True

    # Defaults of the class: objects with up to 30 attributes of their own take a fifth of the memory in CPython.
    #: Whether the skill, and the children of a compound, may start and run while the robot is stopped.
    allowed_when_stopped = False
    _available_for_planning = True
    _duration: float | None = None

    def __init__(self) -> None:
        self._type = full_name(self.__class__.__name__)
        self._label = ""
        self._params = ParamHandler()
        self._options: dict[str, list[Any]] = {}
        self._pre_conditions: list[cond.ConditionBase] = []
        self._hold_conditions: list[cond.ConditionBase] = []
        self._post_conditions: list[cond.ConditionBase] = []
        self._exported_conditions: list[cond.ConditionBase] = []  # post-conditions for planners, never checked
        self._source_locations: dict[str, SourceLocation | None] = {}  # of each parameter's declaration
        self._wmi = cast(WorldModelPort, None)  # until the skill is loaded
        if self._declares_itself and type(self) is not SkillDescription:
            self.createDescription()
            self.generateDefParams()
            self.generateDefConditions()

    # -- reading -----------------------------------------------------------------------------------------------

    @property
    def params(self) -> ParamHandler:
        """The parameters."""
        return self._params

    @property
    def label(self) -> str:
        """The label of the implementation; "" for a description."""
        return self._label

    @property
    def type(self) -> str:
        """The skill's class in the ontology, such as `skiros:Pick`."""
        return self._type

    @property
    def wmi(self) -> WorldModelPort:
        """The world model as the skill sees it; None before the skill is loaded."""
        return self._wmi

    @property
    def pre_conditions(self) -> list[cond.ConditionBase]:
        return self._pre_conditions

    @property
    def hold_conditions(self) -> list[cond.ConditionBase]:
        return self._hold_conditions

    @property
    def post_conditions(self) -> list[cond.ConditionBase]:
        return self._post_conditions

    @property
    def options(self) -> dict[str, list[Any]]:
        """The `ParamOptions` of the parameters that have any."""
        return self._options

    @property
    def available_for_planning(self) -> bool:
        """Whether the task manager may plan with the skill."""
        return self._available_for_planning

    def setAvailableForPlanning(self, available: bool = True) -> None:
        """Sets whether the task manager may plan with the skill."""
        self._available_for_planning = available

    @property
    def duration(self) -> float | None:
        """The expected duration (s) for plans; None if planners estimate it from past runs."""
        return self._duration

    def set_duration(self, seconds: float) -> None:
        """Sets the expected duration for plans.

        :raises WrongValue: `seconds` is not a finite number from 0.
        """
        if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0.0 <= seconds < math.inf:
            raise WrongValue(f"the duration of {self._type} is {seconds!r}, expected seconds")
        self._duration = float(seconds)

    def getDescription(self) -> tuple[str, ParamHandler, list[Any], list[Any], list[Any]]:
        """Type, parameters, pre-, hold- and post-conditions: the arguments of `setDescription`."""
        post = [*self._post_conditions, *self._exported_conditions]
        return self._type, self._params, self._pre_conditions, self._hold_conditions, post

    def setDescription(self, typein: str, paramsin: ParamHandler, prein: Any, holdin: Any, postin: Any) -> None:
        """Copies the parameters and conditions of another skill."""
        self._type = typein
        self._params = ParamHandler(paramsin.getCopy())
        self._pre_conditions = [c.copy() for c in prein]
        self._hold_conditions = [c.copy() for c in holdin]
        self._post_conditions = [c.copy() for c in postin if not getattr(c, "only_exported", False)]
        self._exported_conditions = [c.copy() for c in postin if getattr(c, "only_exported", False)]

    def location_of(self, key: str) -> SourceLocation | None:
        """The source location of a parameter's declaration."""
        return self._source_locations.get(key)

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
        *,
        unit: str = "",
        minimum: float | None = None,
        maximum: float | None = None,
        choices: Iterable[Any] = (),
    ) -> None:
        """Declares a parameter, or redefines it. The skill does not start with values outside the limits.

        :param value: a default, a Python type (no default), a list of one type, or an abstract `Element`.
        :param param_type: one of `ParamTypes`.
        :param options: one of `ParamOptions` or a list of them; a string is taken as the description.
        :param unit: of the values, such as `m/s`, for people.
        :param minimum, maximum: the allowed range; None: no limit.
        :param choices: the allowed values; (): any.
        """
        if isinstance(options, str):
            options, description = [], options
        limits = Limits(unit, minimum, maximum, (choices,) if isinstance(choices, str) else tuple(choices))
        self._params.addParam(key, value, param_type, description, NO_LIMITS if limits == NO_LIMITS else limits)
        self._source_locations[key] = caller_location()
        selected = list(options) if isinstance(options, (list, tuple, set)) else [options]
        self._options.pop(key, None)
        if selected:
            self._options[key] = selected

    def generateDefParams(self) -> None:
        """Adds the parameter `Robot`, unless the skill declares it."""
        if not self._params.hasParam("Robot"):
            self._params.addParam("Robot", Element("sumo:Agent"), ParamTypes.Inferred, "The robot that runs the skill")

    def generateDefConditions(self) -> None:
        """Adds the missing conditions that follow from the parameters' types and options."""
        for key, options in self._options.items():
            for option in options:
                self._add_option_conditions(key, option)
        for key, param in self._params.items():
            if param.is_element and param.paramTypeIs(ParamTypes.Optional):
                generated = self.getGenerateCond(f"Has{key}", key, True)
                generated.only_exported = True
                if not any(c.isEqual(generated) for c in self._post_conditions):
                    _add_new(self._exported_conditions, generated)

    def _add_option_conditions(self, key: str, option: Any) -> None:
        if option == ParamOptions.Consume:
            _add_new(self._post_conditions, self.getGenerateCond(f"Consume{key}", key, False))
        elif option == ParamOptions.Unspecify:
            _add_new(self._post_conditions, self.getIsSpecifiedCond(f"Unset{key}", key, False))
        elif option == ParamOptions.Lock:
            idle = self.getPropCond(f"{key}Idle", DEVICE_STATE, key, "=", DEVICE_IDLE, True)
            busy = self.getPropCond(f"{key}Busy", DEVICE_STATE, key, "=", DEVICE_IDLE, False)
            freed = self.getPropCond(f"{key}Idle", DEVICE_STATE, key, "=", DEVICE_IDLE, True)
            _add_new(self._pre_conditions, idle)
            _add_new(self._hold_conditions, busy)
            _add_new(self._post_conditions, freed)
        elif option == ParamOptions.RespectType:
            wanted = self._params.getParamMap()[key].element_type
            _add_new(self._pre_conditions, self.getOnTypeCond(f"{key}OfType", key, wanted))

    def getOutputParams(self) -> dict[str, Param]:
        """The Optional parameters, by key."""
        return self._params.getParamMapFiltered(ParamTypes.Optional)

    def addPreCondition(self, condition: cond.ConditionBase) -> None:
        """Adds a condition that must hold when the skill starts."""
        condition.source_location = caller_location()
        self._pre_conditions.append(condition)

    def addHoldCondition(self, condition: cond.ConditionBase) -> None:
        """Adds a condition that must hold at each tick while the skill runs."""
        condition.source_location = caller_location()
        self._hold_conditions.append(condition)

    def addPostCondition(self, condition: cond.ConditionBase) -> None:
        """Adds a condition that must hold after the skill succeeded."""
        condition.source_location = caller_location()
        self._post_conditions.append(condition)

    # -- condition factories ----------------------------------------------------------------------------------

    def getOrCond(self, desired_state: bool) -> cond.ConditionOr:
        """True if one of its parts, to be added, holds."""
        return cond.ConditionOr(desired_state)

    def getIsSpecifiedCond(self, clabel: str, subj: str, desired_state: bool) -> cond.ConditionIsSpecified:
        """True if the parameter holds an element of the scene."""
        return cond.ConditionIsSpecified(clabel, subj, desired_state)

    def getGenerateCond(self, clabel: str, subj: str, desired_state: bool) -> cond.ConditionGenerate:
        """True if the parameter holds an element; as an effect, the skill creates (True) or removes (False) it."""
        return cond.ConditionGenerate(clabel, subj, desired_state)

    def getHasPropCond(self, clabel: str, olabel: str, subj: str, desired_state: bool) -> cond.ConditionHasProperty:
        """True if the property has a value."""
        return cond.ConditionHasProperty(clabel, olabel, subj, desired_state)

    def getPropCond(
        self, clabel: str, olabel: str, subj: str, operator: str, value: Any, desired_state: bool
    ) -> cond.ConditionProperty:
        """True if the comparison (`= > < >= <=`) of the property with the value holds."""
        return cond.ConditionProperty(clabel, olabel, subj, operator, value, desired_state)

    def getAbstractRelationCond(
        self, clabel: str, olabel: str, subj: str, obj: str, desired_state: bool
    ) -> cond.AbstractConditionRelation:
        """True if the ontology allows the relation between the classes of the two."""
        return cond.AbstractConditionRelation(clabel, olabel, subj, obj, desired_state)

    def getRelationCond(
        self, clabel: str, olabel: str, subj: str, obj: str, desired_state: bool
    ) -> cond.ConditionRelation:
        """True if the relation, or a subproperty of it, holds."""
        return cond.ConditionRelation(clabel, olabel, subj, obj, desired_state)

    def getOnTypeCond(self, clabel: str, subj: str, value: str) -> cond.ConditionOnType:
        """True if the value's class is the given one or a subclass of it."""
        return cond.ConditionOnType(clabel, subj, value)

    def getSignalCond(
        self, clabel: str, signal: str, subj: str, *,
        minimum: float | str | None = None, maximum: float | str | None = None,
        duration: float = 0.0, hysteresis: float = 0.0, timeout: float = 0.5,
        kind: FailureKind = FailureKind.RETRYABLE,
    ) -> cond.ConditionSignal:  # fmt: skip
        """True while a signal of the element, such as the force at a wrist, is within limits; for hold-conditions.

        :param signal: its class, such as `skiros:WristForce`, or its label.
        :param minimum, maximum: in the signal's unit, or keys of parameters; None: no limit.
        :param duration: how long (s) the value must be outside the limits to violate them.
        :param hysteresis: how far inside the limits a value must be to end that time, in the signal's unit.
        :param timeout: the longest time (s) without a message; inf: any.
        :param kind: whether the skill may be tried again when the signal was not within limits.
        :raises WrongValue: the limits are unusable.
        """
        return cond.ConditionSignal(clabel, signal, subj, minimum, maximum, duration, hysteresis, timeout, kind)

    # -- other forms -------------------------------------------------------------------------------------------

    def getModifiedParams(self) -> set[str]:
        """The keys of the parameters in post-conditions, which the skill changes."""
        return {key for c in self._post_conditions for key in c.getKeys()}

    def printInfo(self, verbose: bool = False) -> str:
        """`type-label` with the parameters; with `verbose`, also the conditions."""
        text = f"{self._type}-{self._label} [{self._params.printState().strip()}]"
        return f"{text}\n{self.printConditions()}" if verbose else text

    def printConditions(self) -> str:
        """The conditions, a line each."""
        kinds = (("Pre", self._pre_conditions), ("Hold", self._hold_conditions), ("Post", self._post_conditions))
        return "\n".join(f"{kind}: {c.getDescription()}" for kind, group in kinds for c in group)

    def toElement(self) -> Element:
        """The skill as an element of the world model, with its conditions and parameters as children.

        Of the parameters that hold no elements, only those with limits or a unit are exported, and the keys of those
        that require a value.
        """
        element = Element(self._type, self._label)
        element.setProperty("skiros:AvailableForPlanning", self._available_for_planning)
        if self._duration is not None:
            element.setProperty("skiros:Duration", self._duration)
        for param in self._params.values():
            if param.is_element or param.limits is not NO_LIMITS:
                element.addRelation("-1", "skiros:hasParam", param.toElement())
            elif not param.values and param.paramTypeIs(ParamTypes.Required) and param.dataType() in _PLAIN_TYPES:
                element.appendProperty("skiros:MissingParameter", param.key)
        for relation, group in (
            ("skiros:hasPreCondition", self._pre_conditions),
            ("skiros:hasHoldCondition", self._hold_conditions),
            ("skiros:hasPostCondition", [*self._post_conditions, *self._exported_conditions]),
        ):
            for condition in group:
                element.addRelation("-1", relation, condition.toElement())
        return element


def _add_new(known: list[cond.ConditionBase], condition: cond.ConditionBase) -> None:
    if not any(c.isEqual(condition) for c in known):
        known.append(condition)
