"""Brings what a broker retains of jobs in line with the store: it may have no memory, or the gateway was away."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import paho.mqtt.client as paho

from skiros2_common.core.errors import UnknownName
from skiros2_gateway.core.problems import StoreFailed
from skiros2_gateway.core.service import Service

log = logging.getLogger(__name__)

#: How many jobs are read at once, and the longest time until the broker has taken them (s).
_PAGE, _TIMEOUT = 50, 10.0
#: The pause after a failure of the store (s).
_PAUSE = 1.0

#: The id of a job whose topics would be those of commands, and what they have instead; no id has a `%`.
_COMMANDS, _ESCAPED = "in", "%69n"

#: Publishes JSON data, or None, on a topic below the prefix.
Publish = Callable[[str, Any], paho.MQTTMessageInfo | None]


class RetainedJobs:
    """The topics `job/ID/state` and `job/ID/response`. To be used in the gateway's loop."""

    def __init__(self, service: Service, publish: Publish) -> None:
        self._service = service
        self._publish = publish

    def publish_response(self, job_id: str, response: dict[str, Any] | None) -> None:
        """Publishes the response of a job as JSON data; None removes it."""
        self._publish(_topic(job_id, "response"), response)

    def publish_state(self, job: dict[str, Any]) -> paho.MQTTMessageInfo | None:
        """Publishes the state of a job as of `Job.to_dict`; removes both topics of a cleared one."""
        if job["cleared"]:
            self.publish_response(job["id"], None)
        state = {"state": job["state"], "substate": job["substate"], "changed": job["changed"]}
        return self._publish(_topic(job["id"], "state"), None if job["cleared"] else state)

    async def publish_all(self) -> None:
        """Publishes the states and responses of all jobs in the list, as fast as the broker takes them."""
        last = 0
        while True:
            try:
                jobs = self._service.store.jobs_after(last, _PAGE)
                for job in jobs:
                    if job.response.collected:
                        self.publish_response(job.id, {"job": job.id, **asdict(job.response)})
                    sent = self.publish_state(self._service.control.get(job.id).to_dict())
                if not jobs:
                    return
                if sent is not None:
                    await asyncio.to_thread(sent.wait_for_publish, _TIMEOUT)
                last = jobs[-1].sequence
            except (StoreFailed, ValueError) as error:  # ValueError: too many messages wait for the broker
                log.error("MQTT: the states of jobs are published later: %s", error)
                await asyncio.sleep(_PAUSE)
            except RuntimeError as error:  # all are published again after the next connection
                log.info("MQTT: the connection was lost while jobs were published: %s", error)
                return

    def check(self, name: str, kind: str) -> None:
        """Removes a topic that the broker retains, if there is no such job or it has no response.

        :param name: the job in the topic.
        :param kind: `state` or `response`.
        """
        job_id = _COMMANDS if name == _ESCAPED else name
        try:
            job = self._service.control.get(job_id)
            is_wrong = job.cleared or (kind == "response" and not job.response.collected)
        except UnknownName:
            is_wrong = True
        except StoreFailed as error:
            log.error("MQTT: the topics of job %s stay: %s", job_id, error)
            return
        if is_wrong:
            self._publish(f"job/{name}/{kind}", None)


def _topic(job_id: str, kind: str) -> str:
    return f"job/{_ESCAPED if job_id == _COMMANDS else job_id}/{kind}"
