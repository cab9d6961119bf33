"""The world as somebody sees it who only listens to `wm/monitor`, live or from a bag."""

from __future__ import annotations

import copy
import json
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.errors import WrongValue

#: A relation: subject, predicate, object.
Triple = tuple[str, str, str]

SELF = "-1"


class MonitorGap(WrongValue):
    """A change is missing between two messages: what follows cannot be trusted."""


@dataclass
class Thing:
    """An element, without its relations."""

    id: str
    type: str
    label: str
    properties: dict[str, list[Any]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """What a person calls it: its label without prefix, or its id."""
        return self.label.rpartition(":")[2] or self.id

    @property
    def size(self) -> tuple[float, float, float]:
        """The edges of its box (m), 0 where it has none."""
        x, y, z = (float(next(iter(self.properties.get(f"skiros:Size{axis}", [])), 0.0)) for axis in "XYZ")
        return x, y, z


class WorldState:
    """The scene, kept up to date by `apply`. Has content from the first `reset` or `add` on."""

    def __init__(self) -> None:
        self.things: dict[str, Thing] = {}
        self.relations: set[Triple] = set()
        self.snapshot_id = ""

    def apply(self, message: Any) -> None:
        """Takes over one `WmMonitor` message.

        :raises MonitorGap: messages between the last one and this are missing.
        :raises WrongValue: the message cannot be read.
        """
        if message.action == "reset":
            self.things, self.relations = {}, set()
        elif self.snapshot_id and message.prev_snapshot_id != self.snapshot_id:
            raise MonitorGap(
                f"a change of the world model is missing: {message.action!r} by {message.author!r} follows snapshot "
                f"{message.prev_snapshot_id!r}, the last one seen is {self.snapshot_id!r}"
            )
        self.snapshot_id = message.snapshot_id
        removes = message.action in ("remove", "remove_recursive")
        for element in message.elements:
            self._remove(element.id)
        for element in [] if removes else message.elements:
            self._put(element)
        for relation in message.relation:
            triple = (relation.subjectId, relation.predicate, relation.objectId)
            if removes:
                self.relations.discard(triple)
            else:
                self.relations.add(triple)

    def copy(self) -> WorldState:
        """The world as it is now."""
        return copy.deepcopy(self)

    def name(self, thing_id: str) -> str:
        """What a person calls a thing: its label without prefix, or its id."""
        thing = self.things.get(thing_id)
        return thing.name if thing is not None else thing_id

    def holders(self, thing_id: str, predicate: str) -> list[str]:
        """The subjects of a relation to a thing."""
        return sorted(s for s, p, o in self.relations if p == predicate and o == thing_id)

    def _put(self, element: Any) -> None:
        try:
            properties = {p.key: _values(p.dataValue) for p in element.properties}
        except ValueError as error:
            raise WrongValue(f"element {element.id}: a property is no JSON: {error}") from None
        self.things[element.id] = Thing(element.id, element.type, element.label, properties)
        for relation in element.relations:
            subject = element.id if relation.subjectId == SELF else relation.subjectId
            target = element.id if relation.objectId == SELF else relation.objectId
            self.relations.add((subject, relation.predicate, target))

    def _remove(self, thing_id: str) -> None:
        self.things.pop(thing_id, None)
        self.relations = {t for t in self.relations if thing_id not in (t[0], t[2])}


def _values(text: str) -> list[Any]:
    decoded = json.loads(text)
    return decoded if isinstance(decoded, list) else [decoded]
