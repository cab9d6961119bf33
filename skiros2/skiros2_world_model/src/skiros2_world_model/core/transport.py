"""The transport of a world model client: the primitives by which it reads and changes a world model.

Adapters: `LocalTransport` (in process), `RosTransport` (over ROS), `ReplicaTransport` (in front of one of these),
`PreviewTransport` (a copy of the scene), and those of reasoners (`reasoner_world_model.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from skiros2_common.core.operations import SCENE, Change, CleanupAction, Operation, Outcome, Statement
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_common.core.world_model_port import Revisions
from skiros2_world_model.core.history import HistoryEntry, Point
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.replica import Snapshot
from skiros2_world_model.core.report import Report
from skiros2_world_model.core.scene import ChangeInfo

Listener = Callable[[Change], None]


class SceneReads(Protocol):
    """Reads of scenes. Thread-safe. An element that is returned is a copy. Every call may raise `SkirosError`.

    `SceneReader` is the one for scenes in this process.
    """

    def find(self, eid: str, context: str) -> Element | None:
        """Returns the current state of an element, or None when it does not exist."""

    def refreshed(self, element: Element, context: str) -> Element | None:
        """Returns the given element if it has not changed since it was read, else the result of `find`."""

    def removal(self, eid: str, context: str) -> ChangeInfo | None:
        """Returns the change that removed an element; None: the element exists, or its removal is unknown."""

    def matching(self, wanted: Element, context: str) -> list[Element]:
        """Returns the elements that match an abstract element."""

    def branch(self, eid: str, relation_filter: str, type_filter: str, context: str) -> list[Element]:
        """Returns an element and its descendants along a relation and its subproperties, nearest first.

        :raises SkirosError: the element does not exist.
        """

    def related(self, src: str, pred: str, dst: str) -> list[RelationDict]:
        """Returns the relations along a predicate and its subproperties; an empty part matches any.

        Searches the context of the subject; the scene when no subject is given.
        """

    def holds(self, subj: Element, pred: str, obj: Element) -> bool:
        """Returns whether a relation of the scene holds; a side without id stands for any matching element."""


class HistoryReads(Protocol):
    """Reads of past states and changes; see the calls of the same names of `WorldModelClient`."""

    def changes(
        self,
        eid: str = "",
        since: Point | None = None,
        until: Point | None = None,
        author: str = "",
        limit: int = 0,
        context: str = SCENE,
    ) -> list[HistoryEntry]: ...
    def scene_at(self, at: Point, context: str = SCENE) -> HistoryEntry: ...
    def difference(self, since: Point, until: Point | None = None, context: str = SCENE) -> HistoryEntry: ...


class ServerCalls(Protocol):
    """Calls that the world model itself answers, whatever the client has in memory; see `WorldModelClient`."""

    def is_connected(self) -> bool: ...
    def is_shut_down(self) -> bool:
        """Returns whether this process is shutting down."""

    def lock(self) -> bool: ...
    def unlock(self) -> bool: ...
    def save(self, filename: str, context: str) -> None: ...
    def query(self, query: str, cut_prefix: bool, context: str) -> list[str]:
        """Answers a SPARQL query with a text for each row."""

    def query_json(self, query: str, context: str) -> str:
        """Answers a SPARQL query in the SPARQL JSON format."""

    def template(self, name: str) -> Element:
        """Returns a template as an element without id."""

    def validate(self, context: str) -> Report: ...
    def set_last_will(self, actions: Sequence[CleanupAction]) -> None: ...
    def scene_name(self) -> str: ...


class Transport(Protocol):
    """The primitives of a client. Thread-safe. A client reads what it has written. Calls may raise `SkirosError`."""

    @property
    def author(self) -> str:
        """The author of the changes."""

    @property
    def scene(self) -> SceneReads: ...
    @property
    def history(self) -> HistoryReads: ...
    @property
    def server(self) -> ServerCalls: ...
    @property
    def ontology(self) -> Ontology:
        """The index of the current ontologies."""

    @property
    def version(self) -> int:
        """A counter that changes when anything that a condition reads may have changed; -1: unknown, do not cache."""

    @property
    def snapshot_id(self) -> str:
        """The name of the state that reads have; "": unknown."""

    def revisions(self) -> Revisions | None:
        """Returns the current revisions of the ontologies and elements; None: unknown, do not cache."""

    def catch_up(self) -> None:
        """Waits until reads are at least as new as the world model's state at this call."""

    def snapshot(self) -> tuple[list[Element], str]:
        """Returns the root of the scene and its descendants, and the snapshot id of that state."""

    def subscribe(self, listener: Listener) -> None:
        """Calls `listener` after each change, in order, when reads have it."""

    def unsubscribe(self, listener: Listener) -> None: ...
    def transact(self, operations: Sequence[Operation], context: str) -> Outcome:
        """Applies operations as one request, all or none."""

    def modify(self, statements: Sequence[Statement], context: str) -> None:
        """Adds and removes RDF statements, all or none."""

    def load(self, filename: str, context: str) -> None:
        """Replaces a context with the content of a file."""


class RemoteTransport(Transport, Protocol):
    """A transport whose scene can be replicated."""

    @property
    def ontology_version(self) -> int:
        """A counter that increases with every possible change of the ontologies."""

    def fetch(self) -> Snapshot:
        """Fetches the whole scene."""
