"""The world model node: its services, its monitor topic and its reasoners."""

from __future__ import annotations

import logging
import queue
import threading
import time
import weakref
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import rosgraph
import rospy

from skiros2_common.core.changeset import Relation
from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError, UnknownName, WrongValue
from skiros2_common.core.operations import (
    REMOVE,
    REMOVE_RECURSIVE,
    RESET,
    SCENE,
    Add,
    Change,
    Operation,
    Outcome,
    Relate,
    Remove,
    Update,
)
from skiros2_common.core.world_element import Element
from skiros2_common.ros.node import spin
from skiros2_common.ros.parameters import texts_param
from skiros2_common.ros.reasoners import new_reasoners
from skiros2_common.ros.utils import element2msg, msg2element, relation2msg
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.group_commit import GroupCommit
from skiros2_world_model.core.last_will import LastWillStore
from skiros2_world_model.core.queries import no_element
from skiros2_world_model.core.reasoner_world_model import ReasonerWorldModel
from skiros2_world_model.core.scene import ElementRecord
from skiros2_world_model.core.validator import Validator
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.ros.element_answer import (
    ChangeMessage,
    ElementAnswer,
    ElementBytes,
    ModifyAnswer,
    TransactionAnswer,
)
from skiros2_world_model.ros.last_will import LastWillService
from skiros2_world_model.ros.ontology_server import (
    OntologyServices,
    follow_sync,
    ontology_folder,
    open_journal,
    query_budgets,
    triple_store,
    workspace_folder,
)
from skiros2_world_model.ros.same_frames import publish_same_frames
from skiros2_world_model.ros.service_pool import service_handler
from skiros2_world_model.ros.wire import entry2msg, msg2operation, msg2point

log = logging.getLogger(__name__)

#: The number of messages queued for a slow subscriber. A subscriber that misses some fetches the scene again.
_QUEUE_SIZE = 1000


class ChangePublisher:
    """The latched topic `~monitor`. A thread sends the messages in the order of `put`.

    Sending takes half as long as a request, which holds the lock of the world model while its client waits.
    """

    def __init__(self) -> None:
        self._publisher = rospy.Publisher("~monitor", msgs.WmMonitor, latch=True, queue_size=_QUEUE_SIZE)
        self._waiting: queue.SimpleQueue[msgs.WmMonitor] = queue.SimpleQueue()
        threading.Thread(target=self._run, name="change publisher", daemon=True).start()

    def put(self, message: msgs.WmMonitor) -> None:
        """Queues a `WmMonitor`. Thread-safe; does not block."""
        self._waiting.put(message)

    def wait_for_subscribers(self, timeout: float = 0.5) -> None:
        """Blocks until the registered subscribers are connected; a recorder that was started first misses nothing then.

        :param timeout: in s; the master may still list killed nodes as subscribers.
        """
        listed: Any = rosgraph.Master(rospy.get_name()).getSystemState()[1]
        names = {node for topic, nodes in listed if topic == self._publisher.resolved_name for node in nodes}
        deadline = time.monotonic() + timeout
        while self._publisher.get_num_connections() < len(names):
            if time.monotonic() > deadline or rospy.is_shutdown():
                log.info("not all subscribers (%s) have connected to ~monitor", ", ".join(sorted(names)))
                return
            time.sleep(0.005)

    def _run(self) -> None:
        while True:
            message = self._waiting.get()
            try:
                self._publisher.publish(message)
            except rospy.ROSException:
                log.debug("change %s is not published: the node shuts down", message.snapshot_id)
                return


class Reasoners:
    """The reasoners that a server runs."""

    def __init__(self, model: WorldModel, packages: list[str]) -> None:
        """Loads and starts the reasoners of some Python packages.

        :raises ConfigurationError: a package does not exist.
        """
        self._reasoning = model.reasoning
        wmi = ReasonerWorldModel(model)
        for reasoner in new_reasoners(packages):
            try:
                reasoner.init(wmi)
                reasoners.add(reasoner)
            except FOREIGN_ERRORS:
                log.exception("reasoner %s cannot be initialised and is skipped", reasoner.__class__.__name__)
                continue
            model.add_reasoner(reasoner)
        self._reasoning.execute()
        log.info("reasoners: %s", ", ".join(r.__class__.__name__ for r in self._reasoning.all()) or "none")

    def stop(self) -> None:
        """Stops all reasoners and waits for them."""
        self._reasoning.stop()


_Message = TypeVar("_Message")


#: The private parameter with the initial files that were refused: by context, why.
REFUSED_PARAMETER = "~refused"


class WorldModelServer:
    """The services and the monitor topic of a world model.

    Each connection has a thread, which runs its handlers; the world model's lock serializes the changes.
    """

    def __init__(self, model: WorldModel) -> None:
        self._model = model
        self._commit = GroupCommit(model)
        self._messages: weakref.WeakKeyDictionary[Change, ChangeMessage] = weakref.WeakKeyDictionary()
        self._bytes = ElementBytes()
        self._monitor = ChangePublisher()
        with model.lock:
            snapshot, stamp = model.snapshot_id, rospy.Time.now()
            self._monitor.put(msgs.WmMonitor(snapshot, snapshot, stamp, "wm", "reset", self._scene(), []))
            model.add_listener(self._on_change)
            self._monitor.wait_for_subscribers()
        self._ontologies = OntologyServices(model, model.advisory_lock)
        self._validator = Validator(model)
        rospy.on_shutdown(self._validator.stop)
        for context in model.loaded:
            self._validate_file(context)
        self._services = [
            rospy.Service("~modify", srvs.WmModify, service_handler(self._on_modify)),
            rospy.Service("~transaction", srvs.WmTransaction, service_handler(self._on_transaction)),
            rospy.Service("~snapshot", srvs.WmSnapshot, service_handler(self._on_snapshot)),
            rospy.Service("~scene/set_relation", srvs.WmSetRelation, service_handler(self._on_set_relation)),
            rospy.Service("~scene/query_relations", srvs.WmQueryRelations, service_handler(self._on_query_relations)),
            rospy.Service("~load_and_save", srvs.WoLoadAndSave, service_handler(self._on_load_and_save)),
            rospy.Service("~get", srvs.WmGet, service_handler(self._on_get)),
            rospy.Service("~history", srvs.WmHistory, service_handler(self._on_history)),
            rospy.Service("~validation", srvs.WmValidation, service_handler(self._on_validation)),
        ]

    # -- reading -----------------------------------------------------------------------------------------------

    def _on_get(self, request: srvs.WmGetRequest) -> srvs.WmGetResponse:
        with self._model.lock:
            snapshot = self._model.snapshot_id
            elements = self._read(request)
        return ElementAnswer(snapshot, [self._bytes.of(e, request.context) for e in elements])

    def _read(self, request: srvs.WmGetRequest) -> list[Element]:
        reader, asked = self._model.reader, request.element
        if request.action == request.GET:
            found = reader.find(asked.id, request.context)
            if found is None:
                raise UnknownName(no_element(asked.id, request.context))
            return [found]
        if request.action == request.GET_TEMPLATE:
            return [self._model.template(asked.label)]
        if request.action == request.RESOLVE:
            return reader.matching(msg2element(asked), request.context)
        if request.action == request.GET_RECURSIVE:
            return reader.branch(asked.id, request.relation_filter, request.type_filter, request.context)
        known = (request.GET, request.GET_TEMPLATE, request.RESOLVE, request.GET_RECURSIVE)
        raise WrongValue(f"unknown action {request.action!r}; known: {', '.join(known)}")

    def _on_snapshot(self, request: srvs.WmSnapshotRequest) -> srvs.WmSnapshotResponse:
        with self._model.lock:
            scene = self._model.scene(request.context or SCENE)
            snapshot, parts = self._model.snapshot_id, [(n, list(scene.relations(n.id))) for n in scene]
        return srvs.WmSnapshotResponse(snapshot, [_scene_element(*part) for part in parts])

    def _on_query_relations(self, request: srvs.WmQueryRelationsRequest) -> srvs.WmQueryRelationsResponse:
        asked = request.relation
        found = self._model.reader.related(_any(asked.subjectId), _any(asked.predicate), _any(asked.objectId))
        return srvs.WmQueryRelationsResponse([relation2msg(r) for r in found])

    def _on_history(self, request: srvs.WmHistoryRequest) -> srvs.WmHistoryResponse:
        history, context = self._model.history, request.context or SCENE
        since, until = msg2point(request.since_number, request.since), msg2point(request.until_number, request.until)
        if request.action == request.CHANGES:
            entries = history.changes(request.element, since, until, request.author, request.limit, context)
        elif request.action == request.DIFFERENCE:
            entries = [history.difference(since, until, context)]
        elif request.action == request.SCENE:
            entries = [history.scene_at(until, context)]
        else:
            known = ", ".join((request.SCENE, request.CHANGES, request.DIFFERENCE))
            raise WrongValue(f"unknown action {request.action!r}; known: {known}")
        return srvs.WmHistoryResponse([entry2msg(entry) for entry in entries])

    def _on_validation(self, request: srvs.WmValidationRequest) -> srvs.WmValidationResponse:
        report = self._validator.validate_context(request.context or SCENE)
        findings = [msgs.WmFinding(f.severity, f.element, f.property, f.file, f.text) for f in report.findings]
        return srvs.WmValidationResponse(rospy.Time.from_sec(report.stamp), findings)

    def _validate_file(self, context: str) -> None:
        """Validates the file that was loaded into a context, unless the parameter `~validate` is false."""
        if rospy.get_param("~validate", True):
            self._validator.file_loaded(context)

    # -- writing -----------------------------------------------------------------------------------------------

    def _on_modify(self, request: srvs.WmModifyRequest) -> srvs.WmModifyResponse:
        known = (request.ADD, request.UPDATE, request.UPDATE_PROPERTIES, request.REMOVE, request.REMOVE_RECURSIVE)
        if request.action not in known:
            raise WrongValue(f"unknown action {request.action!r}; known: {', '.join(known)}")
        operations = _all_read(lambda element: self._operation(request, element), request.elements)
        outcome = self._commit.transact(operations, request.author, request.context or SCENE)
        if request.action in (request.REMOVE, request.REMOVE_RECURSIVE):
            return srvs.WmModifyResponse(request.elements)
        context = request.context or SCENE
        found = (self._model.reader.find(eid, context) for eid in outcome.ids)
        return ModifyAnswer([self._bytes.of(e, context) for e in found if e is not None])

    def _operation(self, request: srvs.WmModifyRequest, message: msgs.WmElement) -> Operation:
        if request.action == request.ADD:
            return Add(msg2element(message))
        if request.action == request.UPDATE:
            return Update(msg2element(message))
        if request.action == request.UPDATE_PROPERTIES:
            keys = self._model.reasoning.keys_of(request.type_filter) if request.type_filter else None
            return Update(msg2element(message), relations=False, keys=keys)
        if request.action == request.REMOVE:
            return Remove(message.id, recursive=False)
        relation_filter = request.relation_filter or "skiros:sceneProperty"
        return Remove(message.id, True, relation_filter, request.type_filter)

    def _on_transaction(self, request: srvs.WmTransactionRequest) -> srvs.WmTransactionResponse:
        operations = _all_read(msg2operation, request.operations)
        outcome: Outcome = self._commit.transact(operations, request.author, request.context or SCENE)
        return TransactionAnswer(outcome.ids, [self._message(change) for change in outcome.changes])

    def _on_set_relation(self, request: srvs.WmSetRelationRequest) -> srvs.WmSetRelationResponse:
        relation = request.relation
        operation = Relate(relation.subjectId, relation.predicate, relation.objectId, request.value)
        self._commit.transact([operation], request.author)
        return srvs.WmSetRelationResponse(True)

    def _on_load_and_save(self, request: srvs.WoLoadAndSaveRequest) -> srvs.WoLoadAndSaveResponse:
        author = request._connection_header.get("callerid", "unknown")
        context = request.context or SCENE
        if request.action == request.LOAD:
            self._model.load(request.filename, author, context)
            self._validate_file(context)
            rospy.set_param(REFUSED_PARAMETER, self._model.refused)
            log.info("%s loaded context %s from %s", author, context, request.filename)
        elif request.action == request.SAVE:
            path = self._model.save(request.filename, context)
            log.info("%s saved context %s to %s", author, context, path)
        else:
            raise WrongValue(f"unknown action {request.action!r}; known: {request.LOAD}, {request.SAVE}")
        return srvs.WoLoadAndSaveResponse(True)

    # -- publishing --------------------------------------------------------------------------------------------

    def _on_change(self, change: Change) -> None:
        message: msgs.WmMonitor = self._message(change)
        if change.action == RESET:  # a reader that has only the messages, such as a bag, starts from here
            stamp, names = message.stamp, (change.prev_snapshot_id, change.snapshot_id)
            message = msgs.WmMonitor(*names, stamp, change.author, RESET, self._scene(), [])
        self._monitor.put(message)

    def _scene(self) -> list[msgs.WmElement]:
        scene = self._model.scene()
        return [_scene_element(record, scene.relations(record.id)) for record in scene]

    def _message(self, change: Change) -> ChangeMessage:
        message = self._messages.get(change)
        if message is None:
            # Removed elements are as they were, with the relations that were removed: no state to keep.
            context = "" if change.action in (REMOVE, REMOVE_RECURSIVE) else change.context
            parts = [self._bytes.of(element, context) for element in change.elements]
            message = self._messages[change] = ChangeMessage(change, parts)
        return message


def serve_world_model() -> None:
    """Runs the world model node until its shutdown.

    :raises ConfigurationError: a folder or reasoner is missing or cannot be read, or a parameter is invalid.
    """
    scene = str(rospy.get_param("~init_scene", "")).strip()
    further = (entry.strip().partition(" ") for entry in texts_param("~load_contexts"))
    initial = [(SCENE, scene)] if scene else []
    initial += [(context, filename.strip()) for context, _, filename in further]
    strict = bool(rospy.get_param("~strict", False))
    journal = open_journal(workspace_folder(), initial)
    folders = ontology_folder(), workspace_folder()
    model = WorldModel(*folders, strict, journal, initial, triple_store(), blank_on_error=True)
    model.knowledge_base.budgets = query_budgets()
    running = Reasoners(model, texts_param("~reasoners_pkgs"))
    _server = WorldModelServer(model)
    _same_frames = publish_same_frames(texts_param("~same_frames"))
    _last_wills = LastWillService(LastWillStore(model, journal))
    if model.recovered:
        log.info("to start from the files instead: shut the world model down, or set journal_recover to never")
    rospy.set_param(REFUSED_PARAMETER, model.refused)
    if journal is not None:
        follow_sync(journal)
    if SCENE in model.refused:
        log.warning("the world model is ready with a blank scene: %s was refused", scene)
    else:
        origin = "its journal" if model.recovered else scene or "a blank scene"
        log.info("the world model is ready: %s elements from %s", len(model.scene()), origin)
    spin()
    running.stop()
    if journal is not None:
        journal.close()


def _scene_element(record: ElementRecord, outgoing: Iterable[Relation]) -> msgs.WmElement:
    """An element of a whole scene with its outgoing relations, so that each relation occurs once."""
    message = element2msg(Element.shared(record.type, record.label, record.id, record.properties, ()))
    message.relations = [msgs.Relation("-1", pred, dst) for _, pred, dst in outgoing]
    return message


def _all_read(read: Callable[[_Message], Operation], messages: Iterable[_Message]) -> list[Operation]:
    """Converts messages to operations.

    :raises SkirosError: some are invalid; the text has all problems.
    """
    operations: list[Operation] = []
    errors: list[SkirosError] = []
    for message in messages:
        try:
            operations.append(read(message))
        except SkirosError as error:
            errors.append(error)
    if len(errors) > 1:
        raise WrongValue("; ".join(map(str, errors)))
    if errors:
        raise errors[0]
    return operations


def _any(name: str) -> str:
    """In queries, "-1" means any, like ""."""
    return "" if name == "-1" else name
