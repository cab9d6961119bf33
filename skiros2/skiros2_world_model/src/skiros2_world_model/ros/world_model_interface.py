"""The adapter of the world model port over ROS, with or without a replica of the scene."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Any

import rospy

from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.errors import FOREIGN_ERRORS, UnknownName
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_common.ros.reasoners import available_reasoners
from skiros2_common.ros.utils import element2msg, msg2relation
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.changes import ONTOLOGY, Change, Operation, Outcome, Statement, snapshot_number
from skiros2_world_model.core.history import HistoryEntry, Point
from skiros2_world_model.core.last_will import CleanupAction
from skiros2_world_model.core.queries import SceneReader, describes
from skiros2_world_model.core.replica import Replica, Snapshot
from skiros2_world_model.core.report import Finding, Report
from skiros2_world_model.core.scene import ROOT, Provenance
from skiros2_world_model.core.world_model_abstract_interface import Revisions, WmConflict, WmException, wm_errors
from skiros2_world_model.core.world_model_client import WorldModelAbstractInterface
from skiros2_world_model.ros.last_will import last_will_request
from skiros2_world_model.ros.ontology_interface import OntologyInterface
from skiros2_world_model.ros.parameters import text_list
from skiros2_world_model.ros.service_pool import LONG_ANSWER, ServicePool
from skiros2_world_model.ros.wire import history_request, msg2change, msg2entry, msg2shared_element, operation2msg

__all__ = ["Element", "WmConflict", "WmException", "WorldModelInterface"]

log = logging.getLogger(__name__)

_SCENE = "scene"


class WorldModelInterface(OntologyInterface, WorldModelAbstractInterface):
    """The world model node `wm` in this node's namespace. The constructor blocks until the server answers.

    :param author_name: the author of the changes.
    :param make_cache: keeps a replica of the scene, so that reads need no service calls.
    """

    def __init__(self, author_name: str = "test", make_cache: bool = False) -> None:
        self._get_service = ServicePool(f"{self._server}/get", srvs.WmGet)
        self._relations_service = ServicePool(f"{self._server}/scene/query_relations", srvs.WmQueryRelations)
        self._transaction_service = ServicePool(f"{self._server}/transaction", srvs.WmTransaction)
        self._snapshot_service = ServicePool(f"{self._server}/snapshot", srvs.WmSnapshot)
        self._history_service = ServicePool(f"{self._server}/history", srvs.WmHistory, answer_timeout=LONG_ANSWER)
        validation = f"{self._server}/validation"
        self._validation_service = ServicePool(validation, srvs.WmValidation, answer_timeout=LONG_ANSWER)
        self._last_will_service = ServicePool(f"{self._server}/last_will", srvs.WmLastWill)
        self._listeners: list[Callable[[Change], None]] = []
        self._monitor_cb: Callable[[msgs.WmMonitor], None] | None = None
        self._replica = Replica(self._fetch_scene) if make_cache else None
        if self._replica is not None:
            replica = self._replica
            self._reader = SceneReader(replica.lock, lambda _: [replica.scene()], lambda: self._ontology)
        super().__init__(author_name)

    @property
    def author(self) -> str:
        return self._author_name

    @property
    def version(self) -> int:
        return self._replica.version + self._ontology_changes if self._replica is not None else -1

    @property
    def last_change_number(self) -> int:
        """The number of the last known change of the scene; 0 if it is unknown, and without a replica."""
        if self._replica is None:
            return 0
        with self._replica.lock:
            known = self._replica.snapshot_id
        return snapshot_number(known) if known else 0

    @property
    def session(self) -> str:
        """Names the scene's line of changes: it stays if the server recovers the scene; "" without a replica."""
        if self._replica is None:
            return ""
        self._replica.refresh()
        with self._replica.lock:
            return self._replica.snapshot_id.partition("-")[0]

    def revisions(self) -> Revisions | None:
        if self._replica is None:
            return None
        ontology = self._ontology
        self._replica.refresh()
        return Revisions(ontology, self._replica.scene().record_lookup)

    def catch_up(self) -> None:
        if self._replica is not None:
            # No element has this label: only the snapshot id of the answer is needed.
            nothing = msgs.WmElement(type="skiros:Scene", label="(none)")
            answer = self._get_service.call(srvs.WmGetRequest(srvs.WmGetRequest.RESOLVE, _SCENE, nothing, "", ""))
            self._replica.reach(answer.snapshot_id)

    def load(self, filename: str = "", context: str = _SCENE) -> bool:
        loaded = super().load(filename, context)
        self.catch_up()
        return loaded

    def get_scene_name(self) -> str:
        return str(rospy.get_param(f"{self._server}/init_scene", ""))

    def set_monitor_cb(self, cb: Callable[[msgs.WmMonitor], None] | None) -> None:
        """Calls `cb(message)` with each `WmMonitor`, in the thread of the subscription. None removes the callback."""
        self._monitor_cb = cb

    def add_listener(self, callback: Callable[[Change], None]) -> None:
        self._listeners = [*self._listeners, callback]

    def remove_listener(self, callback: Callable[[Change], None]) -> None:
        self._listeners = [known for known in self._listeners if known != callback]

    def find_element(self, eid: str, context_id: str = _SCENE) -> Element | None:
        if self._is_local(context_id):
            return self._local(context_id).find(eid, context_id)
        try:
            return self._get(srvs.WmGetRequest.GET, context_id, msgs.WmElement(id=eid))[0]
        except WmException as error:
            if error.code == UnknownName.code:
                return None
            raise

    def refreshed(self, e: Element, context_id: str = _SCENE) -> Element | None:
        if self._is_local(context_id):
            return self._local(context_id).refreshed(e, context_id)
        return self.find_element(e.id, context_id)

    def removal_of(self, eid: str, context_id: str = _SCENE) -> Provenance | None:
        if self._is_local(context_id):
            return super().removal_of(eid, context_id)
        try:
            entries = self.history(eid, limit=1, context_id=context_id)
        except WmException:
            return None  # no journal, or the element never existed
        gone = [entry for entry in entries if entry.before and not entry.after]
        return Provenance(gone[0].number, gone[0].stamp, gone[0].author) if gone else None

    def set_last_will(self, actions: Sequence[CleanupAction]) -> None:
        self._last_will_service.call(last_will_request(actions))

    def history(
        self,
        eid: str = "",
        since: Point | None = None,
        until: Point | None = None,
        author: str = "",
        limit: int = 0,
        context_id: str = _SCENE,
    ) -> list[HistoryEntry]:
        request = history_request("changes", context_id, since, until, eid, author, limit)
        return [msg2entry(m) for m in self._history_service.call(request).entries]

    def scene_at(self, at: Point, context_id: str = _SCENE) -> HistoryEntry:
        request = history_request("scene", context_id, until=at)
        return msg2entry(self._history_service.call(request).entries[0])

    def difference(self, since: Point, until: Point | None = None, context_id: str = _SCENE) -> HistoryEntry:
        request = history_request("difference", context_id, since, until)
        return msg2entry(self._history_service.call(request).entries[0])

    def validate(self, context_id: str = _SCENE) -> Report:
        answer = self._validation_service.call(srvs.WmValidationRequest(context_id))
        findings = [Finding(m.severity, m.file, m.element, m.property, m.text) for m in answer.findings]
        return Report(f"context {context_id}", findings, answer.stamp.to_sec())

    # -- the primitives of `WorldModelAbstractInterface` -------------------------------------------------------

    def get_scene(self) -> tuple[list[Element], str]:
        if self._replica is not None:
            reader = self._local(_SCENE)
            with self._replica.lock:
                return reader.branch(ROOT, "skiros:sceneProperty", "", _SCENE), self._replica.snapshot_id
        request = srvs.WmGetRequest(
            srvs.WmGetRequest.GET_RECURSIVE, _SCENE, msgs.WmElement(id=ROOT), "skiros:sceneProperty", ""
        )
        answer = self._get_service.call(request)
        return _given(answer), str(answer.snapshot_id)

    def _matching(self, wanted: Element, context: str) -> list[Element]:
        if self._is_local(context):
            return super()._matching(wanted, context)
        return self._get(srvs.WmGetRequest.RESOLVE, context, element2msg(wanted))

    def _branch(self, eid: str, relation_filter: str, type_filter: str, context: str) -> list[Element]:
        if self._is_local(context):
            return super()._branch(eid, relation_filter, type_filter, context)
        asked = msgs.WmElement(id=eid)
        return self._get(srvs.WmGetRequest.GET_RECURSIVE, context, asked, relation_filter, type_filter)

    def _related(self, src: str, pred: str, dst: str) -> list[RelationDict]:
        if self._is_local(_SCENE) and (not src or self._local(_SCENE).has(src, _SCENE)):
            return self._local(_SCENE).related(src, pred, dst, _SCENE)
        request = srvs.WmQueryRelationsRequest(msgs.Relation(src, pred, dst))
        return [msg2relation(m) for m in self._relations_service.call(request).matches]

    def _holds(self, subj: Element, pred: str, obj: Element) -> bool:
        if self._is_local(_SCENE):
            return super()._holds(subj, pred, obj)
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

    def _template(self, name: str) -> Element:
        return self._get(srvs.WmGetRequest.GET_TEMPLATE, _SCENE, msgs.WmElement(label=name))[0]

    def _modify(self, statements: Sequence[Statement], context: str) -> None:
        super()._modify(statements, context)
        if context not in ("", ONTOLOGY):
            self.catch_up()

    def transact(self, operations: Sequence[Operation], context_id: str = "scene") -> Outcome:
        with wm_errors():
            messages = [operation2msg(o) for o in operations]
        request = srvs.WmTransactionRequest(self._author_name, context_id, messages)
        try:
            response = self._transaction_service.call(request, repeatable=False)
        except WmConflict:
            self.catch_up()  # a retry must read the conflicting change
            raise
        outcome = Outcome(list(response.ids), [msg2change(m, context_id) for m in response.changes])
        if self._replica is not None:
            self._replica.include(outcome.changes)
        return outcome

    # -- the monitor -------------------------------------------------------------------------------------------

    def _is_shut_down(self) -> bool:
        return bool(rospy.is_shutdown())

    def _follow(self) -> None:
        super()._follow()
        load_reasoners(self._server)

    def _on_monitor(self, message: msgs.WmMonitor) -> None:
        super()._on_monitor(message)
        listeners = self._listeners
        if self._replica is not None or listeners:
            change = msg2change(message, _SCENE)
            if self._replica is not None:
                self._replica.follow(change)
            for listener in listeners:
                _call_logged(listener, change)
        if self._monitor_cb is not None:
            _call_logged(self._monitor_cb, message)

    # -- reading -----------------------------------------------------------------------------------------------

    def _is_local(self, context: str) -> bool:
        """Whether a context is read from the replica."""
        return self._replica is not None and context == _SCENE

    def _local(self, context: str) -> SceneReader:
        if self._replica is not None:
            self._replica.refresh()
        return self._reader

    def _fetch_scene(self) -> Snapshot:
        answer = self._snapshot_service.call(srvs.WmSnapshotRequest(_SCENE))
        self._invalidate_ontology()  # the scene may use newer ontologies
        number = snapshot_number(answer.snapshot_id)
        return Snapshot(answer.snapshot_id, number, [msg2shared_element(m, number) for m in answer.elements])

    def _get(
        self, action: str, context: str, asked: msgs.WmElement, relation_filter: str = "", type_filter: str = ""
    ) -> list[Element]:
        request = srvs.WmGetRequest(action, context, asked, relation_filter, type_filter)
        return _given(self._get_service.call(request))


def _call_logged(listener: Callable[[Any], None], change: Any) -> None:
    """Calls a listener. Its exception is logged: the other listeners get the change, too."""
    try:
        listener(change)
    except FOREIGN_ERRORS:
        log.exception("a listener failed on a change of the world model")


def _given(answer: srvs.WmGetResponse) -> list[Element]:
    """The elements in an answer of `WmGet`."""
    number = snapshot_number(answer.snapshot_id)
    return [msg2shared_element(m, number) for m in answer.elements]


def load_reasoners(server: str) -> None:
    """Loads the server's reasoners in this process, if they are installed."""
    for reasoner in available_reasoners(text_list(f"{server}/reasoners_pkgs"), reasoners.names()):
        reasoners.add(reasoner)
