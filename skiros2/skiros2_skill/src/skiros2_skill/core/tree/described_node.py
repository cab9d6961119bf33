"""A node that names a skill, as `expand` has it: with the skill's description, before an implementation is chosen."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.errors import Refused, UnknownName
from skiros2_common.core.params import Param, ParamHandler
from skiros2_skill.core.tree.node import SkillInterface

#: The highest number of levels of skills in a tree. Each level takes some frames of the stack.
MAX_LEVELS = 5000


class DescribedNode(SkillInterface):
    """A node for a skill of the library; until it starts, it shows the description of the first implementation."""

    def __init__(self, children_processor: Any) -> None:
        super().__init__(children_processor)
        self._is_described = False
        self._asked_label = ""
        self._level = 0  # how many skills there are from the root down to this one; known once it starts
        self._own_hold_conditions: list[Any] = []
        self._own_post_conditions: list[Any] = []

    def declared_params(self) -> dict[str, Param]:
        """The parameters that the skill declares, by its own keys. Not to be changed.

        :raises UnknownName: the library has no such skill.
        """
        declared = self._instance if self._instance is not None else self.candidates()[0].declared
        params: dict[str, Param] = declared.params.getParamMap()
        return params

    @property
    def params(self) -> ParamHandler:
        """The parameters: those of the implementation once the node starts; before, under the remapped keys, those of
        the description, with the values that are fixed."""
        self._describe()
        return self._params

    def getParamsNoRemaps(self) -> ParamHandler:
        """The parameters under the keys that the skill itself uses."""
        if self._instance is not None:
            return self._params
        return ParamHandler({self.own_name(key): param.clone() for key, param in self.params.items()})

    def _describe(self) -> None:
        if self._instance is not None or self._is_described or self._instanciator is None:
            return
        self._is_described = True
        declared = self.candidates()[0].declared
        for key, param in declared.params.getCopy().items():
            param._key = self.name_above(key)
            self._params._params[param._key] = param
        for name, values in (*self._suggested.items(), *self._specified.items()):
            self._params.specifyDefault(name, values)
        for own, declared_conditions in (
            (self._pre_conditions, declared.pre_conditions),
            (self._hold_conditions, declared.hold_conditions),
            (self._post_conditions, declared.post_conditions),
        ):
            copies = [c.copy() for c in declared_conditions]
            for condition in copies:
                for key in set(condition.getKeys()):
                    condition.remap(key, self.name_above(key))
            own[:0] = copies

    @property
    def pre_conditions(self) -> list[Any]:
        self._describe()
        return self._pre_conditions

    @property
    def hold_conditions(self) -> list[Any]:
        self._describe()
        return self._hold_conditions

    @property
    def post_conditions(self) -> list[Any]:
        self._describe()
        return self._post_conditions

    def remap(self, initial_key: str, target_key: str, record: bool = True) -> None:
        super().remap(initial_key, target_key, record)
        if self._instance is None and self._is_described:
            self._params.remap(initial_key, target_key)

    def specifyParamDefault(self, key: str, values: Any) -> None:
        super().specifyParamDefault(key, values)
        if self._instance is None and self._is_described:
            self._params.specifyDefault(key, self._specified[key])

    def addPreCondition(self, condition: Any, modify_description: bool = False) -> None:
        """Adds a pre-condition to the node, over the names that its keys have one level up."""
        self._own_pre_conditions.append(self._own_condition(condition))
        self._pre_conditions.append(condition)

    def addHoldCondition(self, condition: Any, modify_description: bool = False) -> None:
        """Adds a hold-condition to the node, over the names that its keys have one level up."""
        self._own_hold_conditions.append(self._own_condition(condition))
        self._hold_conditions.append(condition)

    def addPostCondition(self, condition: Any, modify_description: bool = False) -> None:
        """Adds a post-condition to the node, over the names that its keys have one level up."""
        self._own_post_conditions.append(self._own_condition(condition))
        self._post_conditions.append(condition)

    def _own_condition(self, condition: Any) -> Any:
        own = condition.copy()
        for name in set(own.getKeys()):
            own.remap(name, self.own_name(name))
        return own

    def candidates(self) -> list[Any]:
        """The implementations that the library has for the node.

        :raises UnknownName: there is none.
        :raises Refused: the node is below too many others.
        """
        above = self._parent
        while above is not None and not isinstance(above, DescribedNode):
            above = above._parent
        self._level = above._level + 1 if above is not None else 1
        if self._level > MAX_LEVELS:
            raise Refused(f"{self.printState()} is below {MAX_LEVELS} levels of skills: one of them contains itself")
        if self._instanciator is None:
            raise UnknownName(f"{self.printState()} has no skill library to be taken from")
        found: list[Any] = self._instanciator.candidates(self._type, self._asked_label)
        return found

    def specifyParamsDefault(self, input_params: ParamHandler) -> None:
        """As for other nodes; keys that the skill does not have are ignored."""
        try:
            declared = self.candidates()[0].declared.params
        except UnknownName:
            super().specifyParamsDefault(input_params)  # its start reports the unknown skill
            return
        known = {key: p for key, p in input_params.items() if declared.hasParam(self.own_name(key))}
        super().specifyParamsDefault(ParamHandler(known))

    @property
    def own_pre_conditions(self) -> list[Any]:
        """The pre-conditions that came with the node, beside those of the implementation."""
        return self._own_pre_conditions
