"""Alarms: what in the cell needs a person.

An alarm is {kind, source, text, since, acknowledged, cleared}: `kind` is job, connection, robot or approval, `source`
the id or name, `since` in s since the epoch, `acknowledged` {user, time} or missing, `cleared` when its cause went away
(s since the epoch), or missing. Its id names the occurrence, such as `robot/arm@1795870338.17`.

Alarms latch: one whose cause has gone away is listed until a person acknowledges it, also after restarts. If the robot
stops again meanwhile, the new alarm takes the place of that one. An approval that a person has answered does not latch;
nor does a part that has not answered yet when the gateway starts.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from skiros2_common.core.errors import UnknownName
from skiros2_gateway.core.approvals import Ending
from skiros2_gateway.core.cell import CANCELLED, REACHED
from skiros2_gateway.core.problems import StoreFailed
from skiros2_gateway.core.store import JobStore
from skiros2_live.core.robots import BUSY, IDLE, PAUSED

log = logging.getLogger(__name__)

#: The tables of the live view's document that alarms are made of.
TABLES = frozenset(("jobs", "connections", "cell", "approvals"))

#: Outcomes of jobs that nobody has to look at: reached, or ended by a person.
_FINE = frozenset(("", CANCELLED, *REACHED))


#: The latched alarms that are kept, the newest: of approvals, and of all others, which agents cannot push out.
MAX_UNANSWERED, _MAX_LATCHED = 50, 200


def alarms_of(document: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Returns the alarms by id whose causes are there.

    :param document: of the live view.
    """
    return {
        f"{kind}/{source.lstrip('/')}@{since:.2f}": {"kind": kind, "source": source, "text": text, "since": since}
        for kind, source, text, since in _found(document)
    }


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
        text = f"{approval['user']} asks for an approval" + (f": {approval['title']}" if approval["title"] else "")
        yield "approval", approval_id, text, approval["created"]


class Alarms:
    """The alarms that were acknowledged, and those that wait for it; the store keeps both. For the gateway's loop."""

    def __init__(self, store: JobStore) -> None:
        self._store = store
        self._acknowledged = store.acknowledged()
        self._latched = store.latched()
        self._written = dict(self._latched)

    def acknowledge(self, alarms: Collection[str], known: Collection[str], user: str) -> None:
        """Acknowledges alarms.

        :raises UnknownName: one of them is not among the known ones. Nothing has changed.
        :raises StoreFailed: nothing has changed.
        """
        if unknown := sorted(set(alarms) - set(known)):
            raise UnknownName(f"there is no alarm {unknown[0]!r}")
        new = {each: {"user": user, "time": time.time()} for each in alarms if each not in self._acknowledged}
        self._store.put_acknowledged(new)
        self._acknowledged.update(new)

    def listed(self, found: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        """Returns the alarms to be listed by id, and latches new ones.

        :param found: see `alarms_of`.
        """
        sources = {(alarm["kind"], alarm["source"]) for alarm in found.values()}
        latched = {}
        for alarm_id, alarm in {**self._latched, **found}.items():
            if alarm_id in self._acknowledged:
                continue
            if alarm_id in found:
                if alarm["since"]:
                    latched[alarm_id] = alarm
            elif (alarm["kind"], alarm["source"]) not in sources:
                is_kept = "cleared" in alarm or alarm["kind"] == "job"  # of jobs see `job_was_cleared`
                latched[alarm_id] = alarm if is_kept else {**alarm, "cleared": time.time()}
        newest = sorted(latched, key=lambda each: float(latched[each]["since"]))
        approvals = [alarm_id for alarm_id in newest if latched[alarm_id]["kind"] == "approval"]
        others = [alarm_id for alarm_id in newest if latched[alarm_id]["kind"] != "approval"]
        kept = (*others[-_MAX_LATCHED:], *approvals[-MAX_UNANSWERED:])
        self._latched = {alarm_id: latched[alarm_id] for alarm_id in kept}
        self._write()
        return {**self._latched, **{alarm_id: self._with_user(alarm_id, alarm) for alarm_id, alarm in found.items()}}

    def job_was_cleared(self, job_id: str) -> None:
        """Notes that a job was removed from the list: others may leave the page's document before."""
        for alarm_id, alarm in self._latched.items():
            if (alarm["kind"], alarm["source"]) == ("job", job_id) and "cleared" not in alarm:
                self._latched[alarm_id] = {**alarm, "cleared": time.time()}

    def approval_has_ended(self, approval: str, ending: Ending, text: str) -> None:
        """Notes how a request for an approval has ended: the alarm of an unanswered one stays."""
        for alarm_id, alarm in list(self._latched.items()):
            if (alarm["kind"], alarm["source"]) == ("approval", approval):
                del self._latched[alarm_id]
                if not ending.is_answer:
                    ended = {"text": f"{alarm['text']}: {text}", "cleared": time.time()}
                    self._latched[alarm_id] = {**alarm, **ended}

    def _with_user(self, alarm_id: str, alarm: dict[str, Any]) -> dict[str, Any]:
        acknowledged = self._acknowledged.get(alarm_id)
        return alarm if acknowledged is None else {**alarm, "acknowledged": dict(acknowledged)}

    def _write(self) -> None:
        if self._latched == self._written:
            return
        try:
            self._store.put_latched(self._latched)
            self._written = dict(self._latched)
        except StoreFailed as error:
            log.error("the alarms are written with the next one: %s", error)
