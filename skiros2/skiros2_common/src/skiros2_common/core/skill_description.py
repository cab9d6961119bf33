"""What a skill is: its name, parameters and conditions."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

from skiros2_common.core import conditions as cond
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import full_name
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.source_location import SourceLocation, caller_location
from skiros2_common.core.world_element import Element

ParamOptions = Enum("ParamOptions", "Consume Output Unspecify Lock RespectType")

#: The property that tells whether a device is free, and its value when it is.
DEVICE_STATE = "skiros:StateProperty"
DEVICE_IDLE = "Idle"


#: The types of values that a program or a planner can give.
_PLAIN_TYPES = (str, int, float, bool)


class SkillDescription:
    """The name of a skill, its parameters and its conditions. Subclasses declare them in `createDescription`.

    An object of a subclass has them from its construction on, with `Robot` and the conditions that follow from options.
    """

    #: Whether the constructor declares everything; the implementations of skills do so when they are loaded.
    _declares_itself = True

    def __init__(self) -> None:
        self._type = full_name(self.__class__.__name__)
        self._label = ""
        self._params = ParamHandler()
        self._options: dict[str, list[Any]] = {}
        self._pre_conditions: list[Any] = []
        self._hold_conditions: list[Any] = []
        self._post_conditions: list[Any] = []
        self._exported_conditions: list[Any] = []  # post-conditions for planners, never checked
        self._available_for_planning = True
        self._duration: float | None = None
        self._places: dict[str, SourceLocation | None] = {}  # where each parameter was declared
        self._wmi: Any = None
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

    @property
    def duration(self) -> float | None:
        """How long the skill takes (s), for plans; None where that is to be learned from its runs."""
        return self._duration

    def set_duration(self, seconds: float) -> None:
        """Says how long the skill takes, for plans.

        :raises WrongValue: that is no duration.
        """
        if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0.0 <= seconds < math.inf:
            raise WrongValue(f"the duration of {self._type} is {seconds!r}, expected seconds")
        self._duration = float(seconds)

    def getDescription(self) -> tuple[str, ParamHandler, list[Any], list[Any], list[Any]]:
        """The type, the parameters, and the pre-, hold- and post-conditions, as `setDescription` takes them."""
        post = [*self._post_conditions, *self._exported_conditions]
        return self._type, self._params, self._pre_conditions, self._hold_conditions, post

    def setDescription(self, typein: str, paramsin: ParamHandler, prein: Any, holdin: Any, postin: Any) -> None:
        """Takes copies of the parameters and conditions of another skill."""
        self._type = typein
        self._params = ParamHandler(paramsin.getCopy())
        self._pre_conditions = [c.copy() for c in prein]
        self._hold_conditions = [c.copy() for c in holdin]
        self._post_conditions = [c.copy() for c in postin if not getattr(c, "only_exported", False)]
        self._exported_conditions = [c.copy() for c in postin if getattr(c, "only_exported", False)]

    def location_of(self, key: str) -> SourceLocation | None:
        """The file and line in which a parameter was declared."""
        return self._places.get(key)

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
        self._places[key] = caller_location()
        chosen = list(options) if isinstance(options, (list, tuple, set)) else [options]
        self._options.pop(key, None)
        if chosen:
            self._options[key] = chosen

    def generateDefParams(self) -> None:
        """Adds what every skill has: `Robot`, unless the skill declares its own."""
        if not self._params.hasParam("Robot"):
            self._params.addParam("Robot", Element("sumo:Agent"), ParamTypes.Inferred, "The robot that runs the skill")

    def generateDefConditions(self) -> None:
        """Adds the conditions that follow from the parameters' kinds and options, where they are not there yet."""
        for key, options in self._options.items():
            for option in options:
                self._add_option_conditions(key, option)
        for key, param in self._params.items():
            if param.is_element and param.paramTypeIs(ParamTypes.Optional):
                made = self.getGenerateCond(f"Has{key}", key, True)
                made.only_exported = True
                if not any(c.isEqual(made) for c in self._post_conditions):
                    _add_new(self._exported_conditions, made)

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

    def addPreCondition(self, condition: Any) -> None:
        """Adds a condition that has to hold when the skill starts."""
        condition.place = caller_location()
        self._pre_conditions.append(condition)

    def addHoldCondition(self, condition: Any) -> None:
        """Adds a condition that has to hold at each tick while the skill runs."""
        condition.place = caller_location()
        self._hold_conditions.append(condition)

    def addPostCondition(self, condition: Any) -> None:
        """Adds a condition that has to hold when the skill has succeeded."""
        condition.place = caller_location()
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

    def getModifiedParams(self) -> set[str]:
        """The keys of the parameters that post-conditions speak of: what the skill changes."""
        return {key for c in self._post_conditions for key in c.getKeys()}

    def printInfo(self, verbose: bool = False) -> str:
        """`type-label` with the parameters; with `verbose` the conditions too."""
        text = f"{self._type}-{self._label} [{self._params.printState().strip()}]"
        return f"{text}\n{self.printConditions()}" if verbose else text

    def printConditions(self) -> str:
        """The conditions, a line each."""
        kinds = (("Pre", self._pre_conditions), ("Hold", self._hold_conditions), ("Post", self._post_conditions))
        return "\n".join(f"{kind}: {c.getDescription()}" for kind, some in kinds for c in some)

    def toElement(self) -> Element:
        """The skill as an element of the world model, with its conditions and element parameters as children.

        Of other parameters only the keys of those that need a value are exported.
        """
        element = Element(self._type, self._label)
        element.setProperty("skiros:AvailableForPlanning", self._available_for_planning)
        if self._duration is not None:
            element.setProperty("skiros:Duration", self._duration)
        for param in self._params.values():
            if param.is_element:
                element.addRelation("-1", "skiros:hasParam", param.toElement())
            elif not param.values and param.paramTypeIs(ParamTypes.Required) and param.dataType() in _PLAIN_TYPES:
                element.appendProperty("skiros:MissingParameter", param.key)
        for relation, some in (
            ("skiros:hasPreCondition", self._pre_conditions),
            ("skiros:hasHoldCondition", self._hold_conditions),
            ("skiros:hasPostCondition", [*self._post_conditions, *self._exported_conditions]),
        ):
            for condition in some:
                element.addRelation("-1", relation, condition.toElement())
        return element


def _add_new(known: list[Any], condition: Any) -> None:
    if not any(c.isEqual(condition) for c in known):
        known.append(condition)
