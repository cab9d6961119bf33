"""The transport of a client that keeps a replica of the scene, so that reads of the scene need no calls."""

from __future__ import annotations

from collections.abc import Sequence

from skiros2_common.core.operations import ONTOLOGY, SCENE, Operation, Outcome, Statement
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_common.core.world_model_port import Revisions
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.queries import SceneReader
from skiros2_world_model.core.replica import Replica
from skiros2_world_model.core.scene import ROOT, ChangeInfo
from skiros2_world_model.core.transport import HistoryReads, Listener, RemoteTransport, SceneReads
from skiros2_world_model.core.wm_errors import WmConflict


class ReplicaTransport:
    """Reads the scene from a replica, and passes everything else to another transport.

    :param remote: the transport to the world model.
    """

    def __init__(self, remote: RemoteTransport) -> None:
        self.remote = remote
        self.replica = Replica(remote.fetch)
        self.author = remote.author
        self.scene: SceneReads = _ReplicaScene(self.replica, remote)
        self.server = remote.server
        remote.subscribe(self.replica.follow)  # the first listener: later ones read what they are notified of

    @property
    def history(self) -> HistoryReads:
        return self.remote.history

    @property
    def ontology(self) -> Ontology:
        return self.remote.ontology

    @property
    def version(self) -> int:
        return self.replica.version + self.remote.ontology_version

    @property
    def snapshot_id(self) -> str:
        return self.replica.snapshot_id

    def revisions(self) -> Revisions:
        ontology = self.ontology
        self.replica.refresh()
        return self.replica.scene().revisions(ontology)

    def catch_up(self) -> None:
        self.replica.reach(self.remote.snapshot_id)

    def snapshot(self) -> tuple[list[Element], str]:
        self.replica.refresh()
        with self.replica.lock:
            return self.scene.branch(ROOT, "skiros:sceneProperty", "", SCENE), self.replica.snapshot_id

    def subscribe(self, listener: Listener) -> None:
        self.remote.subscribe(listener)

    def unsubscribe(self, listener: Listener) -> None:
        self.remote.unsubscribe(listener)

    def transact(self, operations: Sequence[Operation], context: str) -> Outcome:
        try:
            outcome = self.remote.transact(operations, context)
        except WmConflict:
            self.catch_up()  # a retry must read the conflicting change
            raise
        self.replica.include(outcome.changes)
        return outcome

    def modify(self, statements: Sequence[Statement], context: str) -> None:
        self.remote.modify(statements, context)
        if context not in ("", ONTOLOGY):
            self.catch_up()

    def load(self, filename: str, context: str) -> None:
        self.remote.load(filename, context)
        self.catch_up()


class _ReplicaScene:
    """The reads of a replica. Contexts other than the scene are read by calls."""

    def __init__(self, replica: Replica, remote: RemoteTransport) -> None:
        self._replica = replica
        self._reader = SceneReader(replica.lock, lambda _: [replica.scene()], lambda: remote.ontology)
        self._remote = remote.scene

    def _of(self, context: str) -> SceneReads:
        if context != SCENE:
            return self._remote
        self._replica.refresh()
        return self._reader

    def find(self, eid: str, context: str) -> Element | None:
        if context != SCENE:
            return self._remote.find(eid, context)
        self._replica.refresh()
        return self._reader.find(eid, context)

    def refreshed(self, element: Element, context: str) -> Element | None:
        return self._of(context).refreshed(element, context)

    def removal(self, eid: str, context: str) -> ChangeInfo | None:
        return self._of(context).removal(eid, context)

    def matching(self, wanted: Element, context: str) -> list[Element]:
        return self._of(context).matching(wanted, context)

    def branch(self, eid: str, relation_filter: str, type_filter: str, context: str) -> list[Element]:
        return self._of(context).branch(eid, relation_filter, type_filter, context)

    def related(self, src: str, pred: str, dst: str) -> list[RelationDict]:
        self._replica.refresh()
        if src and not self._reader.has(src, SCENE):
            return self._remote.related(src, pred, dst)
        return self._reader.related(src, pred, dst, SCENE)

    def holds(self, subj: Element, pred: str, obj: Element) -> bool:
        self._replica.refresh()
        return self._reader.holds(subj, pred, obj)
