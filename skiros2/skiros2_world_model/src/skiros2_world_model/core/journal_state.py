"""A world model as its journal has it."""

from __future__ import annotations

import sqlite3
import time
from dataclasses import dataclass, field

from skiros2_world_model.core.context_names import ONTOLOGY
from skiros2_world_model.core.journal_content import read_node
from skiros2_world_model.core.journal_file import read_note
from skiros2_world_model.core.scene import Node, Provenance


@dataclass
class ContextState:
    """A context as the journal has it.

    :param file: the one it was last loaded from or saved to, "" when with none.
    :param next_number: all numbers from this one on are free for ids.
    :param extras: what is beside elements, as N-Triples.
    """

    name: str
    file: str
    next_number: int
    nodes: list[Node] = field(default_factory=list)
    relations: list[tuple[str, str, str]] = field(default_factory=list)
    extras: list[str] = field(default_factory=list)


@dataclass
class JournalState:
    """A world model as the journal has it.

    :param session: of the snapshot ids.
    :param number: of the last change.
    :param last: the last request: what it was made of.
    :param stated: what the ontologies say that their files do not say, as N-Triples.
    :param unstated: what they do not say although their files do.
    """

    session: str
    number: int
    last: Provenance
    contexts: list[ContextState]
    stated: list[str]
    unstated: list[str]

    def __str__(self) -> str:
        when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(self.last.stamp))
        size = ", ".join(f"{len(context.nodes)} elements in {context.name}" for context in self.contexts)
        return f"{size}; the last change was made by {self.last.author}, {when}"


def read_state(db: sqlite3.Connection) -> JournalState:
    """All that is so now, elements and relations in the order in which they came.

    :raises sqlite3.DatabaseError, ValueError, LookupError, TypeError: the journal is damaged.
    """
    session = read_note(db, "session")
    contexts = {name: ContextState(name, *more) for name, *more in db.execute("SELECT * FROM context ORDER BY rowid")}
    made: dict[tuple[int, float, str], Provenance] = {}
    rows = db.execute("SELECT context, id, content, made, stamp, author FROM element ORDER BY rowid")
    for context, eid, content, *change in rows:
        key = (change[0], change[1], change[2])
        known = made.get(key) or made.setdefault(key, Provenance(*key))
        contexts[context].nodes.append(read_node(eid, content, known))
    for context, *relation in db.execute("SELECT context, src, pred, dst FROM relation ORDER BY rowid"):
        contexts[context].relations.append((relation[0], relation[1], relation[2]))
    stated: dict[bool, list[str]] = {True: [], False: []}
    for context, triple, present in db.execute("SELECT context, triple, present FROM statement ORDER BY rowid"):
        (stated[bool(present)] if context == ONTOLOGY else contexts[context].extras).append(triple)
    request = "SELECT last, number, stamp, author FROM request ORDER BY number DESC LIMIT 1"
    number, *last = db.execute(request).fetchone()
    return JournalState(str(session), number, Provenance(*last), list(contexts.values()), stated[True], stated[False])
