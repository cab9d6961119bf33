"""The services of a world model node, as the calls of a client's transport."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import rospy
from std_srvs.srv import SetBool, SetBoolRequest

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.operations import SCENE, CleanupAction, snapshot_number
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_common.ros.utils import element2msg, msg2relation
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.history import HistoryEntry, Point
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.queries import describes
from skiros2_world_model.core.report import Finding, Report
from skiros2_world_model.core.scene import ChangeInfo
from skiros2_world_model.core.transport import HistoryReads
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.ros.last_will import last_will_request
from skiros2_world_model.ros.service_pool import LONG_ANSWER, ServicePool
from skiros2_world_model.ros.wire import history_request, msg2entry, msg2shared_element

_ACTION = srvs.WmGetRequest


class Services:
    """The connections to the services of a world model node. Each is made when it is first called.

    :param node: the name of the node.
    """

    def __init__(self, node: str) -> None:
        self.node = node
        self.get = ServicePool(f"{node}/get", srvs.WmGet)
        self.relations = ServicePool(f"{node}/scene/query_relations", srvs.WmQueryRelations)
        self.transaction = ServicePool(f"{node}/transaction", srvs.WmTransaction)
        self.snapshot = ServicePool(f"{node}/snapshot", srvs.WmSnapshot)
        self.history = ServicePool(f"{node}/history", srvs.WmHistory, answer_timeout=LONG_ANSWER)
        self.validation = ServicePool(f"{node}/validation", srvs.WmValidation, answer_timeout=LONG_ANSWER)
        self.last_will = ServicePool(f"{node}/last_will", srvs.WmLastWill)
        self.query = ServicePool(f"{node}/ontology/query", srvs.WoQuery)
        self.sparql = ServicePool(f"{node}/ontology/sparql", srvs.WmSparql)
        self.modify = ServicePool(f"{node}/ontology/modify", srvs.WoModify)
        self.files = ServicePool(f"{node}/load_and_save", srvs.WoLoadAndSave, answer_timeout=LONG_ANSWER)
        self.lock = ServicePool(f"{node}/lock", SetBool, answer_timeout=None)

    def elements(
        self, action: str, context: str, asked: msgs.WmElement, relation_filter: str = "", type_filter: str = ""
    ) -> tuple[list[Element], str]:
        """Calls `get`. Returns the elements of the answer and its snapshot id."""
        answer = self.get.call(_ACTION(action, context, asked, relation_filter, type_filter))
        number = snapshot_number(answer.snapshot_id)
        return [msg2shared_element(m, number) for m in answer.elements], str(answer.snapshot_id)

    def file(self, action: str, filename: str, context: str) -> None:
        """Loads or saves a file."""
        self.files.call(srvs.WoLoadAndSaveRequest(action, filename, context), repeatable=False)


class RosScene:
    """The reads of scenes by calls.

    :param ontology: returns the index of the current ontologies.
    """

    def __init__(self, services: Services, history: HistoryReads, ontology: Callable[[], Ontology]) -> None:
        self._services = services
        self._history = history
        self._ontology = ontology

    def find(self, eid: str, context: str) -> Element | None:
        try:
            return self._services.elements(_ACTION.GET, context, msgs.WmElement(id=eid))[0][0]
        except WmException as error:
            if error.code == UnknownName.code:
                return None
            raise

    def refreshed(self, element: Element, context: str) -> Element | None:
        return self.find(element.id, context)

    def removal(self, eid: str, context: str) -> ChangeInfo | None:
        try:
            entries = self._history.changes(eid, limit=1, context=context)
        except WmException:
            return None  # no journal, or the element never existed
        gone = [entry for entry in entries if entry.before and not entry.after]
        return ChangeInfo(gone[0].number, gone[0].stamp, gone[0].author) if gone else None

    def matching(self, wanted: Element, context: str) -> list[Element]:
        return self._services.elements(_ACTION.RESOLVE, context, element2msg(wanted))[0]

    def branch(self, eid: str, relation_filter: str, type_filter: str, context: str) -> list[Element]:
        asked = msgs.WmElement(id=eid)
        return self._services.elements(_ACTION.GET_RECURSIVE, context, asked, relation_filter, type_filter)[0]

    def related(self, src: str, pred: str, dst: str) -> list[RelationDict]:
        request = srvs.WmQueryRelationsRequest(msgs.Relation(src, pred, dst))
        return [msg2relation(m) for m in self._services.relations.call(request).matches]

    def holds(self, subj: Element, pred: str, obj: Element) -> bool:
        if not subj.id and not obj.id:
            return any(self.holds(found, pred, obj) for found in self.matching(subj, SCENE))
        for relation in self.related(subj.id, pred, obj.id):
            if subj.id and obj.id:
                return True
            other, wanted = (relation["dst"], obj) if subj.id else (relation["src"], subj)
            found = self.find(other, SCENE)
            if found is not None and describes(self._ontology(), wanted, found.type, found.label, found.property_view):
                return True
        return False


class RosHistory:
    """The reads of the history by calls."""

    def __init__(self, services: Services) -> None:
        self._services = services

    def changes(
        self,
        eid: str = "",
        since: Point | None = None,
        until: Point | None = None,
        author: str = "",
        limit: int = 0,
        context: str = SCENE,
    ) -> list[HistoryEntry]:
        return self._entries(history_request(srvs.WmHistoryRequest.CHANGES, context, since, until, eid, author, limit))

    def scene_at(self, at: Point, context: str = SCENE) -> HistoryEntry:
        return self._entries(history_request(srvs.WmHistoryRequest.SCENE, context, until=at))[0]

    def difference(self, since: Point, until: Point | None = None, context: str = SCENE) -> HistoryEntry:
        return self._entries(history_request(srvs.WmHistoryRequest.DIFFERENCE, context, since, until))[0]

    def _entries(self, request: srvs.WmHistoryRequest) -> list[HistoryEntry]:
        return [msg2entry(m) for m in self._services.history.call(request).entries]


class RosServer:
    """The remaining calls of a world model node."""

    def __init__(self, services: Services) -> None:
        self._services = services

    def is_connected(self) -> bool:
        return self._services.query.is_there()

    def is_shut_down(self) -> bool:
        return bool(rospy.is_shutdown())

    def lock(self) -> bool:
        answer = self._services.lock.call(SetBoolRequest(True))
        if not answer.success:
            raise WmException(f"the world model cannot be locked: {answer.message}")
        return True

    def unlock(self) -> bool:
        return bool(self._services.lock.call(SetBoolRequest(False)).success)

    def save(self, filename: str, context: str) -> None:
        self._services.file(srvs.WoLoadAndSaveRequest.SAVE, filename, context)

    def query(self, query: str, cut_prefix: bool, context: str) -> list[str]:
        return list(self._services.query.call(srvs.WoQueryRequest(query, context, cut_prefix)).answer)

    def query_json(self, query: str, context: str) -> str:
        return str(self._services.sparql.call(srvs.WmSparqlRequest(query, context)).json)

    def template(self, name: str) -> Element:
        return self._services.elements(_ACTION.GET_TEMPLATE, SCENE, msgs.WmElement(label=name))[0][0]

    def validate(self, context: str) -> Report:
        answer = self._services.validation.call(srvs.WmValidationRequest(context))
        findings = [Finding(m.severity, m.file, m.element, m.property, m.text) for m in answer.findings]
        return Report(f"context {context}", findings, answer.stamp.to_sec())

    def set_last_will(self, actions: Sequence[CleanupAction]) -> None:
        self._services.last_will.call(last_will_request(actions))

    def scene_name(self) -> str:
        return str(rospy.get_param(f"{self._services.node}/init_scene", ""))
