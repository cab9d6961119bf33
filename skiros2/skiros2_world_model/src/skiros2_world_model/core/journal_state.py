"""Reads the current state from a journal, and converts element records to and from its JSON.

The JSON of an element is `[class, label, {property: values}]`. The type of a property follows from its JSON values. A
property without values, or of another type, is `{"type": name, "values": [...]}`.
"""

from __future__ import annotations

import json
import sqlite3
import time
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.property import Property
from skiros2_world_model.core.changes import ONTOLOGY
from skiros2_world_model.core.journal_file import read_meta
from skiros2_world_model.core.scene import ElementRecord, Provenance


@dataclass
class ContextState:
    """The state of a context in the journal.

    :param file: the file it was last loaded from or saved to; "": none.
    :param next_number: the lowest unused id number.
    :param extras: its extra triples, as N-Triples.
    """

    name: str
    file: str
    next_number: int
    records: list[ElementRecord] = field(default_factory=list)
    relations: list[tuple[str, str, str]] = field(default_factory=list)
    extras: list[str] = field(default_factory=list)


@dataclass
class JournalState:
    """The state of a world model in the journal.

    :param session: the session of its snapshot ids.
    :param number: the number of the last change.
    :param last: the provenance of the last request.
    :param stated: the triples added to the ontologies since they were read from files, as N-Triples.
    :param unstated: the triples removed from the ontologies since they were read from files.
    """

    session: str
    number: int
    last: Provenance
    contexts: list[ContextState]
    stated: list[str]
    unstated: list[str]

    def __str__(self) -> str:
        when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(self.last.stamp))
        size = ", ".join(f"{len(context.records)} elements in {context.name}" for context in self.contexts)
        return f"{size}; last change by {self.last.author}, {when}"


def read_state(db: sqlite3.Connection) -> JournalState:
    """Reads the current state. Elements and relations are in the order of their creation.

    :raises sqlite3.DatabaseError, ValueError, LookupError, TypeError: the journal is damaged.
    """
    session = read_meta(db, "session")
    contexts = {name: ContextState(name, *more) for name, *more in db.execute("SELECT * FROM context ORDER BY rowid")}
    provenance: dict[tuple[int, float, str], Provenance] = {}
    rows = db.execute("SELECT context, id, content, made, stamp, author FROM element ORDER BY rowid")
    for context, eid, content, *change in rows:
        key = (change[0], change[1], change[2])
        known = provenance.get(key) or provenance.setdefault(key, Provenance(*key))
        contexts[context].records.append(read_record(eid, content, known))
    for context, *relation in db.execute("SELECT context, src, pred, dst FROM relation ORDER BY rowid"):
        contexts[context].relations.append((relation[0], relation[1], relation[2]))
    stated: dict[bool, list[str]] = {True: [], False: []}
    for context, triple, present in db.execute("SELECT context, triple, present FROM statement ORDER BY rowid"):
        (stated[bool(present)] if context == ONTOLOGY else contexts[context].extras).append(triple)
    request = "SELECT last, number, stamp, author FROM request ORDER BY number DESC LIMIT 1"
    number, *last = db.execute(request).fetchone()
    return JournalState(str(session), number, Provenance(*last), list(contexts.values()), stated[True], stated[False])


_PLAIN = (float, int, bool, str)
_TYPES: dict[str, type] = {kind.__name__: kind for kind in (*_PLAIN, list, dict, tuple)}

_encode = json.JSONEncoder(separators=(",", ":"), check_circular=False).encode


def element_text(record: ElementRecord) -> str:
    """The JSON of an element, without its relations.

    :raises WrongValue: a value has a type that cannot be written.
    """
    try:
        properties = {
            key: prop._values if prop._values and prop._data_type in _PLAIN else _typed(prop)
            for key, prop in record.properties.items()
        }
        return _encode([record.type, record.label, properties])
    except (TypeError, ValueError) as error:
        raise WrongValue(f"{record.id}: {error}") from None


def read_record(eid: str, text: str, provenance: Provenance) -> ElementRecord:
    """Parses the JSON of an element.

    :raises ValueError: the text was not written by `element_text`.
    """
    etype, label, properties = json.loads(text)
    read = {key: _property(key, values) for key, values in properties.items()}
    return ElementRecord(eid, etype, label, read, provenance)


def _typed(prop: Property) -> dict[str, Any]:
    kind = prop.dataType()
    if kind.__name__ not in _TYPES:
        raise TypeError(f"{prop.key}: values of type {kind.__name__} cannot be written")
    return {"type": kind.__name__, "values": prop.values}


def _property(key: str, content: Any) -> Property:
    if isinstance(content, list):
        return Property(key, content)
    kind = _TYPES[content["type"]]
    prop = Property(key, kind)
    prop.assign([tuple(value) for value in content["values"]] if kind is tuple else content["values"])
    return prop
