"""An independent copy of a scene, on which plans and starts are simulated."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import NoReturn

from skiros2_common.core.operations import ONTOLOGY, REMOVE, SCENE, UPDATE, CleanupAction, Operation, Outcome, Statement
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.change_notifier import ChangeNotifier, PendingChange
from skiros2_world_model.core.checks import Checks
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.prefixes import Prefixes
from skiros2_world_model.core.queries import SceneReader
from skiros2_world_model.core.replica import scene_of
from skiros2_world_model.core.scene import ROOT, Scene
from skiros2_world_model.core.transaction import Transaction
from skiros2_world_model.core.transport import HistoryReads, Listener, SceneReads, ServerCalls, Transport
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model_client import WorldModelClient


class PreviewTransport:
    """The transport to a copy of a scene.

    :param source: the transport to the world model. Its scene is read once.
    :param strict: as for `PreviewCopy`.
    """

    author = "preview"

    def __init__(self, source: Transport, strict: bool) -> None:
        self._source = source
        self._strict = strict
        self._lock = threading.RLock()
        self._copy = scene_of(source.scene.matching(Element(), SCENE))
        self._notifier = ChangeNotifier(0, self.author)
        self._warned: set[tuple[str, str, str]] = set()
        self.scene: SceneReads = SceneReader(self._lock, self._scenes, lambda: self.ontology)
        self.server = _PreviewServer(source.server)

    def _scenes(self, context: str) -> list[Scene]:
        return [self._copy] if context in ("", SCENE) else []

    @property
    def history(self) -> HistoryReads:
        raise WmException("a copy of a scene has no history")

    @property
    def ontology(self) -> Ontology:
        return self._source.ontology

    @property
    def version(self) -> int:
        return self._notifier.number

    @property
    def snapshot_id(self) -> str:
        return self._notifier.snapshot_id

    def revisions(self) -> None:
        """None: a copy is used once."""

    def catch_up(self) -> None:
        """No effect: reads have every change."""

    def snapshot(self) -> tuple[list[Element], str]:
        with self._lock:
            return self.scene.branch(ROOT, "skiros:sceneProperty", "", SCENE), self._notifier.snapshot_id

    def subscribe(self, listener: Listener) -> None:
        self._notifier.add_listener(listener)

    def unsubscribe(self, listener: Listener) -> None:
        self._notifier.remove_listener(listener)

    def transact(self, operations: Sequence[Operation], context: str) -> Outcome:
        with self._lock:
            # Prefixes matter only for names that are IRIs; a scene has none.
            checks = Checks(self.ontology, Prefixes(), self.author, self._strict, self._warned)
            transaction = Transaction(self._copy, self.ontology, checks, self.author)
            self._copy.begin()
            try:
                ids = transaction.run(operations)
            except Exception:
                self._copy.roll_back()
                raise
            change_info = self._notifier.next(self.author)
            committed = self._copy.commit(change_info)
            changed = [eid for eid in committed.ids() if eid in self._copy]
            pending = [PendingChange(UPDATE, ids=changed), PendingChange(REMOVE, committed.removed())]
            return Outcome(ids, self._notifier.publish(pending, change_info, SCENE, self._copy))

    def modify(self, statements: Sequence[Statement], context: str) -> NoReturn:
        """:raises WmException: always."""
        raise WmException("a copy of a scene cannot change the ontologies")

    def load(self, filename: str, context: str) -> NoReturn:
        """:raises WmException: always."""
        raise WmException("a copy of a scene cannot load files")


class _PreviewServer:
    """The calls of a copy: the world model answers those that concern the ontologies only."""

    def __init__(self, source: ServerCalls) -> None:
        self._source = source

    def is_connected(self) -> bool:
        return True

    def is_shut_down(self) -> bool:
        return self._source.is_shut_down()

    def lock(self) -> bool:
        """True: a copy has one user."""
        return True

    def unlock(self) -> bool:
        """True: a copy has one user."""
        return True

    def save(self, filename: str, context: str) -> NoReturn:
        """:raises WmException: always."""
        raise WmException("a copy of a scene cannot be saved")

    def query(self, query: str, cut_prefix: bool, context: str) -> list[str]:
        self._check(context)
        return self._source.query(query, cut_prefix, context)

    def query_json(self, query: str, context: str) -> str:
        self._check(context)
        return self._source.query_json(query, context)

    def template(self, name: str) -> Element:
        return self._source.template(name)

    def validate(self, context: str) -> NoReturn:
        """:raises WmException: always."""
        raise WmException("a copy of a scene cannot be validated")

    def set_last_will(self, actions: Sequence[CleanupAction]) -> None:
        """No effect: the copy ends with its process."""

    def scene_name(self) -> str:
        return ""

    @staticmethod
    def _check(context: str) -> None:
        if context != ONTOLOGY:
            raise WmException("a copy of a scene can only query the ontologies")


class PreviewCopy(WorldModelClient):
    """A client of a copy of the scene of a world model. Neither sees later changes of the other.

    The copy checks and applies requests as the world model does, but without reasoners. It shares the ontologies of the
    world model and cannot change them.

    :param wm: the world model. Its scene is read once.
    :param strict: whether unknown names, and relations between wrong classes, are refused.
    :raises WmException: the world model does not answer.
    """

    def __init__(self, wm: WorldModelClient, strict: bool = False) -> None:
        super().__init__(PreviewTransport(wm.transport, strict))
