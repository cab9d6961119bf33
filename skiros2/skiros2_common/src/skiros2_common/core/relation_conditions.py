"""Conditions on a relation between two elements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.names import full_name
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.world_element import Element


class ConditionRelation(ConditionBase):
    """True when a relation, or one under it, holds between two parameters.

    An unset side means "some element of its type". A relation that a reasoner owns is asked of it.

    :param olabel: the relation.
    :param obj: key of the object parameter.
    """

    abstract = False

    def __init__(self, clabel: str, olabel: str, subj: str, obj: str, desired_state: bool) -> None:
        super().__init__(clabel, subj, desired_state)
        self._relation = full_name(olabel)
        self._object_key = obj

    @property
    def relation(self) -> str:
        return self._relation

    @property
    def subject_key(self) -> str:
        return self._subject_key

    @property
    def object_key(self) -> str:
        return self._object_key

    def remap(self, initial_key: str, target_key: str) -> None:
        super().remap(initial_key, target_key)
        if self._object_key == initial_key:
            self._object_key = target_key

    def getKeys(self) -> list[str]:
        return list(dict.fromkeys([self._subject_key, self._object_key]))

    def _signature(self) -> tuple[Any, ...]:
        return (self._subject_key, self._relation, self._object_key)

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        subj = self._element(self._subject_key, ph, wmi)
        obj = self._element(self._object_key, ph, wmi)
        subj = self._default(self._subject_key, ph) if subj is None else subj
        obj = self._default(self._object_key, ph) if obj is None else obj
        if subj is None or obj is None:
            return False
        return bool(wmi.check_relation(subj, self._relation, obj, True, self.abstract))

    def fact(self) -> str:
        return f"{self._name(self._subject_key)} {self._relation} {self._name(self._object_key)}"

    def setTrue(self, ph: ParamHandler, wmi: Any) -> bool:
        if self.evaluate(ph, wmi):
            return True
        subj = self._element(self._subject_key, ph, wmi)
        obj = self._element(self._object_key, ph, wmi)
        if subj is None or obj is None or subj.isAbstract() or obj.isAbstract():
            return False
        if self._desired_state:
            changed = [{"src": subj.id, "type": self._relation, "dst": obj.id}]
        else:
            changed = list(wmi.get_relations(subj.id, self._relation, obj.id))
        _set_relations(changed, self._desired_state, wmi)
        self._undo.append(lambda: _set_relations(changed, not self._desired_state, wmi))
        return self.evaluate(ph, wmi)

    def setDesiredState(self, ph: ParamHandler) -> bool:
        subj = self._value(self._subject_key, ph)
        obj = self._value(self._object_key, ph)
        if not isinstance(subj, Element) or not isinstance(obj, Element) or obj.isAbstract():
            return False
        if self._desired_state:
            subj.addRelation("-1", self._relation, obj.id)
        else:
            subj.removeRelations(subj.getRelations("-1", self._relation, obj.id))
        return True

    def toElement(self) -> Element:
        element = super().toElement()
        element.setProperty("skiros:appliedOnType", self._relation)
        element.setProperty("skiros:hasObject", self._object_key)
        return element

    def _default(self, key: str, ph: ParamHandler) -> Element | None:
        """For an unset parameter, the abstract element that it was declared with."""
        param = ph.getParam(key)
        if param is None or param.value is not None or not isinstance(param.default, Element):
            return None
        return param.default if param.default.isAbstract() else None


class AbstractConditionRelation(ConditionRelation):
    """True when the ontology allows the relation between the classes, or has it between the templates."""

    abstract = True

    def setTrue(self, ph: ParamHandler, wmi: Any) -> bool:
        return self.evaluate(ph, wmi)  # the ontology is not an effect

    def setDesiredState(self, ph: ParamHandler) -> bool:
        return False


def _set_relations(relations: Sequence[Any], state: bool, wmi: Any) -> None:
    for relation in relations:
        wmi.set_relation(relation["src"], relation["type"], relation["dst"], state)
