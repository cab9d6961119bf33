"""The world model port without ROS, in one process: for tests, notebooks and the server."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.changes import Change, Operation, Outcome, Statement
from skiros2_world_model.core.history import HistoryEntry, Point
from skiros2_world_model.core.last_will import CleanupAction
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.report import Report
from skiros2_world_model.core.scene import Provenance
from skiros2_world_model.core.validation import validate
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.core.world_model_abstract_interface import Revisions, WmException, refusal
from skiros2_world_model.core.world_model_client import WorldModelAbstractInterface


class LocalWorldModel(WorldModelAbstractInterface):
    """The port to a `WorldModel` in this process. Several ports may share one world model.

    :param author_name: the author of the changes.
    :param model: the world model; None: a new one with the ontologies of this package.
    """

    def __init__(self, author_name: str = "test", model: WorldModel | None = None) -> None:
        super().__init__()
        self.model = model if model is not None else WorldModel(source_ontologies())
        self._author = author_name

    @property
    def author(self) -> str:
        return self._author

    def is_connected(self) -> bool:
        """True: the world model is in this process."""
        return True

    def lock(self) -> bool:
        """Acquires the advisory lock of the world model; blocks until it is free. Returns True."""
        self.model.advisory_lock.acquire(self._author)
        return True

    def unlock(self) -> bool:
        """Releases the advisory lock. Returns False when it is not held."""
        return self.model.advisory_lock.release()

    def load(self, filename: str = "", context: str = "scene") -> bool:
        """Replaces a context with the content of a file of the workspace. Returns True.

        :raises WmException: the file is refused; the current content stays.
        """
        with _wm_errors():
            self.model.load(filename, self._author, context)
        return True

    def save(self, filename: str = "", context: str = "scene") -> bool:
        """Writes a context to a file of the workspace. Returns True."""
        with _wm_errors():
            self.model.save(filename, context)
        return True

    def get_scene_name(self) -> str:
        return self.model.file_of("scene")

    def set_last_will(self, actions: Sequence[CleanupAction]) -> None:
        """No effect: the world model ends with its process."""

    @property
    def version(self) -> int:
        return self.model.number

    def revisions(self) -> Revisions:
        with self.model.lock:
            return Revisions(self._ontology, self.model.scene().record_lookup)

    def add_listener(self, callback: Callable[[Change], None]) -> None:
        self.model.add_listener(callback)

    def remove_listener(self, callback: Callable[[Change], None]) -> None:
        self.model.remove_listener(callback)

    def set_monitor_cb(self, cb: Callable[[Change], None]) -> None:
        """Calls `cb(change)` after each change."""
        self.model.add_listener(cb)

    def find_element(self, eid: str, context_id: str = "scene") -> Element | None:
        with _wm_errors():
            return self.model.reader.find(eid, context_id)

    def refreshed(self, e: Element, context_id: str = "scene") -> Element | None:
        with _wm_errors():
            return self.model.reader.refreshed(e, context_id)

    def removal_of(self, eid: str, context_id: str = "scene") -> Provenance | None:
        with _wm_errors():
            return self.model.reader.removal(eid, context_id)

    # -- history -----------------------------------------------------------------------------------------------

    def history(
        self,
        eid: str = "",
        since: Point | None = None,
        until: Point | None = None,
        author: str = "",
        limit: int = 0,
        context_id: str = "scene",
    ) -> list[HistoryEntry]:
        with _wm_errors():
            return self.model.history.changes(eid, since, until, author, limit, context_id)

    def scene_at(self, at: Point, context_id: str = "scene") -> HistoryEntry:
        with _wm_errors():
            return self.model.history.scene_at(at, context_id)

    def difference(self, since: Point, until: Point | None = None, context_id: str = "scene") -> HistoryEntry:
        with _wm_errors():
            return self.model.history.difference(since, until, context_id)

    def validate(self, context_id: str = "scene") -> Report:
        """Validates the current state of a context against the ontologies and the shapes."""
        with _wm_errors():
            triples = self.model.triples(context_id)
            return validate(triples, f"context {context_id}", self.model.knowledge_base, context_id, self.model.strict)

    @property
    def _ontology(self) -> Ontology:
        return self.model.ontology

    def _query(self, query: str, cut_prefix: bool, context: str) -> list[str]:
        with _wm_errors():
            return self.model.query(query, context, cut_prefix)

    def _modify(self, statements: Sequence[Statement], context: str) -> None:
        with _wm_errors():
            self.model.modify(statements, self._author, context)

    def _scene_now(self) -> tuple[list[Element], str]:
        with self.model.lock:
            return self.get_scene_elements(), self.model.snapshot_id

    def _matching(self, wanted: Element, context: str) -> list[Element]:
        with _wm_errors():
            return self.model.reader.matching(wanted, context)

    def _branch(self, eid: str, relation_filter: str, type_filter: str, context: str) -> list[Element]:
        with _wm_errors():
            return self.model.reader.branch(eid, relation_filter, type_filter, context)

    def _related(self, src: str, pred: str, dst: str) -> list[RelationDict]:
        return self.model.related(src, pred, dst)

    def _holds(self, subj: Element, pred: str, obj: Element) -> bool:
        return self.model.reader.holds(subj, pred, obj, "scene")

    def _transact(self, operations: Sequence[Operation], context: str) -> Outcome:
        with _wm_errors():
            return self.model.transact(operations, self._author, context)

    def _template(self, name: str) -> Element:
        with _wm_errors():
            return self.model.template(name)


def source_ontologies() -> Path:
    """The folder of the ontologies in the source tree or install space of this file.

    :raises WmException: this file is in neither of them.
    """
    for folder in Path(__file__).resolve().parents:
        for ontologies in (folder / "ontologies", folder / "share" / "skiros2" / "ontologies"):
            if (ontologies / "skiros.ttl").is_file():
                return ontologies
    raise WmException(f"no ontologies folder found above {__file__}; pass the folder to WorldModel")


class _WmErrors:
    """Converts errors of the world model to `WmException`."""

    def __enter__(self) -> None:
        """No preparation."""

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if isinstance(error, SkirosError) and not isinstance(error, WmException):
            raise refusal(str(error), error.code, error.position) from error


_WM_ERRORS = _WmErrors()  # stateless, shared by all calls


def _wm_errors() -> _WmErrors:
    return _WM_ERRORS
