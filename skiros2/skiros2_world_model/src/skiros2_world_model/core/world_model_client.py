"""What both adapters of the world model do alike."""

from __future__ import annotations

import logging
from abc import abstractmethod
from collections.abc import Collection, Iterator, Sequence
from typing import Any

from skiros2_common.core.discrete_reasoner import DiscreteReasoner, data_of, reasoners, relations_of
from skiros2_common.core.names import full_name
from skiros2_common.core.world_element import REASONER_PROPERTY, Element, RelationDict
from skiros2_world_model.core.changes import TEMPLATE, Instantiate, Operation, Outcome, Relate, Remove, relation_dict
from skiros2_world_model.core.combinations import combinations
from skiros2_world_model.core.coordination import Coordination
from skiros2_world_model.core.ontology_client import OntologyAbstractInterface
from skiros2_world_model.core.present import Present
from skiros2_world_model.core.queries import describes
from skiros2_world_model.core.reader import no_element
from skiros2_world_model.core.requests import added_elements, changes_left, written, written_properties
from skiros2_world_model.core.scene import ROOT, Provenance
from skiros2_world_model.core.world_model_abstract_interface import WmException

log = logging.getLogger(__name__)

_SCENE = "scene"


class WorldModelAbstractInterface(OntologyAbstractInterface, Coordination):
    """The calls on the world model, made of those that the adapters define. Safe to use from all threads.

    Every call may raise `WmException`: the world model does not answer, or refuses; nothing has changed then. Where a
    subject or object is asked for, an element or an id will do.
    """

    # -- what adapters define ----------------------------------------------------------------------------------

    @property
    @abstractmethod
    def version(self) -> int:
        """Changes whenever something that a condition may read may have changed; -1: not known, always read anew."""

    def present(self) -> Present | None:
        """What tells whether an element is the same later; None: not known, it may have changed at any time."""
        return None

    def catch_up(self) -> None:
        """Makes sure that what is read from here on is no older than this call. Blocks for a call of the server.

        For requests of others: who sends one may just have changed the world it speaks of.
        """

    @abstractmethod
    def find_element(self, eid: str, context_id: str = _SCENE) -> Element | None:
        """The element as it is now, or None when there is none of that id."""

    def refreshed(self, e: Element, context_id: str = _SCENE) -> Element | None:
        """The given element if the world model has not changed it since it was read, else as `find_element`."""
        return self.find_element(e.id, context_id)

    def removal_of(self, eid: str, context_id: str = _SCENE) -> Provenance | None:
        """The author, the time and the number of the change that removed an element, also by loading another scene.

        None: the element exists, or its removal is not known. Reads memory where `find_element` does.
        """
        return None

    @abstractmethod
    def _matching(self, wanted: Element, context: str) -> list[Element]:
        """The elements like an abstract one."""

    @abstractmethod
    def _scene_now(self) -> tuple[list[Element], str]:
        """The root of the scene and everything under it, and the snapshot id of that state."""

    @abstractmethod
    def _branch(self, eid: str, relation_filter: str, type_filter: str, context: str) -> list[Element]:
        """An element and what is under it."""

    @abstractmethod
    def _related(self, src: str, pred: str, dst: str) -> list[RelationDict]:
        """The relations of the scene along a predicate and those under it; an empty part matches any."""

    @abstractmethod
    def _template(self, name: str) -> Element:
        """A template as an element without id."""

    # -- reading -----------------------------------------------------------------------------------------------

    def get_scene_name(self) -> str:
        """The name of the file with which the world model started, relative to its workspace; "" for none."""
        return ""

    def get_scene(self) -> tuple[list[Element], str]:
        """The root of the scene and everything under it, and the snapshot id of that state."""
        return self._scene_now()

    def get_scene_elements(self) -> list[Element]:
        """The root of the scene and everything under it."""
        return self.get_branch(ROOT)

    def is_scene_element(self, eid: str) -> bool:
        """Whether the scene has an element of that id."""
        return self.find_element(eid) is not None

    def get_element(self, eid: str, context_id: str = _SCENE) -> Element:
        """The element as it is now.

        :raises WmException: there is none of that id.
        """
        found = self.find_element(eid, context_id)
        if found is None:
            raise WmException(no_element(eid, context_id))
        return found

    def get_template_element(self, uri: str, context_id: str = _SCENE) -> Element:
        """A template (an individual of the ontologies) as an element without id.

        :raises WmException: there is none.
        """
        return self._template(self._name(uri))

    def get_branch(
        self,
        eid: str,
        relation_filter: str = "skiros:sceneProperty",
        type_filter: str = "",
        context_id: str = _SCENE,
    ) -> list[Element]:
        """An element and what is under it along a relation and those under that one, nearest first.

        :param type_filter: only elements of this class or under it; "" takes all.
        :raises WmException: there is no element of that id.
        """
        return self._branch(_id(eid), relation_filter, type_filter, context_id)

    def resolve_elements(self, e: Element, context_id: str = _SCENE) -> list[Element]:
        """All elements of the class of `e` or under it, with its label (if it has one) and its property values.

        A value that is "" or None matches any.
        """
        return self._matching(e, context_id)

    def resolve_element(self, e: Element, context_id: str = _SCENE) -> Element | None:
        """The first of `resolve_elements`, or None."""
        return next(iter(self._matching(e, context_id)), None)

    # -- writing -----------------------------------------------------------------------------------------------

    def add_elements(self, es: Sequence[Element], context_id: str = _SCENE) -> list[Element]:
        """Adds elements with the children that were kept aside in them, all or none. Returns the new elements.

        Each given element, and each child, gets its id and what reasoners added, too.
        """
        given, operations = added_elements(es, lambda eid: self._exists(eid, context_id))
        outcome = self._transact(operations, context_id)
        self._refresh(given, outcome, context_id)
        return [element.view() for element in es]

    def add_element(self, e: Element, context_id: str = _SCENE) -> Element:
        """Adds an element, as `add_elements`, and returns the new element."""
        return self.add_elements([e], context_id)[0]

    def update_element(self, e: Element, context_id: str = _SCENE) -> str:
        """Writes an element and returns its id.

        Of an element that a world model gave out, what was changed since is written; one made by hand is written
        whole: properties and relations that it does not have are removed. Children kept aside are added.

        :raises WmException: there is no element of that id.
        """
        return self.update_elements([e], context_id)[0]

    def update_elements(self, es: Sequence[Element], context_id: str = _SCENE) -> list[str]:
        """Writes some elements, as `update_element`, all or none in one change; returns their ids."""
        return self._write(es, context_id, ())

    def update_element_properties(self, e: Element, reasoner: str = "", context_id: str = _SCENE) -> str:
        """Writes the properties of an element as `update_element` does, and leaves its relations; returns its id.

        :param reasoner: writes the properties that this reasoner owns, and no others.
        :raises WmException: there is no element of that id, or no such reasoner.
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
        """Removes an element, and with `recursive` what is under it along a relation and is held by nothing else.

        :param e: an element, which loses its id, or an id.
        :param type_filter: only elements of this class are taken with it; "" takes all.
        :returns: 1.
        :raises WmException: there is no element of that id.
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
        """Copies a template into the scene, in one change, and returns the copy.

        :param uri: the individual's name, or an element of that template.
        :param recursive: copies what it is related to by the relations of the filter, too.
        :param relations: relations of the copy, as dicts; "-1" is the copy.
        :param antiloop_bind: individuals that are not copied again.
        :raises WmException: there is no such individual.
        """
        name = uri.value_of(TEMPLATE) or uri.label if isinstance(uri, Element) else uri
        request = Instantiate(
            self._name(name), recursive, list(relations), list(relation_filter), frozenset(antiloop_bind)
        )
        outcome = self._transact([request], context_id)
        return outcome.elements.get(outcome.ids[0]) or self.get_element(outcome.ids[0], context_id)

    # -- relations ---------------------------------------------------------------------------------------------

    def set_relation(self, subj: Any, pred: str, obj: Any, value: bool = True) -> bool:
        """Adds (`value` true) or removes a relation; also its subproperties are removed. Returns True.

        It is kept in the context of the subject.

        :param subj, obj: elements of any context, or individuals of the ontologies.
        :raises WmException: an element does not exist in any context, or the scene would contain itself.
        """
        self._transact([Relate(_id(subj), self._name(pred), _id(obj), value)], _SCENE)
        return True

    def get_relations(self, subj: Any, pred: str, obj: Any) -> list[RelationDict]:
        """The relations whose predicate is that one or under it, as dicts; an empty part matches any.

        Where subject and object are given, they are the subject's own: `src` is "-1". A relation that a reasoner owns
        is asked of it.
        """
        if pred and self._computes(pred) is not None:
            found = self.get_reasoner_relations(subj, pred, obj)
        else:
            found = self._related(_id(subj), self._name(pred) if pred else "", _id(obj))
        return [{**r, "src": "-1"} for r in found] if _id(subj) and _id(obj) else found

    def get_reasoner(self, pred: str) -> DiscreteReasoner:
        """The reasoner called so, or that owns that code, property or relation.

        :raises UnknownName: there is none.
        """
        return reasoners.get(pred)

    def get_reasoner_relations(self, subj: Any, pred: str, obj: Any) -> list[RelationDict]:
        """The relations that a reasoner computes between two elements, as dicts.

        :param subj, obj: elements or ids; an abstract element stands for all elements like it.
        :param pred: the relation, or a reasoner's name for all of its relations.
        :raises UnknownName: no reasoner owns that.
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
        """Whether a relation, or one under it, holds (`state` true) or does not hold.

        :param subj, obj: elements or ids; an abstract element stands for some element of its class.
        :param abstract: asks whether the relation is stated anywhere between the two elements or their templates
            (`skiros:Template`); of an element with neither id nor name, whether the class restrictions allow it.
        """
        subj, obj = self._element(subj), self._element(obj)
        pred = self._name(pred)
        if abstract:
            return self._stated(subj, pred, obj) == state
        if self._computes(pred) is not None:
            return bool(self.get_reasoner_relations(subj, pred, obj)) == state
        return self._holds(subj, pred, obj) == state

    def allows_relation(self, subject_type: str, pred: str, object_type: str) -> bool:
        """Whether the ontologies have a restriction by which a class may be so related to another."""
        return self._ontology.allows(*map(self._name, (subject_type, pred, object_type)))

    def _resolve_elements2(
        self, keys: str | Sequence[str], ph: Any, verbose: bool = False
    ) -> dict[str | tuple[str, ...], Any]:
        """The elements that some parameters may have together, so that the relations between them hold.

        A parameter may have any element like its abstract one; a parameter with an element of the scene keeps it. A
        relation noted on an abstract element names the key of another parameter, or an id.

        :param keys: one key or several.
        :returns: an array of elements under the key; for several an array of rows under the tuple of the keys.
        """
        names = (keys,) if isinstance(keys, str) else tuple(keys)
        found = combinations(self, names, ph)
        if verbose:
            log.info("%s may be: %s", ", ".join(names), found.tolist())
        return {names[0]: found[:, 0]} if len(names) == 1 else {names: found}

    # -- shared ------------------------------------------------------------------------------------------------

    def _write(self, elements: Sequence[Element], context_id: str, before: Sequence[Operation]) -> list[str]:
        given, operations = written(elements, lambda eid: self._exists(eid, context_id))
        operations = [*before, *operations]
        if operations:
            outcome = self._transact(operations, context_id)
            self._refresh(given, Outcome(outcome.ids[len(before) :], outcome.changes), context_id)
        unchanged = [element for element in elements if element not in given]
        self._refresh(unchanged, Outcome([self._known(element, context_id) for element in unchanged]), context_id)
        return [element.id for element in elements]

    def _write_properties(self, e: Element, keys: frozenset[str] | None, context_id: str) -> str:
        operations = written_properties(e, keys)
        outcome = self._transact(operations, context_id) if operations else Outcome([self._known(e, context_id)])
        left = changes_left(e, keys)
        self._refresh([e], outcome, context_id, keep_children=True)
        left.put_back(e)
        return e.id

    def _exists(self, eid: str, context_id: str) -> bool:
        """Whether an id is an element of a context, or of any other one."""
        return self.find_element(eid, context_id) is not None or self.find_element(eid, "") is not None

    def _elements_of(self, cls: str, recursive: bool) -> list[str]:
        return [e.id for e in self._matching(Element(cls), _SCENE) if recursive or e.type == cls]

    def _holds(self, subj: Element, pred: str, obj: Element) -> bool:
        """Whether a relation of the scene, or one under it, holds."""
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
        """Whether a relation is stated between two elements or their templates; see `check_relation`."""
        ones, others = _individuals(subj), _individuals(obj)
        if not ones or not others:
            return self.allows_relation(subj.type, pred, obj.type)
        return any(
            self._ontology.individuals_related(one, pred, other) or bool(self._related(one, pred, other))
            for one in ones
            for other in others
        )

    def _computes(self, pred: str) -> DiscreteReasoner | None:
        """The reasoner that computes a relation, if one does."""
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
        """Makes the caller's elements, those that the outcome's ids are of, what the world model has now."""
        told = outcome.elements
        for element, eid in zip(elements, outcome.ids, strict=True):
            fresh = told.get(eid) or self.find_element(eid, context)
            if fresh is None:
                element._id = eid  # it is gone again
            else:
                element.adopt(fresh, keep_children)


def _individuals(element: Element) -> list[str]:
    """The names by which statements know an element: its template's, and its id.

    An element without id goes by its label, if it does not say what template it is of.
    """
    template = element.value_of("skiros:Template") or ("" if element.id else element.label)
    return [full_name(str(name)) for name in (template, element.id) if name]


def _id(given: Any) -> str:
    return given.id if isinstance(given, Element) else str(given or "")
