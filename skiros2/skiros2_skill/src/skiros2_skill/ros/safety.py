"""The topics of the stops of a skill manager's robot, and its topic and service `~safety`."""

from __future__ import annotations

import importlib
import logging
from typing import Any

import rospy

from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.core.runtime.safety import Safety, Stop
from skiros2_skill.core.runtime.safety_guard import DEFAULT_POLICIES, SafetyGuard
from skiros2_skill.core.runtime.safety_sources import SafetySettings, Source, read_settings
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.ros.messages import wire_text

log = logging.getLogger(__name__)

#: The topic with the safety state, a private name of a manager's node.
SAFETY_TOPIC = "~safety"


def find_type(name: str, kind: str) -> type | None:
    """Returns the class of a message or a service; None if there is none.

    :param name: `package/Type`.
    :param kind: `msg` or `srv`.
    """
    package, _, local = name.partition("/")
    try:
        found = getattr(importlib.import_module(f"{package}.{kind}"), local, None)
    except (ImportError, TypeError, ValueError):
        return None
    return found if isinstance(found, type) else None


def safety_params() -> SafetySettings:
    """Reads the private parameters `~safety_sources`, `~on_protective_stop`, `~on_fault`, `~on_emergency_stop` and
    `~recovery`.

    :raises ConfigurationError: the text names all problems.
    """
    policies = {kind.value: rospy.get_param(f"~on_{kind}", policy.value) for kind, policy in DEFAULT_POLICIES.items()}
    sources = rospy.get_param("~safety_sources", None) or []
    recovery = rospy.get_param("~recovery", None) or {}
    return read_settings(sources, policies, recovery, find_type, rospy.resolve_name)


class SafetyMonitor:
    """Subscribes to the sources, applies their stops to the tasks of a scheduler, and publishes the safety state."""

    def __init__(self, settings: SafetySettings, scheduler: Scheduler) -> None:
        self._status = msgs.SafetyStatus(state=Safety.RUNNING)
        self._publisher = rospy.Publisher(SAFETY_TOPIC, msgs.SafetyStatus, queue_size=10, latch=True)
        rules = [source.rules for source in settings.sources]
        self._guard = SafetyGuard(rules, settings.policies, scheduler, self._publish)
        self._service = rospy.Service(SAFETY_TOPIC, srvs.SkillSafety, lambda _: srvs.SkillSafetyResponse(self._status))
        self._subscribers = [
            rospy.Subscriber(source.topic, find_type(source.type, "msg"), self._on_message, source, tcp_nodelay=True)
            for source in settings.sources
        ]

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()
        self._guard.close()
        self._service.shutdown()
        self._publisher.unregister()

    def _on_message(self, message: Any, source: Source) -> None:
        self._guard.report(source.rules.name, source.read(message))

    def _publish(self, stops: tuple[Stop, ...]) -> None:
        status = msgs.SafetyStatus(state=Safety.RUNNING)
        if stops:
            worst = stops[0]
            status.state, status.since = worst.kind.value, rospy.Time.from_sec(worst.since)
            status.source, status.reason = wire_text(worst.source), wire_text(worst.reason)
            status.stops = [wire_text(str(stop)) for stop in stops]
        self._status = status
        self._publisher.publish(status)
