"""The client of a world model: one class for all transports."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from skiros2_common.core.changeset import ChangeSet
from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.names import full_name
from skiros2_common.core.operations import (
    SCENE,
    TEMPLATE,
    Apply,
    CleanupAction,
    Expect,
    Instantiate,
    Operation,
    Outcome,
    Relate,
    Remove,
)
from skiros2_common.core.reasoner_registry import data_of
from skiros2_common.core.world_element import REASONER_PROPERTY, Element, RelationDict
from skiros2_common.core.write_notes import note_write
from skiros2_world_model.core.changes import added_elements, remaining_changes, written, written_properties
from skiros2_world_model.core.history import HistoryEntry, Point
from skiros2_world_model.core.report import Report
from skiros2_world_model.core.scene_queries import SceneQueries, id_of
from skiros2_world_model.core.wm_errors import WmException, wm_errors


class WorldModelClient(SceneQueries):
    """A client of a world model: all calls of the port, over a transport. Thread-safe.

    Every call may raise `WmException` when the world model refuses or does not answer; then nothing has changed.
    Subjects and objects may be given as elements or as ids.
    """

    @property
    def author(self) -> str:
        """The author of this client's changes."""
        return self.transport.author

    # -- writing -------------------------------------------------------------------------------------------------

    def transact(self, operations: Sequence[Operation], context_id: str = SCENE) -> Outcome:
        """Applies operations (`skiros2_common.core.operations`) as one request, all or none.

        :raises WmConflict: an element of an `Expect` has changed since it was read.
        """
        with wm_errors():
            outcome = self.transport.transact(operations, context_id)
        note_write(operations)
        return outcome

    def set_last_will(self, actions: Sequence[CleanupAction]) -> None:
        """Sets the cleanup actions that the world model runs when the node of this process dies.

        They replace the node's previous last will. The last will of an earlier process of this node is run first.

        :param actions: the cleanup actions; none withdraws the last will.
        """
        with wm_errors():
            self.transport.server.set_last_will(actions)

    def add_elements(self, es: Sequence[Element], context_id: str = SCENE) -> list[Element]:
        """Adds elements and their local children, all or none. Returns the new elements.

        The given elements and children are updated with their ids and the changes of reasoners.
        """
        given, operations = added_elements(es, lambda eid: self._exists(eid, context_id))
        outcome = self.transact(operations, context_id)
        self._refresh(given, outcome, context_id)
        return [element.view() for element in es]

    def add_element(self, e: Element, context_id: str = SCENE) -> Element:
        """Adds an element and returns the new element; see `add_elements`."""
        return self.add_elements([e], context_id)[0]

    def update_element(self, e: Element, context_id: str = SCENE) -> str:
        """Writes an element and returns its id.

        Of an element that was read from a world model, only the changes since then are written. A hand-made element
        replaces the stored one: properties and relations that it lacks are removed. Local children are added.

        :raises WmException: the element does not exist.
        """
        return self.update_elements([e], context_id)[0]

    def update_elements(self, es: Sequence[Element], context_id: str = SCENE) -> list[str]:
        """Writes elements in one request and returns their ids; see `update_element`."""
        return self._write(es, context_id, ())

    def update_element_properties(self, e: Element, reasoner: str = "", context_id: str = SCENE) -> str:
        """Writes the properties of an element, but not its relations, and returns its id; see `update_element`.

        :param reasoner: writes only the properties that this reasoner owns.
        :raises WmException: the element or the reasoner does not exist.
        """
        return self.write_properties(e, self._keys_of(reasoner) if reasoner else None, context_id)

    def remove_element(
        self,
        e: Element | str,
        recursive: bool = True,
        rel_filter: str = "skiros:sceneProperty",
        type_filter: str = "",
        context_id: str = SCENE,
    ) -> int:
        """Removes an element, and with `recursive` its descendants along a relation that no other element holds.

        :param e: an element, whose id is cleared, or an id.
        :param type_filter: removes only descendants of this class; "": all.
        :returns: 1.
        :raises WmException: the element does not exist.
        """
        self.transact([Remove(id_of(e), recursive, rel_filter, type_filter)], context_id)
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
        context_id: str = SCENE,
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
        outcome = self.transact([request], context_id)
        return outcome.elements.get(outcome.ids[0]) or self.get_element(outcome.ids[0], context_id)

    def set_relation(self, subj: Element | str, pred: str, obj: Element | str, value: bool = True) -> bool:
        """Adds (`value` true) a relation, or removes it and its subproperties. Returns True.

        The relation is stored in the context of the subject.

        :param subj, obj: elements of any context, or individuals of the ontologies.
        :raises WmException: an element does not exist in any context, or would contain itself.
        """
        self.transact([Relate(id_of(subj), self._name(pred), id_of(obj), value)], SCENE)
        return True

    def update_elements_if_unchanged(self, es: Sequence[Element], context_id: str = SCENE) -> list[str]:
        """Writes elements as `update_elements` does, unless one of them has changed since it was read.

        :raises WmConflict: an element has changed; the text names the author and the time. Nothing was written.
        :raises WmException: an element was not read from the world model, or is refused. Nothing was written.
        """
        made_by_hand = [e for e in es if e.version < 0]
        if made_by_hand:
            raise WmException(f"{made_by_hand[0]!r} was not read from the world model, so it has no version to compare")
        return self._write(es, context_id, [Expect(e.id, e.version) for e in es])

    def update_element_if_unchanged(self, e: Element, context_id: str = SCENE) -> str:
        """Writes an element and returns its id; see `update_elements_if_unchanged`."""
        return self.update_elements_if_unchanged([e], context_id)[0]

    def revert(self, change: HistoryEntry | ChangeSet, context_id: str = SCENE) -> Outcome:
        """Undoes a change, such as an entry of `history`, in one request. Later changes of other parts stay.

        :raises WmConflict: parts of it have changed since; the text has all of them, with their authors. Nothing has
            changed.
        :raises WmException: the world model refuses the request, or does not answer.
        """
        change_set = change.changes if isinstance(change, HistoryEntry) else change
        return self.transact([Apply(change_set.inverse())], context_id)

    # -- history and validation ----------------------------------------------------------------------------------

    def history(
        self,
        eid: str = "",
        since: Point | None = None,
        until: Point | None = None,
        author: str = "",
        limit: int = 0,
        context_id: str = SCENE,
    ) -> list[HistoryEntry]:
        """The changes after one point and up to another: an entry for each request, oldest first.

        :param eid: only changes of this element; "": all.
        :param since: the number of a change (int) or a time (float, s since the epoch); None: the beginning.
        :param until: the end, in the same format; None: now.
        :param author: only changes by this author; "": all.
        :param limit: at most this number of entries, the latest ones; 0: all.
        :param context_id: the context; `ontology`: the statements of the ontologies.
        :raises WmException: no journal, an unknown element or context, or a point outside the journal.
        """
        with wm_errors():
            return self.transport.history.changes(eid, since, until, author, limit, context_id)

    def scene_at(self, at: Point, context_id: str = SCENE) -> HistoryEntry:
        """A past state of a context: `after` has its elements, each with its outgoing relations.

        :param at: as `since` in `history`. The other fields of the entry describe the change that led to this state.
        :raises WmException: as for `history`.
        """
        with wm_errors():
            return self.transport.history.scene_at(at, context_id)

    def difference(self, since: Point, until: Point | None = None, context_id: str = SCENE) -> HistoryEntry:
        """The difference of a context between two points: one entry, which is false when there is none.

        :param since, until: as for `history`.
        :raises WmException: as for `history`.
        """
        with wm_errors():
            return self.transport.history.difference(since, until, context_id)

    def last_change(self, eid: str) -> HistoryEntry:
        """The last change of an element, with its time (`stamp`) and its `author`.

        :raises WmException: the element does not exist, or the world model has no journal.
        """
        return self.history(eid, limit=1)[-1]

    def validate(self, context_id: str = SCENE) -> Report:
        """Validates the current state of a context against the ontologies and shapes. Takes a second or more.

        :raises WmException: a shape file is invalid.
        """
        with wm_errors():
            return self.transport.server.validate(context_id)

    # -- helpers -------------------------------------------------------------------------------------------------

    def _write(self, elements: Sequence[Element], context_id: str, before: Sequence[Operation]) -> list[str]:
        given, operations = written(elements, lambda eid: self._exists(eid, context_id))
        operations = [*before, *operations]
        if operations:
            outcome = self.transact(operations, context_id)
            self._refresh(given, Outcome(outcome.ids[len(before) :], outcome.changes), context_id)
        else:
            note_write(unchanged=[element.id for element in elements])
        changed = set(map(id, given))
        unchanged = [element for element in elements if id(element) not in changed]
        self._refresh(unchanged, Outcome([self._known(element, context_id) for element in unchanged]), context_id)
        return [element.id for element in elements]

    def write_properties(self, e: Element, keys: frozenset[str] | None, context_id: str = SCENE) -> str:
        """Writes properties of an element, but not its relations, and returns its id.

        :param keys: the properties to write; None: all. Changes of other ones stay in the element.
        :raises WmException: the element does not exist.
        """
        operations = written_properties(e, keys)
        if operations:
            outcome = self.transact(operations, context_id)
        else:
            outcome = Outcome([self._known(e, context_id)])
            note_write(unchanged=[e.id])
        remaining = remaining_changes(e, keys)
        self._refresh([e], outcome, context_id, keep_children=True)
        remaining.restore(e)
        return e.id

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
