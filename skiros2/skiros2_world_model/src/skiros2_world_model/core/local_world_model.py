"""A client of a world model in the same process, without ROS: for tests, notebooks and the server."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from skiros2_common.core.operations import SCENE, CleanupAction, Operation, Outcome, Statement
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import Revisions
from skiros2_world_model.core.history import History
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.report import Report
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.core.transport import Listener, SceneReads
from skiros2_world_model.core.validation import validate
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.core.world_model_client import WorldModelClient


class LocalTransport:
    """The transport to a `WorldModel` in this process.

    :param author: the author of the changes.
    """

    def __init__(self, author: str, model: WorldModel) -> None:
        self.author = author
        self.scene: SceneReads = model.reader
        self.server = LocalServer(author, model)
        self._model = model

    @property
    def history(self) -> History:
        return self._model.history

    @property
    def ontology(self) -> Ontology:
        return self._model.ontology

    @property
    def version(self) -> int:
        return self._model.number

    @property
    def snapshot_id(self) -> str:
        return self._model.snapshot_id

    def revisions(self) -> Revisions:
        with self._model.lock:
            return self._model.scene().revisions(self.ontology)

    def catch_up(self) -> None:
        """No effect: reads have every change."""

    def snapshot(self) -> tuple[list[Element], str]:
        with self._model.lock:
            return self.scene.branch(ROOT, "skiros:sceneProperty", "", SCENE), self._model.snapshot_id

    def subscribe(self, listener: Listener) -> None:
        self._model.add_listener(listener)

    def unsubscribe(self, listener: Listener) -> None:
        self._model.remove_listener(listener)

    def transact(self, operations: Sequence[Operation], context: str) -> Outcome:
        return self._model.transact(operations, self.author, context)

    def modify(self, statements: Sequence[Statement], context: str) -> None:
        self._model.modify(statements, self.author, context)

    def load(self, filename: str, context: str) -> None:
        self._model.load(filename, self.author, context)


class LocalServer:
    """The calls that a `WorldModel` in this process answers.

    :param author: the holder of the advisory lock.
    """

    def __init__(self, author: str, model: WorldModel) -> None:
        self._author = author
        self._model = model

    def is_connected(self) -> bool:
        return True

    def is_shut_down(self) -> bool:
        return False

    def lock(self) -> bool:
        self._model.advisory_lock.acquire(self._author)
        return True

    def unlock(self) -> bool:
        return self._model.advisory_lock.release()

    def save(self, filename: str, context: str) -> None:
        self._model.save(filename, context)

    def query(self, query: str, cut_prefix: bool, context: str) -> list[str]:
        return self._model.query(query, context, cut_prefix)

    def query_json(self, query: str, context: str) -> str:
        return self._model.query_json(query, context)

    def template(self, name: str) -> Element:
        return self._model.template(name)

    def validate(self, context: str) -> Report:
        model = self._model
        return validate(model.triples(context), f"context {context}", model.knowledge_base, context, model.strict)

    def set_last_will(self, actions: Sequence[CleanupAction]) -> None:
        """No effect: the world model ends with its process."""

    def scene_name(self) -> str:
        return self._model.file_of(SCENE)


class LocalWorldModel(WorldModelClient):
    """A client of a `WorldModel` in this process. Several clients may share one world model.

    :param author_name: the author of the changes.
    :param model: the world model; None: a new one with the ontologies of this package.
    """

    def __init__(self, author_name: str = "test", model: WorldModel | None = None) -> None:
        self.model = model if model is not None else WorldModel(source_ontologies())
        super().__init__(LocalTransport(author_name, self.model))


def source_ontologies() -> Path:
    """The folder of the ontologies in the source tree or install space of this file.

    :raises WmException: this file is in neither of them.
    """
    for folder in Path(__file__).resolve().parents:
        for ontologies in (folder / "ontologies", folder / "share" / "skiros2" / "ontologies"):
            if (ontologies / "skiros.ttl").is_file():
                return ontologies
    raise WmException(f"no ontologies folder found above {__file__}; pass the folder to WorldModel")
