"""Last wills: what the world model does in the place of programs that are gone.

A program leaves its will while it lives. It is carried out when that life of the program has ended without taking it
back, or when another life of the same name leaves one; then it is forgotten. Wills are kept in the journal.
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
class Bequest:
    """What becomes of some elements of the scene: of each whose property `key` is `value`.

    :param relation: what the element has along this relation and those under it is removed; "": nothing.
    :param below: each with what is below it along this relation.
    :param properties: these are written, by key; one without values is taken away.
    """

    key: str
    value: str
    relation: str = ""
    below: str = "skiros:sceneProperty"
    properties: Mapping[str, Property] = field(default_factory=dict)


@dataclass(frozen=True)
class Life:
    """One life of a node: where it listens and its process number, by which it is told from others of its name."""

    uri: str
    pid: int


@dataclass(frozen=True, eq=False)
class Will:
    """What a node has left."""

    owner: str
    life: Life
    bequests: Sequence[Bequest]


def author_of_will(owner: str) -> str:
    """Who makes the changes when a will is carried out."""
    return f"last will of {owner}"


def wills_text(wills: Mapping[str, Will]) -> str:
    """Wills as JSON: `[[owner, uri, pid, [[key, value, relation, below, {property: values}], ...]], ...]`.

    :raises WrongValue: a value is of a type that cannot be written.
    """
    written = [
        [
            will.owner,
            will.life.uri,
            will.life.pid,
            [
                [b.key, b.value, b.relation, b.below, {k: p.values for k, p in b.properties.items()}]
                for b in will.bequests
            ],
        ]
        for will in wills.values()
    ]
    try:
        return json.dumps(written)
    except (TypeError, ValueError) as error:
        raise WrongValue(f"the last wills of {', '.join(wills)} cannot be written: {error}") from None


def read_wills(text: str) -> dict[str, Will]:
    """The wills by owner; none of a text that `wills_text` has not written."""
    try:
        return {
            owner: Will(owner, Life(uri, pid), [_bequest(*written) for written in bequests])
            for owner, uri, pid, bequests in json.loads(text or "[]")
        }
    except (TypeError, ValueError) as error:
        log.error("the journal has last wills that cannot be read, they are lost: %s", error)
        return {}


def _bequest(key: str, value: str, relation: str, below: str, properties: dict[str, list[Any]]) -> Bequest:
    return Bequest(key, value, relation, below, {k: Property(k, values or str) for k, values in properties.items()})
