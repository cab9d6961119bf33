"""Compounds: skills that are trees of other skills."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

from skiros2_common.core.abstract_skill import SkillCore, State
from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import WrongType
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.source_location import caller_location
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.processors import Processor
from skiros2_skill.core.protocols import Library
from skiros2_skill.core.tree.node import ControlNode, SkillInterface
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)


class SkillBase(SkillInterface):
    """Base class of compounds. Override `createDescription` (with `self.setDescription(...)`) and `expand`."""

    def __init__(self) -> None:
        super().__init__()
        self.expands_into: SkillWrapper | None = None

    def init(self, wmi: WorldModelPort, instanciator: Library | None) -> bool:  # type: ignore[override]
        """Loads the compound and creates its description. Returns False if it cannot be used."""
        self._wmi = wmi
        self.library = instanciator
        self.declare()
        if self.onInit() is False:
            return False
        self._setState(State.Idle)
        return True

    def onInit(self) -> bool | None:
        """To override: called once when the compound is loaded. Return False if it cannot be used."""
        return True

    def createDescription(self) -> None:
        """To override: `self.setDescription(Description(), "label")`, and additions of this implementation."""

    def expand(self, skill: SkillInterface) -> None:
        """To override: adds the children to `skill`, the node in the tree. `self.params` has the parameter values."""

    def getLightCopy(self) -> SkillBase:
        copy = self.__class__()
        copy.init(self._wmi, self.library)
        return copy

    # -- building the subtree ----------------------------------------------------------------------------------

    def skill(
        self,
        stype: str | Processor,
        slabel: str = "",
        remap: Mapping[str, str] | str = {},
        specify: Mapping[str, Any] = {},
        preconditions: Sequence[ConditionBase] = [],
    ) -> SkillInterface:
        """Creates a node for a skill or, given a processor, an unnamed group.

        :param stype: the skill's type: `Type`, `:Type` or `skiros:Type`; or a processor.
        :param slabel: the implementation's label; "" for any.
        :param remap: key of the child -> key of this skill.
        :param specify: values by remapped key.
        :param preconditions: additional pre-conditions of the child, with remapped keys.

        The remaps of a group apply to all its children; it has no parameters to specify.
        """
        remaps = remap if isinstance(remap, Mapping) else {}
        if isinstance(stype, Processor):
            group = self.getNode(stype)
            group.remaps.update(remaps)
            if specify:
                log.error("%s: a processor has no parameters, specify is ignored: %s", self.printState(), specify)
            return group
        node = self.getSkill(stype, slabel)
        node.source_location = caller_location()
        node.remaps.update(remaps)
        for key, values in (specify or {}).items():
            node.specifyParamDefault(key, values)
        for condition in preconditions:
            node.addPreCondition(condition)
        return node

    def getSkill(self, ptype: str, plabel: str) -> SkillWrapper:
        """Creates a node for a skill.

        :param plabel: the implementation's label; "" for any.
        :raises UnknownName: no library has a skill of that type.
        """
        if not isinstance(ptype, str) or not isinstance(plabel, str):
            raise WrongType(f"{self._label}: a skill is named by type and label, got {ptype!r} and {plabel!r}")
        if self.library is not None:
            self.library.require_type(ptype, plabel)
        return SkillWrapper(ptype, plabel, self.library)

    def getNode(self, children_processor: Processor) -> ControlNode:
        """Creates an unnamed group."""
        return ControlNode("", children_processor, self._wmi)

    # During `expand`, children are added to the node in the tree.

    def setProcessor(self, processor_type: Processor) -> None:
        if self.expands_into is not None:
            self.expands_into.setProcessor(processor_type)
        else:
            super().setProcessor(processor_type)

    def addChild(self, p: SkillInterface, latch: bool = False) -> SkillInterface:
        if self.expands_into is not None:
            return self.expands_into.addChild(p, latch)
        return super().addChild(p, latch)

    def popChild(self) -> SkillInterface:
        return self.expands_into.popChild() if self.expands_into is not None else super().popChild()

    def last(self) -> SkillInterface:
        return self.expands_into.last() if self.expands_into is not None else super().last()

    def hasChildren(self) -> bool:
        return self.expands_into.hasChildren() if self.expands_into is not None else super().hasChildren()

    # In hooks, a compound sets its own parameters like a primitive.

    def specifyParam(self, key: str, values: Any) -> None:
        SkillCore.specifyParam(self, key, values)

    def specifyParamDefault(self, key: str, values: Any) -> None:
        SkillCore.specifyParamDefault(self, key, values)

    def specifyParams(self, input_params: ParamHandler, keep_default: bool = True) -> None:
        SkillCore.specifyParams(self, input_params, keep_default)

    def specifyParamsDefault(self, input_params: ParamHandler) -> None:
        SkillCore.specifyParamsDefault(self, input_params)
