"""Alarms: what in the cell needs a person, until it is over or removed.

An alarm is {kind, source, text, since, acknowledged}: `kind` is job, connection, robot or approval, `source` the id or
name, `since` in s since the epoch, `acknowledged` {user, time} or missing. Its id names the occurrence, such as
`robot/arm@1795870338.17`: when a robot stops again, that is another alarm.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from skiros2_common.core.errors import UnknownName
from skiros2_gateway.core.cell import CANCELLED, REACHED
from skiros2_gateway.core.store import JobStore
from skiros2_live.core.robots import BUSY, IDLE, PAUSED

#: The tables of the live view's document that alarms are made of.
TABLES = frozenset(("jobs", "connections", "cell", "approvals"))

#: Outcomes of jobs that nobody has to look at: reached, or ended by a person.
_FINE = frozenset(("", CANCELLED, *REACHED))


def alarms_of(document: Mapping[str, Any], acknowledged: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Returns the alarms by id.

    :param document: of the live view.
    :param acknowledged: {user, time} by the ids of alarms.
    """
    found = {}
    for kind, source, text, since in _found(document):
        alarm_id = f"{kind}/{source.lstrip('/')}@{since:.2f}"
        found[alarm_id] = {"kind": kind, "source": source, "text": text, "since": since}
        if alarm_id in acknowledged:
            found[alarm_id]["acknowledged"] = dict(acknowledged[alarm_id])
    return found


def _found(document: Mapping[str, Any]) -> Iterator[tuple[str, str, str, float]]:
    for job_id, job in document["jobs"].items():
        response = job["response"]
        if response.get("outcome", "") not in _FINE:
            yield "job", job_id, response.get("message", ""), response.get("ended", job["changed"])
    for name, part in document["connections"].items():
        if not part["is_up"]:
            text = part["text"] or ("the connection is lost" if part["since"] else "it has not answered yet")
            yield "connection", name, text, part["since"]
    for robot in document["cell"].get("robots", ()):
        if robot["state"] not in (IDLE, BUSY, PAUSED):
            text = robot["state"].replace("_", " ") + (f": {robot['reason']}" if robot["reason"] else "")
            yield "robot", robot["name"], text, robot["since"]
    for approval_id, approval in document["approvals"].items():
        yield "approval", approval_id, f"{approval['user']} asks for an approval", approval["created"]


class Acknowledged:
    """The alarms that a person has acknowledged; they are kept in the store. To be used in the gateway's loop.

    :ivar entries: {user, time} by the ids of alarms.
    """

    def __init__(self, store: JobStore) -> None:
        self._store = store
        self.entries = store.acknowledged()

    def add(self, alarms: Collection[str], known: Collection[str], user: str) -> None:
        """Acknowledges alarms.

        :raises UnknownName: one of them is not among the known ones. Nothing has changed.
        :raises StoreFailed: nothing has changed.
        """
        if unknown := sorted(set(alarms) - set(known)):
            raise UnknownName(f"there is no alarm {unknown[0]!r}")
        new = {each: {"user": user, "time": time.time()} for each in alarms if each not in self.entries}
        self._store.put_acknowledged(new)
        self.entries.update(new)
