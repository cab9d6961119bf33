"""The world model port without ROS, in one process: for tests, notebooks and the server."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.changes import Change, Operation, Outcome, Statement
from skiros2_world_model.core.history import HistoryEntry, Point
from skiros2_world_model.core.last_will import CleanupAction
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.queries import SceneReader
from skiros2_world_model.core.report import Report
from skiros2_world_model.core.validation import validate
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.core.world_model_abstract_interface import Revisions, WmException, wm_errors
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
        return True

    def lock(self) -> bool:
        self.model.advisory_lock.acquire(self._author)
        return True

    def unlock(self) -> bool:
        return self.model.advisory_lock.release()

    def load(self, filename: str = "", context: str = "scene") -> bool:
        with wm_errors():
            self.model.load(filename, self._author, context)
        return True

    def save(self, filename: str = "", context: str = "scene") -> bool:
        with wm_errors():
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
        with wm_errors():
            return self.model.history.changes(eid, since, until, author, limit, context_id)

    def scene_at(self, at: Point, context_id: str = "scene") -> HistoryEntry:
        with wm_errors():
            return self.model.history.scene_at(at, context_id)

    def difference(self, since: Point, until: Point | None = None, context_id: str = "scene") -> HistoryEntry:
        with wm_errors():
            return self.model.history.difference(since, until, context_id)

    def validate(self, context_id: str = "scene") -> Report:
        with wm_errors():
            triples = self.model.triples(context_id)
            return validate(triples, f"context {context_id}", self.model.knowledge_base, context_id, self.model.strict)

    @property
    def _ontology(self) -> Ontology:
        return self.model.ontology

    def _local(self, context: str) -> SceneReader:
        return self.model.reader

    def _query(self, query: str, cut_prefix: bool, context: str) -> list[str]:
        with wm_errors():
            return self.model.query(query, context, cut_prefix)

    def _query_json(self, query: str, context: str) -> str:
        with wm_errors():
            return self.model.query_json(query, context)

    def _modify(self, statements: Sequence[Statement], context: str) -> None:
        with wm_errors():
            self.model.modify(statements, self._author, context)

    def get_scene(self) -> tuple[list[Element], str]:
        with self.model.lock:
            return self.get_scene_elements(), self.model.snapshot_id

    def _related(self, src: str, pred: str, dst: str) -> list[RelationDict]:
        return self.model.related(src, pred, dst)

    def transact(self, operations: Sequence[Operation], context_id: str = "scene") -> Outcome:
        with wm_errors():
            return self.model.transact(operations, self._author, context_id)

    def _template(self, name: str) -> Element:
        with wm_errors():
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
