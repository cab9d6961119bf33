"""Messages of the service `~history`."""

from __future__ import annotations

from typing import Any

import genpy

from skiros2_common.core.errors import WrongValue
from skiros2_common.ros.utils import element2msg, msg2element, msg2relation, relation2msg
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.changes import SCENE
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
) -> Any:
    """Creates a request of `WmHistory`. None as a point: the beginning of the journal, or now."""
    return _REQUEST(action, context, element, author, *_point2msg(since), *_point2msg(until), limit)


def answer_history(history: History, request: Any) -> Any:
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
        entries = [history.scene_at(until, context)]
    else:
        known = ", ".join((_REQUEST.SCENE, _REQUEST.CHANGES, _REQUEST.DIFFERENCE))
        raise WrongValue(f"unknown action {request.action!r}; known: {known}")
    return srvs.WmHistoryResponse([entry2msg(entry) for entry in entries])


def entry2msg(entry: HistoryEntry) -> Any:
    """Converts an entry to a `WmHistoryEntry`."""
    return msgs.WmHistoryEntry(
        entry.number,
        genpy.Time.from_sec(entry.stamp),
        entry.author,
        entry.action,
        [element2msg(e) for e in entry.before],
        [element2msg(e) for e in entry.after],
        [relation2msg(r) for r in entry.related],
        [relation2msg(r) for r in entry.unrelated],
        entry.stated,
        entry.unstated,
    )


def msg2entry(msg: Any) -> HistoryEntry:
    """Converts a `WmHistoryEntry` to an entry."""
    return HistoryEntry(
        msg.number,
        msg.stamp.to_sec(),
        msg.author,
        msg.action,
        [msg2element(e) for e in msg.before],
        [msg2element(e) for e in msg.after],
        [msg2relation(r) for r in msg.related],
        [msg2relation(r) for r in msg.unrelated],
        list(msg.stated),
        list(msg.unstated),
    )


def msg2point(number: int, time: Any) -> Point | None:
    """The point of a request; None when neither number nor time is set."""
    return int(number) or time.to_sec() or None


def _point2msg(point: Point | None) -> tuple[int, genpy.Time]:
    if isinstance(point, int):
        return point, genpy.Time()
    return 0, genpy.Time.from_sec(point or 0.0)
