"""The past of a world model, as its journal tells it: the scene at a time, what was changed, when and by whom.

A point is the number of a change (int) or a time (float, s since the epoch). Each question sees one state of the
journal and holds up no request.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_common.core.names import full_name
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import relation_dict
from skiros2_world_model.core.context_names import ONTOLOGY, SCENE
from skiros2_world_model.core.history_entry import HistoryEntry, Point
from skiros2_world_model.core.journal_content import read_node
from skiros2_world_model.core.journal_file import read_note, read_only
from skiros2_world_model.core.scene import Provenance

#: What is journalled: an element ("element", id), a relation ("relation", src, pred, dst), a statement ("statement",
#: triple).
_Key = tuple[str, ...]
#: By key, what it was before and what it is after; None: not there.
_Changes = dict[_Key, tuple[Any, Any]]

_KEY_COLUMNS = {"element": "id", "relation": "src, pred, dst", "statement": "triple"}
_CONTENT = {"element": "content", "relation": "''", "statement": "present"}
#: Finds the rows of elements after a point without an index, as they are in that order.
_IN_ORDER = " AND rowid>coalesce((SELECT past FROM request WHERE number<=:first ORDER BY number DESC LIMIT 1), 0)"
_OF_ELEMENT = {"element": " AND id=:eid", "relation": " AND (src=:eid OR dst=:eid)"}


class History:
    """Asks the journal of a world model, which may be running or not.

    :param path: the journal's file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def changes(
        self,
        eid: str = "",
        since: Point | None = None,
        until: Point | None = None,
        author: str = "",
        limit: int = 0,
        context: str = SCENE,
    ) -> list[HistoryEntry]:
        """What was changed after a point and up to another one: an entry for each request, oldest first.

        :param eid: only changes of this element; "" of all.
        :param since: None: from the journal's beginning on.
        :param until: None: up to now.
        :param author: only what this author did; "" all.
        :param limit: so many entries at most, the last ones; 0: all.
        :raises UnknownName: there was never such an element or context.
        :raises WrongValue: the journal does not reach to a point.
        """
        with self._asked(context, eid) as db:
            first, last = self._between(db, since, until)
            first -= since is None  # the change that it begins with, too
            if limit and not eid:
                first = max(first, _request_before(db, last, context, author, limit))
            entries: list[HistoryEntry] = []
            for number, changes in sorted(_changes(db, context, first, last, eid).items()):
                entry = _entry(db, number, changes)
                if entry and (not author or entry.author == author):
                    entries.append(entry)
        return entries[-limit:]

    def last_change(self, eid: str, name: str = "", dst: str = "", context: str = SCENE) -> HistoryEntry | None:
        """The last request that changed an element, or one property or relation of it; None when none is known.

        :param name: the property or relation; "" any.
        :param dst: the object of the relation; "" any.
        :raises UnknownName: as for `changes`.
        """
        entries = self.changes(eid, context=context)
        return next((e for e in reversed(entries) if not name or e.touches((full_name(name),), dst)), None)

    def difference(self, since: Point | None = None, until: Point | None = None, context: str = SCENE) -> HistoryEntry:
        """What is other in a context at one point than it was at another; false when nothing is.

        :param since, until: None: at the journal's beginning, and now.
        :raises UnknownName, WrongValue: as for `changes`.
        """
        with self._asked(context) as db:
            first, last = self._between(db, since, until)
            total: _Changes = {}
            for _, changes in sorted(_changes(db, context, first, last).items()):
                for key, (was, now) in changes.items():
                    total[key] = total.get(key, (was, None))[0], now
            entry = _entry(db, last, total)
        entry.action = "difference"
        return entry

    def scene_at(self, at: Point | None = None, context: str = SCENE) -> HistoryEntry:
        """A context as it was: `after` has its elements, each with its outgoing relations.

        The entry tells of the request that led to this state.

        :param at: None: now.
        :raises UnknownName, WrongValue: as for `changes`.
        """
        with self._asked(context) as db:
            _, number = self._between(db, None, at)
            state: _Changes = {}
            for key, _, _, content in _rows(db, context, number, number, standing=True):
                state[key] = (None, content)
            entry = _entry(db, number, state)
        elements = {element.id: element for element in entry.after}
        for relation in entry.related:
            if relation["src"] in elements:
                elements[relation["src"]].addRelation("-1", relation["type"], relation["dst"])
        entry.related = []
        return entry

    # -- asking ------------------------------------------------------------------------------------------------

    @contextmanager
    def _asked(self, context: str, eid: str = "") -> Iterator[sqlite3.Connection]:
        """A connection for one question about something that is known."""
        try:
            with closing(read_only(self._path)) as db:
                db.execute("BEGIN")
                _check_context(db, context)
                if eid and not _knows(db, context, eid):
                    raise UnknownName(f"the journal knows no element {eid!r} in context {context!r}")
                yield db
        except sqlite3.Error as error:
            raise Refused(f"journal {self._path} cannot be read: {error}") from error

    def _between(self, db: sqlite3.Connection, since: Point | None, until: Point | None) -> tuple[int, int]:
        first = int(read_note(db, "begin")) if since is None else _number(db, since)
        return first, _last(db) if until is None else _number(db, until)


def _number(db: sqlite3.Connection, point: Point) -> int:
    """The number of the last change at a point.

    :raises WrongValue: the journal does not reach to it.
    """
    begin = read_note(db, "begin")
    if isinstance(point, int):
        if point > _last(db):
            raise WrongValue(f"there is no change {point} yet; the last one is {_last(db)}")
        number = point
    else:
        before = "SELECT last FROM request WHERE stamp <= ? ORDER BY number DESC LIMIT 1"
        found = db.execute(before, (point,)).fetchone()
        number = found[0] if found is not None else 0
    if number < begin:
        stamp = db.execute("SELECT stamp FROM request WHERE number=?", (begin,)).fetchone()[0]
        when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(stamp))
        raise WrongValue(f"the journal begins with change {begin} of {when}; it does not reach back to {point}")
    return int(number)


def _last(db: sqlite3.Connection) -> int:
    return int(db.execute("SELECT last FROM request ORDER BY number DESC LIMIT 1").fetchone()[0])


def _request_before(db: sqlite3.Connection, last: int, context: str, author: str, limit: int) -> int:
    """The request before the last so many of an author in a context; 0 when there are not so many."""
    found = db.execute(
        "SELECT number FROM request WHERE number <= ? AND context IN ('', ?) AND (author=? OR ?='') "
        "ORDER BY number DESC LIMIT 1 OFFSET ?",
        (last, context, author, author, limit),
    ).fetchone()
    return int(found[0]) if found is not None else 0


def _check_context(db: sqlite3.Connection, context: str) -> None:
    known = "SELECT 1 FROM context WHERE name=:c UNION ALL SELECT 1 FROM request WHERE context=:c LIMIT 1"
    if context != ONTOLOGY and not db.execute(known, {"c": context}).fetchone():
        names = ", ".join(sorted(name for (name,) in db.execute("SELECT name FROM context")))
        raise UnknownName(f"the journal knows no context {context!r}; it has: {names}")


def _knows(db: sqlite3.Connection, context: str, eid: str) -> bool:
    where = "WHERE context=:c AND id=:e"
    found = db.execute(
        f"SELECT 1 FROM element {where} UNION ALL SELECT 1 FROM past_element {where} LIMIT 1", {"c": context, "e": eid}
    )
    return found.fetchone() is not None


def _rows(
    db: sqlite3.Connection, context: str, first: int, last: int, eid: str = "", standing: bool = False
) -> Iterator[tuple[_Key, int, int | None, Any]]:
    """What came or went after the first number and came not later than the last: key, since, until, content.

    :param standing: what came before and is there still, too.
    """
    names = {"context": context, "first": first, "last": last, "eid": eid}
    for table, key in _KEY_COLUMNS.items():
        if eid and table not in _OF_ELEMENT:
            continue
        which = f"context=:context AND since<=:last{_OF_ELEMENT[table] if eid else ''}"
        present = "" if standing else " AND since>:first"
        past = " AND until>:first" + (_IN_ORDER if table == "element" and not eid else "")
        for source, until, more in ((table, "NULL", present), (f"past_{table}", "until", past)):
            columns = f"since, {until}, {_CONTENT[table]}, {key}"
            for row in db.execute(f"SELECT {columns} FROM {source} WHERE {which}{more}", names):
                yield (table, *row[3:]), row[0], row[1], row[2]


def _changes(db: sqlite3.Connection, context: str, first: int, last: int, eid: str = "") -> dict[int, _Changes]:
    """What the requests after the first number, up to the last, have changed, by their numbers."""
    found: dict[int, _Changes] = {}
    for key, since, until, content in _rows(db, context, first, last, eid):
        if since > first:
            changes = found.setdefault(since, {})
            changes[key] = changes.get(key, (None, None))[0], content
        if until is not None and until <= last:
            changes = found.setdefault(until, {})
            changes[key] = content, changes.get(key, (None, None))[1]
    return found


def _entry(db: sqlite3.Connection, number: int, changes: _Changes) -> HistoryEntry:
    """What the request with that number, or with the last one before it, is told to have changed."""
    request = "SELECT number, stamp, author, action FROM request WHERE number <= ? ORDER BY number DESC LIMIT 1"
    entry = HistoryEntry(*db.execute(request, (number,)).fetchone())
    for (table, *key), (was, now) in changes.items():
        if was == now:
            continue
        if table == "element":
            entry.before += _elements(key[0], was)
            entry.after += _elements(key[0], now)
        elif table == "relation":
            (entry.unrelated if now is None else entry.related).append(relation_dict(*key))
        else:
            # a row may also say that a statement of a file is taken away; without any it is as in the file
            is_stated = now if now is not None else not was
            (entry.stated if is_stated else entry.unstated).append(key[0])
    return entry


def _elements(eid: str, content: str | None) -> list[Element]:
    if content is None:
        return []
    node = read_node(eid, content, Provenance())
    element = Element(node.type, node.label, eid)
    for key, prop in node.properties.items():
        element._put(key, prop)
    return [element]
