"""Messages of the service `~history`."""

from __future__ import annotations

import genpy

from skiros2_common.core.errors import WrongValue
from skiros2_common.ros.utils import element2msg, msg2element, relation2msg
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.changes import SCENE
from skiros2_world_model.core.changeset import ChangeSet, ElementRecord
from skiros2_world_model.core.history import History
from skiros2_world_model.core.history_entry import HistoryEntry, Point

_REQUEST = srvs.WmHistoryRequest


def history_request(
    action: str,
    context: str,
    since: Point | None = None,
    until: Point | None = None,
    element: str = "",
    author: str = "",
    limit: int = 0,
) -> srvs.WmHistoryRequest:
    """Creates a request of `WmHistory`. None as a point: the beginning of the journal, or now."""
    return _REQUEST(action, context, element, author, *_point2msg(since), *_point2msg(until), limit)


def answer_history(history: History, request: srvs.WmHistoryRequest) -> srvs.WmHistoryResponse:
    """Answers a request of `WmHistory`.

    :raises SkirosError: the request is invalid or refused.
    """
    context = request.context or SCENE
    since = msg2point(request.since_number, request.since)
    until = msg2point(request.until_number, request.until)
    if request.action == _REQUEST.CHANGES:
        entries = history.changes(request.element, since, until, request.author, request.limit, context)
    elif request.action == _REQUEST.DIFFERENCE:
        entries = [history.difference(since, until, context)]
    elif request.action == _REQUEST.SCENE:
        return srvs.WmHistoryResponse([_state2msg(history.scene_at(until, context))])
    else:
        known = ", ".join((_REQUEST.SCENE, _REQUEST.CHANGES, _REQUEST.DIFFERENCE))
        raise WrongValue(f"unknown action {request.action!r}; known: {known}")
    return srvs.WmHistoryResponse([entry2msg(entry) for entry in entries])


def entry2msg(entry: HistoryEntry) -> msgs.WmHistoryEntry:
    """Converts an entry to a `WmHistoryEntry`."""
    pairs = entry.changes.records.values()
    return msgs.WmHistoryEntry(
        entry.number,
        genpy.Time.from_sec(entry.stamp),
        entry.author,
        entry.action,
        [element2msg(before.element()) for before, _ in pairs if before is not None],
        [element2msg(after.element()) for _, after in pairs if after is not None],
        [relation2msg(r) for r in entry.related],
        [relation2msg(r) for r in entry.unrelated],
        entry.stated,
        entry.unstated,
    )


def _state2msg(state: HistoryEntry) -> msgs.WmHistoryEntry:
    """Converts a past state: each element has its outgoing relations."""
    message = entry2msg(state)
    message.after = [element2msg(element) for element in state.after]
    message.related = []
    return message


def msg2entry(msg: msgs.WmHistoryEntry) -> HistoryEntry:
    """Converts a `WmHistoryEntry` to an entry."""
    changes = ChangeSet()
    for messages, added in ((msg.before, False), (msg.after, True)):
        for element in map(msg2element, messages):
            record = ElementRecord(element.id, element.type, element.label, element._props)
            before, after = changes.records.get(element.id, (None, None))
            changes.records[element.id] = (before, record) if added else (record, after)
            for relation in element._rels:
                changes.relations[element.id, relation["type"], relation["dst"]] = added
    for relations, added in ((msg.unrelated, False), (msg.related, True)):
        changes.relations.update({(r.subjectId, r.predicate, r.objectId): added for r in relations})
    changes.statements = dict.fromkeys(msg.unstated, False) | dict.fromkeys(msg.stated, True)
    return HistoryEntry(msg.number, msg.stamp.to_sec(), msg.author, msg.action, changes)


def msg2point(number: int, time: genpy.Time) -> Point | None:
    """The point of a request; None when neither number nor time is set."""
    return int(number) or time.to_sec() or None


def _point2msg(point: Point | None) -> tuple[int, genpy.Time]:
    if isinstance(point, int):
        return point, genpy.Time()
    return 0, genpy.Time.from_sec(point or 0.0)
