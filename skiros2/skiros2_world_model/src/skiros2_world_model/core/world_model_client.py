"""The calls that both adapters of the world model share."""

from __future__ import annotations

import logging
from abc import abstractmethod
from collections.abc import Collection, Iterator, Sequence
from typing import Any

from skiros2_common.core.discrete_reasoner import DiscreteReasoner, data_of, reasoners, relations_of
from skiros2_common.core.errors import UnknownName
from skiros2_common.core.names import full_name
from skiros2_common.core.world_element import REASONER_PROPERTY, Element, RelationDict
from skiros2_world_model.core.changes import (
    TEMPLATE,
    Instantiate,
    Operation,
    Outcome,
    Relate,
    Remove,
    added_elements,
    relation_dict,
    remaining_changes,
    written,
    written_properties,
)
from skiros2_world_model.core.coordination import Coordination
from skiros2_world_model.core.ontology_client import OntologyAbstractInterface
from skiros2_world_model.core.queries import combinations, describes, no_element
from skiros2_world_model.core.scene import ROOT, Provenance
from skiros2_world_model.core.world_model_abstract_interface import Revisions, WmException

log = logging.getLogger(__name__)

_SCENE = "scene"


class WorldModelAbstractInterface(OntologyAbstractInterface, Coordination):
    """The world model port, built on the primitives that an adapter defines. Thread-safe.

    Every call may raise `WmException` when the world model refuses or does not answer; then nothing has changed.
    Subjects and objects may be given as elements or as ids.
    """

    # -- defined by the adapter --------------------------------------------------------------------------------

    @property
    @abstractmethod
    def version(self) -> int:
        """A counter that changes when anything that a condition reads may have changed; -1: unknown, do not cache."""

    def revisions(self) -> Revisions | None:
        """The current revisions of the ontologies and elements; None: unknown, do not cache."""
        return None

    def catch_up(self) -> None:
        """Waits until reads are at least as new as the server's state at this call. Blocks for one service call.

        Call it before handling a request of another node, which may refer to its latest changes.
        """

    @abstractmethod
    def find_element(self, eid: str, context_id: str = _SCENE) -> Element | None:
        """Returns the current state of an element, or None when it does not exist."""

    def refreshed(self, e: Element, context_id: str = _SCENE) -> Element | None:
        """Returns the given element if it has not changed since it was read, else the result of `find_element`."""
        return self.find_element(e.id, context_id)

    def removal_of(self, eid: str, context_id: str = _SCENE) -> Provenance | None:
        """Returns the provenance of an element's removal, which may be the load of another scene.

        :returns: None when the element exists or its removal is unknown.
        """
        return None

    @abstractmethod
    def _matching(self, wanted: Element, context: str) -> list[Element]:
        """The elements that match an abstract element."""

    @abstractmethod
    def _scene_now(self) -> tuple[list[Element], str]:
        """The root of the scene and its descendants, and the snapshot id of that state."""

    @abstractmethod
    def _branch(self, eid: str, relation_filter: str, type_filter: str, context: str) -> list[Element]:
        """An element and its descendants."""

    @abstractmethod
    def _related(self, src: str, pred: str, dst: str) -> list[RelationDict]:
        """The relations along a predicate and its subproperties; an empty part matches any."""

    @abstractmethod
    def _template(self, name: str) -> Element:
        """Returns a template as an element without id."""

    # -- reading -----------------------------------------------------------------------------------------------

    def get_scene_name(self) -> str:
        """The scene file with which the world model started, relative to its workspace; "": none."""
        return ""

    def get_scene(self) -> tuple[list[Element], str]:
        """Returns the root of the scene and its descendants, and the snapshot id of that state."""
        return self._scene_now()

    def get_scene_elements(self) -> list[Element]:
        """Returns the root of the scene and its descendants."""
        return self.get_branch(ROOT)

    def is_scene_element(self, eid: str) -> bool:
        """Whether the scene has an element."""
        return self.find_element(eid) is not None

    def get_element(self, eid: str, context_id: str = _SCENE) -> Element:
        """Returns the current state of an element.

        :raises WmException: it does not exist.
        """
        found = self.find_element(eid, context_id)
        if found is None:
            raise WmException(no_element(eid, context_id), UnknownName.code)
        return found

    def get_template_element(self, uri: str, context_id: str = _SCENE) -> Element:
        """Returns a template (an individual of the ontologies) as an element without id.

        :raises WmException: it does not exist.
        """
        return self._template(self._name(uri))

    def get_branch(
        self,
        eid: str,
        relation_filter: str = "skiros:sceneProperty",
        type_filter: str = "",
        context_id: str = _SCENE,
    ) -> list[Element]:
        """Returns an element and its descendants along a relation and its subproperties, nearest first.

        :param type_filter: returns only elements of this class or its subclasses; "": all.
        :raises WmException: the element does not exist.
        """
        return self._branch(_id(eid), relation_filter, type_filter, context_id)

    def resolve_elements(self, e: Element, context_id: str = _SCENE) -> list[Element]:
        """Returns the elements of the class of `e` or its subclasses that have its label and its property values.

        An empty label, and a value "" or None, matches any.
        """
        return self._matching(e, context_id)

    def resolve_element(self, e: Element, context_id: str = _SCENE) -> Element | None:
        """Returns the first result of `resolve_elements`, or None."""
        return next(iter(self._matching(e, context_id)), None)

    # -- writing -----------------------------------------------------------------------------------------------

    def add_elements(self, es: Sequence[Element], context_id: str = _SCENE) -> list[Element]:
        """Adds elements and their local children, all or none. Returns the new elements.

        The given elements and children are updated with their ids and the changes of reasoners.
        """
        given, operations = added_elements(es, lambda eid: self._exists(eid, context_id))
        outcome = self._transact(operations, context_id)
        self._refresh(given, outcome, context_id)
        return [element.view() for element in es]

    def add_element(self, e: Element, context_id: str = _SCENE) -> Element:
        """Adds an element and returns the new element; see `add_elements`."""
        return self.add_elements([e], context_id)[0]

    def update_element(self, e: Element, context_id: str = _SCENE) -> str:
        """Writes an element and returns its id.

        Of an element that was read from a world model, only the changes since then are written. A hand-made element
        replaces the stored one: properties and relations that it lacks are removed. Local children are added.

        :raises WmException: the element does not exist.
        """
        return self.update_elements([e], context_id)[0]

    def update_elements(self, es: Sequence[Element], context_id: str = _SCENE) -> list[str]:
        """Writes elements in one request and returns their ids; see `update_element`."""
        return self._write(es, context_id, ())

    def update_element_properties(self, e: Element, reasoner: str = "", context_id: str = _SCENE) -> str:
        """Writes the properties of an element, but not its relations, and returns its id; see `update_element`.

        :param reasoner: writes only the properties that this reasoner owns.
        :raises WmException: the element or the reasoner does not exist.
        """
        return self._write_properties(e, self._keys_of(reasoner) if reasoner else None, context_id)

    def remove_element(
        self,
        e: Element | str,
        recursive: bool = True,
        rel_filter: str = "skiros:sceneProperty",
        type_filter: str = "",
        context_id: str = _SCENE,
    ) -> int:
        """Removes an element, and with `recursive` its descendants along a relation that no other element holds.

        :param e: an element, whose id is cleared, or an id.
        :param type_filter: removes only descendants of this class; "": all.
        :returns: 1.
        :raises WmException: the element does not exist.
        """
        self._transact([Remove(_id(e), recursive, rel_filter, type_filter)], context_id)
        if isinstance(e, Element):
            e._id = ""
        return 1

    def instanciate(
        self,
        uri: str | Element,
        recursive: bool = False,
        relations: Sequence[RelationDict] = list(),  # noqa: C408 - the contract's default, never changed
        relation_filter: Sequence[str] = ["skiros:hasA", "skiros:contain"],
        antiloop_bind: Collection[str] = set(),
        context_id: str = _SCENE,
    ) -> Element:
        """Copies a template into the scene in one request and returns the copy.

        :param uri: the individual's name, or an element of that template.
        :param recursive: also copies individuals that it is related to by the relations of the filter.
        :param relations: relations of the copy, as dicts; "-1" is the copy.
        :param antiloop_bind: individuals that are not copied again.
        :raises WmException: the individual does not exist.
        """
        name = uri.value_of(TEMPLATE) or uri.label if isinstance(uri, Element) else uri
        request = Instantiate(
            self._name(name), recursive, list(relations), list(relation_filter), frozenset(antiloop_bind)
        )
        outcome = self._transact([request], context_id)
        return outcome.elements.get(outcome.ids[0]) or self.get_element(outcome.ids[0], context_id)

    # -- relations ---------------------------------------------------------------------------------------------

    def set_relation(self, subj: Any, pred: str, obj: Any, value: bool = True) -> bool:
        """Adds (`value` true) a relation, or removes it and its subproperties. Returns True.

        The relation is stored in the context of the subject.

        :param subj, obj: elements of any context, or individuals of the ontologies.
        :raises WmException: an element does not exist in any context, or would contain itself.
        """
        self._transact([Relate(_id(subj), self._name(pred), _id(obj), value)], _SCENE)
        return True

    def get_relations(self, subj: Any, pred: str, obj: Any) -> list[RelationDict]:
        """Returns the relations along a predicate and its subproperties, as dicts; an empty part matches any.

        When both subject and object are given, `src` is "-1" in the result. Relations that a reasoner owns are computed
        by it.
        """
        if pred and self._computes(pred) is not None:
            found = self.get_reasoner_relations(subj, pred, obj)
        else:
            found = self._related(_id(subj), self._name(pred) if pred else "", _id(obj))
        return [{**r, "src": "-1"} for r in found] if _id(subj) and _id(obj) else found

    def get_reasoner(self, pred: str) -> DiscreteReasoner:
        """Returns the reasoner with a class name, or the one that owns a code, property or relation.

        :raises UnknownName: it does not exist.
        """
        return reasoners.get(pred)

    def get_reasoner_relations(self, subj: Any, pred: str, obj: Any) -> list[RelationDict]:
        """Computes relations between two elements with a reasoner; returns them as dicts.

        :param subj, obj: elements or ids; an abstract element stands for all matching elements.
        :param pred: the relation, or the name of a reasoner for all of its relations.
        :raises UnknownName: no reasoner owns the relation.
        """
        reasoner = reasoners.get(pred)
        by_name = pred == reasoner.__class__.__name__
        return [
            relation_dict(one.id, name, other.id)
            for one, other in self._pairs(subj, obj)
            for name in reasoner.computeRelations(one, other)
            if by_name or full_name(name) == full_name(pred)
        ]

    def check_relation(self, subj: Any, pred: str, obj: Any, state: bool, abstract: bool) -> bool:
        """Whether a relation or one of its subproperties holds (`state` true) or does not hold.

        :param subj, obj: elements or ids; an abstract element stands for any matching element.
        :param abstract: checks whether the relation is stated between the elements or their templates
            (`skiros:Template`); for an element without id and name, whether the class restrictions allow it.
        """
        subj, obj = self._element(subj), self._element(obj)
        pred = self._name(pred)
        if abstract:
            return self._stated(subj, pred, obj) == state
        if self._computes(pred) is not None:
            return bool(self.get_reasoner_relations(subj, pred, obj)) == state
        return self._holds(subj, pred, obj) == state

    def allows_relation(self, subject_type: str, pred: str, object_type: str) -> bool:
        """Whether the class restrictions of the ontologies allow a relation between two classes."""
        return self._ontology.allows(*map(self._name, (subject_type, pred, object_type)))

    def _resolve_elements2(
        self, keys: str | Sequence[str], ph: Any, verbose: bool = False
    ) -> dict[str | tuple[str, ...], Any]:
        """Returns the combinations of elements that several parameters may take, so that their relations hold.

        A parameter with an abstract element takes any matching element; one with an element of the scene keeps it.
        Relations of an abstract element refer to other parameters by key, or to elements by id.

        :param keys: one key or several.
        :returns: an array of elements under the key; for several keys an array of rows under the tuple of keys.
        """
        names = (keys,) if isinstance(keys, str) else tuple(keys)
        found = combinations(self, names, ph)
        if verbose:
            log.info("%s may be: %s", ", ".join(names), found.tolist())
        return {names[0]: found[:, 0]} if len(names) == 1 else {names: found}

    # -- helpers -----------------------------------------------------------------------------------------------

    def _write(self, elements: Sequence[Element], context_id: str, before: Sequence[Operation]) -> list[str]:
        given, operations = written(elements, lambda eid: self._exists(eid, context_id))
        operations = [*before, *operations]
        if operations:
            outcome = self._transact(operations, context_id)
            self._refresh(given, Outcome(outcome.ids[len(before) :], outcome.changes), context_id)
        changed = set(map(id, given))
        unchanged = [element for element in elements if id(element) not in changed]
        self._refresh(unchanged, Outcome([self._known(element, context_id) for element in unchanged]), context_id)
        return [element.id for element in elements]

    def _write_properties(self, e: Element, keys: frozenset[str] | None, context_id: str) -> str:
        operations = written_properties(e, keys)
        outcome = self._transact(operations, context_id) if operations else Outcome([self._known(e, context_id)])
        remaining = remaining_changes(e, keys)
        self._refresh([e], outcome, context_id, keep_children=True)
        remaining.restore(e)
        return e.id

    def _exists(self, eid: str, context_id: str) -> bool:
        """Whether an element exists in a context, or in any other one."""
        return self.find_element(eid, context_id) is not None or self.find_element(eid, "") is not None

    def _elements_of(self, cls: str, recursive: bool) -> list[str]:
        return [e.id for e in self._matching(Element(cls), _SCENE) if recursive or e.type == cls]

    def _holds(self, subj: Element, pred: str, obj: Element) -> bool:
        """Whether a relation of the scene or one of its subproperties holds."""
        if not subj.id and not obj.id:
            return any(self._holds(found, pred, obj) for found in self._matching(subj, _SCENE))
        for relation in self._related(subj.id, pred, obj.id):
            if subj.id and obj.id:
                return True
            other, wanted = (relation["dst"], obj) if subj.id else (relation["src"], subj)
            found = self.find_element(other)
            if found is not None and describes(self._ontology, wanted, found.type, found.label, found._props):
                return True
        return False

    def _stated(self, subj: Element, pred: str, obj: Element) -> bool:
        """Implements `check_relation` with `abstract`."""
        ones, others = _individuals(subj), _individuals(obj)
        if not ones or not others:
            return self.allows_relation(subj.type, pred, obj.type)
        return any(
            self._ontology.individuals_related(one, pred, other) or bool(self._related(one, pred, other))
            for one in ones
            for other in others
        )

    def _computes(self, pred: str) -> DiscreteReasoner | None:
        """The reasoner that computes a relation; None when no reasoner does."""
        reasoner = reasoners.find_or_load(pred)
        if reasoner is None or full_name(pred) not in map(full_name, relations_of(reasoner)):
            return None
        return reasoner

    def _pairs(self, subj: Any, obj: Any) -> Iterator[tuple[Element, Element]]:
        for one in self._like(subj):
            for other in self._like(obj):
                if one.id != other.id:
                    yield one, other

    def _like(self, wanted: Any) -> list[Element]:
        element = self._element(wanted)
        return self._matching(element, _SCENE) if element.isAbstract() else [element]

    def _element(self, given: Any) -> Element:
        if isinstance(given, Element):
            return given
        return self.get_element(given) if given else Element("")

    def _known(self, e: Element, context: str) -> str:
        return self.get_element(e.id, context).id

    def _keys_of(self, reasoner: str) -> frozenset[str]:
        found = reasoners.find_or_load(reasoner)
        if found is None:
            raise WmException(f"there is no reasoner {reasoner!r}; loaded: {', '.join(reasoners.names()) or 'none'}")
        return frozenset([*map(full_name, data_of(found)), REASONER_PROPERTY])

    def _refresh(
        self, elements: Sequence[Element], outcome: Outcome, context: str, keep_children: bool = False
    ) -> None:
        """Updates the caller's elements, one for each id of the outcome, to their current state."""
        written_elements = outcome.elements
        for element, eid in zip(elements, outcome.ids, strict=True):
            fresh = written_elements.get(eid) or self.find_element(eid, context)
            if fresh is None:
                element._id = eid  # removed meanwhile
            else:
                element.adopt(fresh, keep_children)


def _individuals(element: Element) -> list[str]:
    """The names of an element in RDF statements: its template and its id.

    For an element without id and template, its label.
    """
    template = element.value_of("skiros:Template") or ("" if element.id else element.label)
    return [full_name(str(name)) for name in (template, element.id) if name]


def _id(given: Any) -> str:
    return given.id if isinstance(given, Element) else str(given or "")
