"""The world model interface for the reasoners of a server."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from skiros2_common.core.discrete_reasoner import DiscreteReasoner, reasoners
from skiros2_common.core.errors import Refused
from skiros2_common.core.names import full_name
from skiros2_common.core.operations import Change, Operation, Outcome, Relate
from skiros2_common.core.reasoner_registry import data_of
from skiros2_common.core.world_element import Element, Reasoner, RelationDict
from skiros2_world_model.core.local_world_model import LocalTransport
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.core.world_model_client import WorldModelClient

_Closure = Callable[[str], frozenset[str]]

_READER = "reasoner"

#: How long a reasoner waits for the lock before it uses the scene beside a `parse`, which may wait for it (s).
_LOCK_TIMEOUT = 0.2


class _ParsingTransport(LocalTransport):
    """The transport during `parse`: reads include the uncommitted request, and writes become part of it.

    Used under `Reasoning.parse_lock`.
    """

    def __init__(self, author: str, model: WorldModel) -> None:
        super().__init__(author, model)
        self.scene = model.reader_under(model.reasoning.parse_lock)

    def transact(self, operations: Sequence[Operation], context: str) -> Outcome:
        """Adds operations to the current request.

        :raises Refused: the request is being undone.
        """
        transaction = self._model.reasoning.transaction
        if transaction is None:
            raise Refused(f"{self.author}: another change is being undone; write again when `parse` has returned")
        return Outcome(transaction.include(operations, self._model.checks(self.author), self.author))


class _VisitingTransport(_ParsingTransport):
    """Same as `_ParsingTransport`, for threads other than that of `parse`: a write becomes a request of its own."""

    def transact(self, operations: Sequence[Operation], context: str) -> Outcome:
        """Applies operations for the rest of `parse`, and again after the current request.

        :raises Refused: the request is being undone.
        """
        return Outcome(self._model.reasoning.visit(operations, self._model.checks(self.author), self.author))


class ReasonerWorldModel:
    """The argument of a reasoner's `init`: reads and writes of the scene. Thread-safe.

    Each write names its author; a reasoner passes its own name. Every call may raise `WmException`.
    """

    def __init__(self, model: WorldModel) -> None:
        self._model = model
        self._clients: dict[str, list[WorldModelClient]] = {}  # by author: usual, during `parse`, beside it

    @property
    def guard(self) -> threading.RLock:
        """The lock of the world model; a thread that holds it sees one state of the scene."""
        return self._model.lock

    # -- reading -----------------------------------------------------------------------------------------------

    def get_element(self, eid: str) -> Element:
        """Returns the current state of an element.

        :raises WmException: it does not exist.
        """
        with self._as(_READER) as wm:
            return wm.get_element(eid)

    def find_element(self, eid: str) -> Element | None:
        """Returns the current state of an element, or None."""
        with self._as(_READER) as wm:
            return wm.find_element(eid)

    def get_recursive(self, eid: str, rel_filter: str = "", type_filter: str = "") -> dict[str, Element]:
        """Returns an element and its descendants by id, nearest first.

        :param rel_filter: follows this relation and its subproperties; "": all.
        :param type_filter: returns only descendants of this class or its subclasses; "": all.
        :raises WmException: the element does not exist.
        """
        found = {eid: self.get_element(eid)}
        with self._as(_READER) as wm:
            for element in wm.get_branch(eid, rel_filter, type_filter):
                found.setdefault(element.id, element)
        return found

    def resolve_elements(self, description: Element) -> list[Element]:
        """Returns the elements of the description's class or a subclass that have its label and property values."""
        with self._as(_READER) as wm:
            return wm.resolve_elements(description)

    def get_relations(self, relation: Mapping[str, Any]) -> list[RelationDict]:
        """Returns the relations that match a dict of `src`, `type` and `dst`; a missing part, "" and "-1" match any."""
        src, pred, dst = _parts(relation)
        with self._as(_READER) as wm:
            return wm.get_relations(src, pred, dst)

    def get_sub_classes(self, name: str) -> list[str]:
        """The class, followed by all its subclasses."""
        return _itself_first(name, self._model.ontology.subclasses)

    def get_sub_properties(self, name: str) -> list[str]:
        """The property, followed by all its subproperties."""
        return _itself_first(name, self._model.ontology.subproperties)

    def get_sub_relations(self, name: str) -> list[str]:
        """The relation, followed by all its subproperties."""
        return _itself_first(name, self._model.ontology.subproperties)

    def get_reasoner(self, name: str) -> Reasoner | None:
        """Returns the reasoner with a class name, or the one that owns a code, property or relation; None if it does
        not exist."""
        return reasoners.find(name)

    def query(self, query: str) -> list[str]:
        """Answers a SPARQL query with a text for each row."""
        with self._as(_READER) as wm:
            return wm.query_ontology(query)

    # -- writing -----------------------------------------------------------------------------------------------

    def add_element(self, e: Element, author: str) -> Element:
        """Adds an element, sets its id, and returns the new element."""
        with self._as(author) as wm:
            return wm.add_element(e)

    def update_element(self, e: Element, author: str) -> None:
        """Writes an element; see `WorldModelInterface.update_element`."""
        with self._as(author) as wm:
            wm.update_element(e)

    def update_elements(self, es: Sequence[Element], author: str) -> None:
        """Writes elements in one request, all or none."""
        with self._as(author) as wm:
            wm.update_elements(es)

    def update_properties(
        self, e: Element, author: str, reasoner: DiscreteReasoner | None = None, publish: bool = True
    ) -> None:
        """Writes the properties of an element, but not its relations.

        :param reasoner: writes only the properties that this reasoner owns.
        :param publish: no effect: every change is published.
        """
        keys = frozenset(map(full_name, data_of(reasoner))) if reasoner is not None else None
        with self._as(author) as wm:
            wm.write_properties(e, keys)

    def remove_element(self, e: Element | str, author: str) -> None:
        """Removes an element without its descendants.

        :param e: the element or its id.
        """
        with self._as(author) as wm:
            wm.remove_element(e, False)

    def remove_recursive(
        self, e: Element | str, author: str, rel_filter: str = "skiros:sceneProperty", type_filter: str = ""
    ) -> None:
        """Removes an element and its descendants along a relation that no other element holds.

        :param e: the element or its id.
        """
        with self._as(author) as wm:
            wm.remove_element(e, True, rel_filter, type_filter)

    def add_relation(self, relation: Mapping[str, Any], author: str, is_relation: bool = True) -> None:
        """Adds a relation, given as a dict with `src`, `type` and `dst`.

        :param is_relation: False: `type` is a property of the element `src`, and `dst` is added to its values.
        """
        src, pred, dst = _parts(relation)
        if is_relation:
            with self._as(author) as wm:
                wm.transact([Relate(src, pred, dst)])
        else:
            element = self.get_element(src)
            element.appendProperty(pred, dst)
            self.update_properties(element, author)

    def remove_relation(self, relation: Mapping[str, Any], author: str, is_relation: bool = True) -> None:
        """Removes relations; arguments as for `add_relation`. A missing part matches any."""
        src, pred, dst = _parts(relation)
        if is_relation:
            with self._as(_READER) as wm:
                gone = wm.transport.scene.related(src, pred, dst)
            with self._as(author) as wm:
                wm.transact([Relate(r["src"], r["type"], r["dst"], False) for r in gone])
        else:
            element = self.get_element(src)
            if element.hasProperty(pred, dst):
                element.getProperty(pred).removeValue(dst)
                self.update_properties(element, author)

    # -- changes -----------------------------------------------------------------------------------------------

    def add_listener(self, listener: Callable[[Change], None]) -> None:
        """Calls `listener` after each change, in order and under `guard`."""
        self._model.add_listener(listener)

    def remove_listener(self, listener: Callable[[Change], None]) -> None:
        """Removes a listener."""
        self._model.remove_listener(listener)

    @contextmanager
    def _as(self, author: str) -> Iterator[WorldModelClient]:
        """The world model for one call of an author: during `parse`, the one that includes the current request."""
        if author not in self._clients:
            transports = LocalTransport, _ParsingTransport, _VisitingTransport
            self._clients[author] = [WorldModelClient(transport(author, self._model)) for transport in transports]
        usual, parsing, visiting = self._clients[author]
        lock, reasoning = self._model.lock, self._model.reasoning
        while True:
            if lock.acquire(timeout=_LOCK_TIMEOUT):
                try:
                    if not reasoning.is_parsing:
                        yield usual
                    else:  # this thread is in `parse`
                        with reasoning.parse_lock:
                            yield parsing
                finally:
                    lock.release()
                return
            with reasoning.parse_lock:
                if reasoning.is_parsing:
                    yield visiting
                    return


def _parts(relation: Mapping[str, Any]) -> tuple[str, str, Any]:
    src, pred, dst = (relation.get(part) for part in ("src", "type", "dst"))
    src, dst = ("" if end in (None, "-1") else end for end in (src, dst))
    return src, full_name(pred) if pred else "", dst


def _itself_first(name: str, closure: _Closure) -> list[str]:
    name = full_name(name)
    return [name, *sorted(closure(name) - {name})]
