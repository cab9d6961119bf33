"""Conditions on a relation between two elements."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from skiros2_common.core.condition import ConditionBase, some
from skiros2_common.core.explanation import MOST_NAMED, Change, Near
from skiros2_common.core.names import full_name, id_order
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
        subject, object_ = self._subject_key, self._object_key
        return [subject, object_] if subject != object_ else [subject]

    def _signature(self) -> tuple[Any, ...]:
        return (self._subject_key, self._relation, self._object_key)

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        # Of a relation that the scene holds, the ids are all that counts: one that is gone has none.
        by_id = self.is_stored(wmi)
        subj, obj = self._side(self._subject_key, ph, wmi, by_id), self._side(self._object_key, ph, wmi, by_id)
        return subj is not None and obj is not None and self._links(subj, obj, wmi)

    def fact(self) -> str:
        return f"{self._name(self._subject_key)} {self._relation} {self._name(self._object_key)}"

    def found(self, ph: ParamHandler, wmi: Any) -> str:
        if not self._desired_state:
            return self.fact()
        told = [text for key in self.getKeys() if (text := self._lacking(key, ph, wmi))]
        subj, obj = self._side(self._subject_key, ph, wmi), self._side(self._object_key, ph, wmi)
        if subj is not None and obj is not None:
            told += self._related(subj, obj, wmi)
        return "; ".join(told)

    def said_of(self, key: str, ph: ParamHandler) -> str:
        for other in self.getKeys():
            self._remember(other, ph)
        relation = self._relation if self._desired_state else f"not {self._relation}"
        if key == self._subject_key:
            return f"{relation} {self._name(self._object_key)}"
        return f"with {self._name(self._subject_key)} {relation} it"

    def _related(self, subj: Element, obj: Element, wmi: Any) -> list[str]:
        """What the elements have along the relation, in words."""
        reasoner = wmi.get_reasoner(self._relation)
        if reasoner is not None and subj.id and obj.id:
            names = [r["type"] for r in wmi.get_reasoner_relations(subj, reasoner.__class__.__name__, obj)]
            return [f"{subj!r} {', '.join(names) or 'has no known relation to'} {obj!r}"]
        told = []
        if reasoner is None and subj.id:
            told.append(f"{subj!r} {self._relation} {self._objects(subj, wmi)}")
        if reasoner is None and obj.id:
            told.append(f"{self._subjects(obj, wmi)} {self._relation} {obj!r}")
        return told

    def instead(self, key: str, ph: ParamHandler, wmi: Any) -> str:
        element = self._side(key, ph, wmi)
        if element is None or not element.id or not self._desired_state or not self.is_stored(wmi):
            return super().instead(key, ph, wmi)
        if key == self._subject_key:
            return f"{self._relation} {self._objects(element, wmi)}"
        return f"{self._subjects(element, wmi)} {self._relation} it"

    def _objects(self, subj: Element, wmi: Any) -> str:
        return _named((r["dst"] for r in wmi.get_relations(subj.id, self._relation, "")), wmi)

    def _subjects(self, obj: Element, wmi: Any) -> str:
        return _named((r["src"] for r in wmi.get_relations("", self._relation, obj.id)), wmi)

    def is_stored(self, wmi: Any) -> bool:
        """Whether the scene holds the relation, so that it has an index of it; no reasoner computes it."""
        return not self.abstract and wmi.get_reasoner(self._relation) is None

    def _nearest(self, ph: ParamHandler, wmi: Any) -> list[Near]:
        subj, obj = self._side(self._subject_key, ph, wmi), self._side(self._object_key, ph, wmi)
        if subj is None or obj is None or not (self.abstract or self.is_stored(wmi)):
            return []  # a reasoner may take long
        state = self._desired_state
        relation = self._relation if state else f"not {self._relation}"
        is_indexed = state and not self.abstract
        ids = [r["src"] for r in wmi.get_relations("", self._relation, obj.id)] if is_indexed and obj.id else None
        subjects = self._others(self._subject_key, ph, wmi, ids=ids)
        fitting = (e for e in subjects if self._links(e, obj, wmi) == state)
        near = some(fitting, f"{relation} {self._name(self._object_key)}")
        if subj.id and is_indexed:
            ids = [r["dst"] for r in wmi.get_relations(subj.id, self._relation, "")]
            objects = self._others(self._object_key, ph, wmi, ids=ids)
            near += some(objects, f"{self._name(self._subject_key)} {relation} it")
        return near[:MOST_NAMED]

    def _links(self, subj: Element, obj: Element, wmi: Any) -> bool:
        return bool(wmi.check_relation(subj, self._relation, obj, True, self.abstract))

    def _changes(self, ph: ParamHandler, wmi: Any) -> list[Change]:
        if not self.is_stored(wmi):
            return []
        return [change for key in self.getKeys() for change in self._last(key, self._relation, ph, wmi)]

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

    def _side(self, key: str, ph: ParamHandler, wmi: Any, by_id: bool = False) -> Element | None:
        """The element in a parameter; for an unset one the abstract element that it was declared with.

        :param by_id: it need not be as the world model has it now, nor be there at all.
        """
        element = self._given(key, ph) if by_id else self._element(key, ph, wmi)
        return element if element is not None else self._default(key, ph)

    def _default(self, key: str, ph: ParamHandler) -> Element | None:
        param = ph.getParam(key)
        if param is None or param.value is not None or not isinstance(param.default, Element):
            return None
        return param.default if param.default.isAbstract() else None


class AbstractConditionRelation(ConditionRelation):
    """True when the ontology allows the relation between the classes, or has it between the templates."""

    abstract = True

    def _related(self, subj: Element, obj: Element, wmi: Any) -> list[str]:
        return [f"the ontology does not allow {subj.type} {self._relation} {obj.type}"]

    def setTrue(self, ph: ParamHandler, wmi: Any) -> bool:
        return self.evaluate(ph, wmi)  # the ontology is not an effect

    def setDesiredState(self, ph: ParamHandler) -> bool:
        return False


def _set_relations(relations: Sequence[Any], state: bool, wmi: Any) -> None:
    for relation in relations:
        wmi.set_relation(relation["src"], relation["type"], relation["dst"], state)


def _named(ids: Iterable[str], wmi: Any) -> str:
    """The elements of some ids, ordered, as a text; of many the first and how many more there are."""
    ordered = sorted(set(ids), key=id_order)
    found = ((eid, wmi.find_element(eid)) for eid in ordered[:MOST_NAMED])
    names = [repr(element) if element is not None else eid for eid, element in found]
    more = f" and {len(ordered) - MOST_NAMED} more" if len(ordered) > MOST_NAMED else ""
    return (", ".join(names) or "nothing") + more
