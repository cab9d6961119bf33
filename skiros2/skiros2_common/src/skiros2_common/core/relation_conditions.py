"""Conditions on a relation between two elements."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from skiros2_common.core.condition import (
    ConditionBase,
    can_find_elements,
    is_in_scene,
    near_matches,
)
from skiros2_common.core.condition_record import Cost
from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.explanation import MAX_EXAMPLES, Change, NearMatch
from skiros2_common.core.names import SCENE_ROOT, SPATIAL, full_name, id_order, local_name
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.wording import unrelated
from skiros2_common.core.world_element import Element, reasoners

if TYPE_CHECKING:
    from skiros2_common.core.world_model_port import WorldModelPort


class ConditionRelation(ConditionBase):
    """True if a relation, or a subproperty of it, holds between two parameters.

    An abstract side stands for "some element of exactly its class". A reasoner computes the relations that it owns.

    :param olabel: the relation.
    :param obj: key of the object parameter.
    """

    abstract = False
    wants_elements = True

    def __init__(self, clabel: str, olabel: str, subj: str, obj: str, desired_state: bool) -> None:
        super().__init__(clabel, subj, desired_state)
        self._owl_label = olabel
        self._object_key = obj

    record_fields = ("label", "name", "subject", "object", "state")
    planned_as = "relation"

    @property
    def relation(self) -> str:
        """The full name of the relation."""
        return full_name(self._owl_label)

    @property
    def volatile(self) -> bool:  # type: ignore[override]
        return not self.abstract and not self.is_stored()

    @property
    def cost(self) -> Cost:  # type: ignore[override]
        if not self.abstract and not self.is_stored():
            return Cost.REASONER
        return Cost.LOOKUP if self._desired_state else Cost.ABSENCE

    def ontology_names(self) -> list[tuple[str, str]]:
        return [("relation", self.relation)]

    element_ids = ConditionBase.ids_in_parameters

    def candidate_ids(self, key: str, ph: ParamHandler, wmi: WorldModelPort) -> set[str] | None:
        is_subject = key == self._subject_key
        other = self._object_key if is_subject else self._subject_key
        if other == key or not ph.is_bound(other) or not self._desired_state or not self.is_stored():
            return None
        eid = ph.getParamMap()[other].value.id
        if is_subject:
            return {r["src"] for r in wmi.get_relations("", self.relation, eid)}
        return {r["dst"] for r in wmi.get_relations(eid, self.relation, "")}

    def remap(self, initial_key: str, target_key: str) -> None:
        super().remap(initial_key, target_key)
        if self._object_key == initial_key:
            self._object_key = target_key

    def getKeys(self) -> list[str]:
        return [self._subject_key, self._object_key]

    def _signature(self) -> tuple[Any, ...]:
        return (self._subject_key, self.relation, self._object_key)

    def holds(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        if self.is_stored():  # only the ids matter: a removed element has no relations
            subj, obj = self._raw_element(self._subject_key, ph), self._raw_element(self._object_key, ph)
        else:
            subj, obj = self._element(self._subject_key, ph, wmi), self._element(self._object_key, ph, wmi)
        return subj is not None and obj is not None and self._links(subj, obj, wmi)

    def fact(self) -> str:
        return f"{self._name(self._subject_key)} {self.relation} {self._name(self._object_key)}"

    def found(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        if not self._desired_state:
            return self.fact()
        reasons = [text for key in dict.fromkeys(self.getKeys()) if (text := self._missing_reason(key, ph, wmi))]
        subj, obj = self._element(self._subject_key, ph, wmi), self._element(self._object_key, ph, wmi)
        if subj is not None and obj is not None and all(not e.id or is_in_scene(e, wmi) for e in (subj, obj)):
            reasons += self._related(subj, obj, wmi)
        return "; ".join(reasons)

    def statement(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        subj, obj = self._element(self._subject_key, ph, wmi), self._element(self._object_key, ph, wmi)
        missing = [text for key in dict.fromkeys(self.getKeys()) if (text := self._missing_reason(key, ph, wmi))]
        found = [e for e in (subj, obj) if e is not None and not e.isAbstract()]
        if not self._desired_state or missing or len(found) < 2 or not self.is_stored():
            return super().statement(ph, wmi)
        subj, obj = found
        if local_name(self.relation) == "contain" and not wmi.get_relations("", SPATIAL, obj.id):
            return f"{obj!r} is nowhere"
        holders = [r["src"] for r in wmi.get_relations("", self.relation, obj.id)]
        others = [r["dst"] for r in wmi.get_relations(subj.id, self.relation, "")]
        return unrelated(self.relation, repr(subj), repr(obj), _all_named(holders, wmi), _all_named(others, wmi))

    def filter_text(self, key: str, ph: ParamHandler) -> str:
        for other in self.getKeys():
            self._remember(other, ph)
        relation = self.relation if self._desired_state else f"not {self.relation}"
        if key == self._subject_key:
            return f"{relation} {self._name(self._object_key)}"
        return f"with {self._name(self._subject_key)} {relation} it"

    def _related(self, subj: Element, obj: Element, wmi: WorldModelPort) -> list[str]:
        """The actual relations of the two elements, as text."""
        reasoner = reasoners.find_or_load(self.relation)
        if reasoner is not None and subj.id and obj.id:
            names = [r["type"] for r in wmi.get_reasoner_relations(subj, reasoner.__class__.__name__, obj)]
            return [f"{subj!r} {', '.join(names) or 'has no known relation to'} {obj!r}"]
        texts = []
        if reasoner is None and subj.id:
            texts.append(f"{subj!r} {self.relation} {self._objects(subj, wmi)}")
        if reasoner is None and obj.id:
            texts.append(f"{self._subjects(obj, wmi)} {self.relation} {obj!r}")
        return texts

    def found_for(self, key: str, ph: ParamHandler, wmi: WorldModelPort) -> str:
        element = self._element(key, ph, wmi)
        if element is None or not element.id or not self._desired_state or not self.is_stored():
            return super().found_for(key, ph, wmi)
        if key == self._subject_key:
            return f"{self.relation} {self._objects(element, wmi)}"
        return f"{self._subjects(element, wmi)} {self.relation} it"

    def _objects(self, subj: Element, wmi: WorldModelPort) -> str:
        return _named((r["dst"] for r in wmi.get_relations(subj.id, self.relation, "")), wmi)

    def _subjects(self, obj: Element, wmi: WorldModelPort) -> str:
        return _named((r["src"] for r in wmi.get_relations("", self.relation, obj.id)), wmi)

    def is_stored(self) -> bool:
        """Whether the scene stores and indexes the relation, so that no reasoner computes it."""
        return not self.abstract and reasoners.find_or_load(self.relation) is None

    def _near_matches(self, ph: ParamHandler, wmi: WorldModelPort) -> list[NearMatch]:
        subj, obj = self._element(self._subject_key, ph, wmi), self._element(self._object_key, ph, wmi)
        if subj is None or obj is None or not (self.abstract or self.is_stored()):
            return []  # a reasoner may be slow
        state = self._desired_state
        relation = self.relation if state else f"not {self.relation}"
        is_indexed = state and not self.abstract
        ids = [r["src"] for r in wmi.get_relations("", self.relation, obj.id)] if is_indexed and obj.id else None
        subjects = self._alternatives(self._subject_key, ph, wmi, ids=ids)
        matching = (e for e in subjects if self._links(e, obj, wmi) == state)
        near = near_matches(matching, f"{relation} {self._name(self._object_key)}")
        if subj.id and is_indexed:
            ids = [r["dst"] for r in wmi.get_relations(subj.id, self.relation, "")]
            objects = self._alternatives(self._object_key, ph, wmi, ids=ids)
            near += near_matches(objects, f"{self._name(self._subject_key)} {relation} it")
        return near[:MAX_EXAMPLES]

    def _links(self, subj: Element, obj: Element, wmi: WorldModelPort) -> bool:
        is_pair = bool(subj.id and obj.id)
        if hasattr(type(wmi), "check_relation") and (
            is_pair or not self.is_stored() or not hasattr(wmi, "get_relations")
        ):
            return bool(wmi.check_relation(subj, self.relation, obj, True, False))
        return any(
            (subj.id or _is_exactly(r["src"], subj.type, wmi)) and (obj.id or _is_exactly(r["dst"], obj.type, wmi))
            for r in wmi.get_relations(subj.id, self.relation, obj.id)
        )

    def _changes(self, ph: ParamHandler, wmi: WorldModelPort) -> list[Change]:
        if not self.is_stored():
            return []
        return [change for key in self.getKeys() for change in self._last_change(key, self.relation, ph, wmi)]

    def _make_true(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        subj = self._element(self._subject_key, ph, wmi)
        obj = self._element(self._object_key, ph, wmi)
        if subj is None or obj is None or subj.isAbstract() or obj.isAbstract():
            return False
        if self._desired_state:
            changed = [relation_dict(subj.id, self.relation, obj.id)]
        else:
            found = wmi.get_relations(subj.id, self.relation, obj.id)
            changed = [relation_dict(subj.id, r["type"], r["dst"]) for r in found]
        _set_relations(changed, self._desired_state, wmi)
        self._undo.append(lambda: _set_relations(changed, not self._desired_state, wmi))
        return True

    def setDesiredState(self, ph: ParamHandler) -> bool:
        subj = self._param_value(self._subject_key, ph)
        obj = self._param_value(self._object_key, ph)
        if not isinstance(subj, Element) or not isinstance(obj, Element):
            return False
        if subj.isAbstract() or obj.isAbstract():
            wanted = self._desired_state, self.abstract
            if subj.isAbstract():
                subj.addRelation("-1", self._owl_label, self._object_key, *wanted)
            if obj.isAbstract():
                obj.addRelation(self._subject_key, self._owl_label, "-1", *wanted)
            return True
        return self._relate(subj, obj)

    def _relate(self, subj: Element, obj: Element) -> bool:
        """Applies the effect to two elements. Returns False if that is impossible."""
        if self._desired_state:
            subj.addRelation("-1", self._owl_label, obj.id)
        else:
            subj.removeRelations(subj.getRelations("-1", self.relation, obj.id))
        return True

    def toElement(self) -> Element:
        element = super().toElement()
        element.setProperty("skiros:appliedOnType", self.relation)
        element.setProperty("skiros:hasObject", self._object_key)
        return element


class AbstractConditionRelation(ConditionRelation):
    """True if the ontology allows the relation between the classes. Inference checks it between templates."""

    abstract = True

    record_fields = ("label", "name", "subject", "object", "state")
    planned_as = "allowed"
    element_ids = ConditionBase.ids_in_parameters

    def satisfied_for_inference(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        for key in self.getKeys():
            self._remember(key, ph)
        subj, obj = (self._element(key, ph, wmi) for key in self.getKeys())
        found = subj is not None and obj is not None and wmi.check_relation(subj, self.relation, obj, True, True)
        return bool(found) == self._desired_state

    def _links(self, subj: Element, obj: Element, wmi: WorldModelPort) -> bool:
        if hasattr(type(wmi), "allows_relation"):
            return bool(wmi.allows_relation(subj.type, self.relation, obj.type))
        names = full_name(subj.type), self.relation, full_name(obj.type)
        return bool(wmi.query_ontology(_ALLOWED.format(*names)))

    def _related(self, subj: Element, obj: Element, wmi: WorldModelPort) -> list[str]:
        return [f"the ontology does not allow {subj.type} {self.relation} {obj.type}"]

    def _make_true(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        return False  # an effect cannot change the ontology

    def _relate(self, subj: Element, obj: Element) -> bool:
        return False


#: The class restrictions by which the ontology allows a relation; see `Ontology.allows`.
_ALLOWED = """SELECT ?filler WHERE {{
    {{ {0} rdfs:subClassOf* ?class }} UNION {{ ?class rdfs:subClassOf* {0} }}
    ?class rdfs:subClassOf ?restriction .
    ?restriction owl:onProperty ?relation .
    ?relation rdfs:subPropertyOf* {1} .
    ?restriction owl:someValuesFrom|owl:allValuesFrom|owl:onClass ?filler .
    {{ {2} rdfs:subClassOf* ?filler }} UNION {{ ?filler rdfs:subClassOf* {2} }}
}}"""


def _is_exactly(eid: str, etype: str, wmi: WorldModelPort) -> bool:
    """Whether an element of the scene has exactly that class."""
    if can_find_elements(wmi):
        found = wmi.find_element(eid)
        return found is not None and full_name(found.type) == full_name(etype)
    return eid.rpartition("-")[0] == full_name(etype)


def _set_relations(relations: Sequence[Any], state: bool, wmi: WorldModelPort) -> None:
    for relation in relations:
        wmi.set_relation(relation["src"], relation["type"], relation["dst"], state)


def _all_named(ids: Sequence[Any], wmi: WorldModelPort) -> list[str]:
    """The elements with these ids as text, at most `MAX_EXAMPLES`."""
    return ["the scene" if eid == SCENE_ROOT else _named([eid], wmi) for eid in ids[:MAX_EXAMPLES]]


def _named(ids: Iterable[str], wmi: WorldModelPort) -> str:
    """The elements with these ids, ordered, as text; of many, the first ones and the number of the rest."""
    ordered = sorted(set(ids), key=id_order)
    found = ((eid, wmi.find_element(eid)) for eid in ordered[:MAX_EXAMPLES])
    names = [repr(element) if element is not None else eid for eid, element in found]
    more = f" and {len(ordered) - MAX_EXAMPLES} more" if len(ordered) > MAX_EXAMPLES else ""
    return (", ".join(names) or "nothing") + more
