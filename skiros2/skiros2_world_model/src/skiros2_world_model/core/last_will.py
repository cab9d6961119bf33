"""Last wills: cleanup actions that the world model runs when a node dies, as in MQTT.

A node sets its last will while it runs. The world model executes and deletes it when that process ends without having
withdrawn it, or when another process of the same node name sets a new one. Last wills are stored in the journal.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.property import Property

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class CleanupAction:
    """Changes to each element of the scene whose property `key` is `value`.

    :param relation: removes the objects of this relation and its subproperties; "": none.
    :param below: removes the objects together with their descendants along this relation.
    :param properties: writes these properties, by key; a property without values is removed.
    """

    key: str
    value: str
    relation: str = ""
    below: str = "skiros:sceneProperty"
    properties: Mapping[str, Property] = field(default_factory=dict)


@dataclass(frozen=True)
class NodeProcess:
    """The process of a node: its slave API URI and process id distinguish it from other processes of the same name."""

    uri: str
    pid: int


@dataclass(frozen=True, eq=False)
class LastWill:
    """The cleanup actions of a node's process."""

    owner: str
    process: NodeProcess
    actions: Sequence[CleanupAction]


def last_will_author(owner: str) -> str:
    """The author of the changes when a last will is executed."""
    return f"last will of {owner}"


def last_wills_json(wills: Mapping[str, LastWill]) -> str:
    """Serializes last wills as `[[owner, uri, pid, [[key, value, relation, below, {property: values}], ...]], ...]`.

    :raises WrongValue: a value has a type that cannot be written.
    """
    written = [
        [
            will.owner,
            will.process.uri,
            will.process.pid,
            [
                [b.key, b.value, b.relation, b.below, {k: p.values for k, p in b.properties.items()}]
                for b in will.actions
            ],
        ]
        for will in wills.values()
    ]
    try:
        return json.dumps(written)
    except (TypeError, ValueError) as error:
        raise WrongValue(f"the last wills of {', '.join(wills)} cannot be written: {error}") from None


def parse_last_wills(text: str) -> dict[str, LastWill]:
    """Parses last wills, by owner. Returns none when the text is invalid."""
    try:
        return {
            owner: LastWill(owner, NodeProcess(uri, pid), [_parse_action(*written) for written in actions])
            for owner, uri, pid, actions in json.loads(text or "[]")
        }
    except (TypeError, ValueError) as error:
        log.error("the last wills in the journal cannot be read and are lost: %s", error)
        return {}


def _parse_action(key: str, value: str, relation: str, below: str, properties: dict[str, list[Any]]) -> CleanupAction:
    written = {k: Property(k, values or str) for k, values in properties.items()}
    return CleanupAction(key, value, relation, below, written)
