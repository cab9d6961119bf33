"""What both adapters of the world model do alike."""

from __future__ import annotations

import itertools
import logging
from abc import abstractmethod
from collections.abc import Collection, Iterator, Sequence
from typing import Any

from skiros2_common.core.discrete_reasoner import DiscreteReasoner, reasoners
from skiros2_common.core.names import full_name
from skiros2_common.core.world_element import REASONER_PROPERTY, Element, RelationDict
from skiros2_world_model.core.changes import Instantiate, Operation, Outcome, Relate, Remove, relation_dict
from skiros2_world_model.core.coordination import Coordination
from skiros2_world_model.core.ontology_client import OntologyAbstractInterface
from skiros2_world_model.core.present import Present
from skiros2_world_model.core.queries import describes
from skiros2_world_model.core.reader import no_element
from skiros2_world_model.core.requests import added_elements, changes_left, written, written_properties
from skiros2_world_model.core.scene import ROOT
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

    @abstractmethod
    def _matching(self, wanted: Element, context: str) -> list[Element]:
        """The elements like an abstract one."""

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
        """The id of the scene's root."""
        return ROOT

    def get_scene(self) -> list[Element]:
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

    def add_elements(self, es: Sequence[Element], context_id: str = _SCENE) -> list[str]:
        """Adds elements with the children that were kept aside in them, all or none.

        Each element, and each child, gets its id and what reasoners added. Returns the ids of the elements.
        """
        given, operations = added_elements(es, lambda eid: self.find_element(eid, context_id) is not None)
        outcome = self._transact(operations, context_id)
        self._refresh(given, outcome, context_id)
        return [element.id for element in es]

    def add_element(self, e: Element, context_id: str = _SCENE) -> str:
        """Adds an element, as `add_elements`, and returns its id."""
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
        keys = self._keys_of(reasoner) if reasoner else None
        operations = written_properties(e, keys)
        outcome = self._transact(operations, context_id) if operations else Outcome([self._known(e, context_id)])
        left = changes_left(e, keys)
        self._refresh([e], outcome, context_id, keep_children=True)
        left.put_back(e)
        return e.id

    def remove_element(
        self,
        e: Element,
        recursive: bool = True,
        rel_filter: str = "skiros:sceneProperty",
        type_filter: str = "",
        context_id: str = _SCENE,
    ) -> None:
        """Removes an element, and with `recursive` what is under it along a relation and is held by nothing else.

        :param type_filter: only elements of this class are taken with it; "" takes all.
        :raises WmException: there is no element of that id.
        """
        self._transact([Remove(_id(e), recursive, rel_filter, type_filter)], context_id)

    def instanciate(
        self,
        uri: str,
        recursive: bool = False,
        relations: Sequence[RelationDict] = list(),  # noqa: C408 - the contract's default, never changed
        relation_filter: Sequence[str] = ["skiros:hasA", "skiros:contain"],
        antiloop_bind: Collection[str] = set(),
        context_id: str = _SCENE,
    ) -> Element:
        """Copies a template into the scene, in one change, and returns the copy.

        :param uri: the individual's name.
        :param recursive: copies what it is related to by the relations of the filter, too.
        :param relations: relations of the copy, as dicts; "-1" is the copy.
        :param antiloop_bind: individuals that are not copied again.
        :raises WmException: there is no such individual.
        """
        request = Instantiate(
            self._name(uri), recursive, list(relations), list(relation_filter), frozenset(antiloop_bind)
        )
        outcome = self._transact([request], context_id)
        return outcome.elements.get(outcome.ids[0]) or self.get_element(outcome.ids[0], context_id)

    # -- relations ---------------------------------------------------------------------------------------------

    def set_relation(self, subj: Any, pred: str, obj: Any, value: bool = True) -> bool:
        """Adds (`value` true) or removes a relation; also the relations under it are removed. Returns True.

        :raises WmException: an element does not exist, or the scene would contain itself.
        """
        self._transact([Relate(_id(subj), self._name(pred), _id(obj), value)], _SCENE)
        return True

    def get_relations(self, subj: Any, pred: str, obj: Any) -> list[RelationDict]:
        """The relations whose predicate is that one or under it, as dicts; an empty part matches any.

        A relation that a reasoner owns is asked of it.
        """
        if pred and self._computes(pred) is not None:
            return self.get_reasoner_relations(subj, pred, obj)
        return self._related(_id(subj), self._name(pred) if pred else "", _id(obj))

    def get_reasoner(self, pred: str) -> DiscreteReasoner | None:
        """The reasoner called so, or that owns that code, property or relation; None when none does."""
        return reasoners.find_written(pred)

    def get_reasoner_relations(self, subj: Any, pred: str, obj: Any) -> list[RelationDict]:
        """The relations that a reasoner computes between two elements, as dicts.

        :param subj, obj: elements or ids; an abstract element stands for all elements like it.
        :param pred: the relation, or a reasoner's name for all of its relations.
        :raises WmException: no reasoner owns that.
        """
        reasoner = self.get_reasoner(pred)
        if reasoner is None:
            raise WmException(f"no reasoner is called or owns {pred!r}; loaded: {', '.join(reasoners.names())}")
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
        :param abstract: asks whether the ontologies allow it: by restrictions of the classes, or between templates.
        """
        subj, obj = self._element(subj), self._element(obj)
        pred = self._name(pred)
        if abstract:
            return self._allowed(subj, pred, obj) == state
        if self._computes(pred) is not None:
            return bool(self.get_reasoner_relations(subj, pred, obj)) == state
        return self._holds(subj, pred, obj) == state

    def _resolve_elements2(
        self, keys: Sequence[str], ph: Any, verbose: bool = False
    ) -> dict[tuple[str, ...], list[tuple[Element, ...]]]:
        """What some parameters may be: for the keys together, every combination of elements of the scene.

        :param keys: one key or several.
        :param ph: the parameters; one that holds an element of the scene stays as it is.
        """
        names = (keys,) if isinstance(keys, str) else tuple(keys)
        choices: list[list[Element]] = []
        for key in names:
            param = ph.getParam(key)
            value = param.value if param.value is not None else param.default
            if not isinstance(value, Element):
                choices.append([])
            else:
                choices.append(self._matching(value, _SCENE) if value.isAbstract() else [value])
            if verbose:
                log.info("%s may be: %s", key, choices[-1])
        return {names: list(itertools.product(*choices))}

    # -- shared ------------------------------------------------------------------------------------------------

    def _write(self, elements: Sequence[Element], context_id: str, before: Sequence[Operation]) -> list[str]:
        given, operations = written(elements, lambda eid: self.find_element(eid, context_id) is not None)
        operations = [*before, *operations]
        if operations:
            outcome = self._transact(operations, context_id)
            self._refresh(given, Outcome(outcome.ids[len(before) :], outcome.changes), context_id)
        unchanged = [element for element in elements if element not in given]
        self._refresh(unchanged, Outcome([self._known(element, context_id) for element in unchanged]), context_id)
        return [element.id for element in elements]

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

    def _allowed(self, subj: Element, pred: str, obj: Element) -> bool:
        """Whether the ontologies allow a relation between two elements, or have it between their templates."""
        if obj.label and self._ontology.individuals_related(subj.label, pred, obj.label):
            return True
        if subj.id and obj.label and self._related(subj.id, pred, obj.label):
            return True
        return self._ontology.allows(self._name(subj.type), pred, self._name(obj.type))

    def _computes(self, pred: str) -> DiscreteReasoner | None:
        """The reasoner that computes a relation, if one does."""
        reasoner = self.get_reasoner(pred)
        if reasoner is None or full_name(pred) not in map(full_name, reasoner.getAssociatedRelations()):
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
        found = self.get_reasoner(reasoner)
        if found is None:
            raise WmException(f"there is no reasoner {reasoner!r}; loaded: {', '.join(reasoners.names()) or 'none'}")
        return frozenset([*found.getAssociatedData(), REASONER_PROPERTY])

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


def _id(given: Any) -> str:
    return given.id if isinstance(given, Element) else str(given or "")
