"""The history of a world model: past states and changes from its journal, the comparison of scenes, and both as text.

A point is the number of a change (int) or a time (float, s since the epoch). Queries never block the world model.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from skiros2_common.core.changeset import ChangeSet, ElementRecord, Pair, Relation, read_record
from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_common.core.operations import ONTOLOGY, SCENE
from skiros2_common.core.property import Property, same_value
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.formatting import format_element, format_relation, format_values, summary
from skiros2_world_model.core.journal import include_log
from skiros2_world_model.core.journal_file import read_meta, read_only

#: A point of the history: the number of a change (int), or a time (float, s since the epoch).
Point = int | float


@dataclass
class HistoryEntry:
    """The changes of a context in one request, or between two points of its history.

    An entry is false when nothing changed.

    :param number: the number of the first change of the request, or of the last request between the points.
    :param stamp: the time of that change (s since the epoch).
    :param action: `change`, `load FILE`, `ontology`, `start` (a start without recovery) or `difference`.
    """

    number: int
    stamp: float
    author: str
    action: str
    changes: ChangeSet = field(default_factory=ChangeSet)

    def __bool__(self) -> bool:
        """Whether anything changed."""
        return bool(self.changes)

    @property
    def before(self) -> list[Element]:
        """The changed and removed elements in their old state, with those outgoing relations that were removed."""
        return _elements((before for before, _ in self.changes.records.values()), self.unrelated)

    @property
    def after(self) -> list[Element]:
        """The changed and added elements in their new state, with those outgoing relations that were added."""
        return _elements((after for _, after in self.changes.records.values()), self.related)

    @property
    def related(self) -> list[RelationDict]:
        """The added relations, as dicts."""
        return [relation_dict(*relation) for relation, added in self.changes.relations.items() if added]

    @property
    def unrelated(self) -> list[RelationDict]:
        """The removed relations, as dicts."""
        return [relation_dict(*relation) for relation, added in self.changes.relations.items() if not added]

    @property
    def stated(self) -> list[str]:
        """The added RDF statements of the ontologies or beside elements, as N-Triples."""
        return [statement for statement, added in self.changes.statements.items() if added]

    @property
    def unstated(self) -> list[str]:
        """The removed RDF statements."""
        return [statement for statement, added in self.changes.statements.items() if not added]

    def pairs(self) -> list[tuple[Element | None, Element | None]]:
        """The old and the new state of each element; None where the element does not exist."""
        before, after = ({e.id: e for e in elements} for elements in (self.before, self.after))
        return [(before.get(eid), after.get(eid)) for eid in self.changes.records]

    def affects(self, names: Collection[str]) -> bool:
        """Whether an entry of a single element changes one of these properties or relations."""
        if any(pred in names for _, pred, _ in self.changes.relations):
            return True
        pairs = self.changes.records.values()
        return any(_values(before, name) != _values(after, name) for before, after in pairs for name in names)


def _elements(records: Iterable[ElementRecord | None], relations: Iterable[RelationDict]) -> list[Element]:
    elements = {record.id: _element(record) for record in records if record is not None}
    for relation in relations:
        if relation["src"] in elements:
            elements[relation["src"]].addRelation("-1", relation["type"], relation["dst"])
    return list(elements.values())


def _element(record: ElementRecord) -> Element:
    """A copy, as made by hand: writing it restores this state."""
    element = Element(record.type, record.label, record.id)
    for key, prop in record.properties.items():
        element.put(key, prop.clone())
    return element


def _values(record: ElementRecord | None, key: str) -> list[Any] | None:
    prop = record.properties.get(key) if record is not None else None
    return None if prop is None else prop.values


def changed_lines(entry: HistoryEntry) -> list[str]:
    """Formats an entry, one change per line: `+` added, `-` removed, `~` changed."""
    lines: list[str] = []
    for before, after in sorted(entry.changes.records.values(), key=lambda pair: pair[0] is None):  # added ones last
        if before is None and after is not None:
            element = after.element()
            lines.append(f"+ {format_element(element)}  {summary(element)}".rstrip())
        elif after is None and before is not None:
            lines.append(f"- {format_element(before.element())}")
        elif before is not None and after is not None:
            lines += _changed(before, after)
    lines += [f"- {format_relation(r)}" for r in entry.unrelated] + [f"+ {format_relation(r)}" for r in entry.related]
    return lines + [f"- {text}" for text in entry.unstated] + [f"+ {text}" for text in entry.stated]


def difference(old: Iterable[Element], new: Iterable[Element]) -> HistoryEntry:
    """Compares the elements of two scenes and their outgoing relations.

    A number equals its text; a property without values equals a missing one.
    """
    old, new = list(old), list(new)
    before, after = ({e.id: ElementRecord(e.id, e.type, e.label, e.property_view) for e in es} for es in (old, new))
    changes = ChangeSet()
    for eid in sorted({*before, *after}):
        pair: Pair = before.get(eid), after.get(eid)
        if pair[0] is None or pair[1] is None or _changed(pair[0], pair[1]):
            changes.records[eid] = pair
    one, other = _relations(old), _relations(new)
    changes.relations = dict.fromkeys(sorted(one - other), False) | dict.fromkeys(sorted(other - one), True)
    return HistoryEntry(0, 0.0, "", "difference", changes)


def _changed(before: ElementRecord, after: ElementRecord) -> list[str]:
    lines = []
    for name, one, other in (("type", before.type, after.type), ("label", before.label, after.label)):
        if one != other:
            lines.append(f"~ {after.id} {name}: {one or '(none)'} -> {other or '(none)'}")
    lines += [
        f"~ {after.id} {key}: {_text(was)} -> {_text(now)}" for key, was, now in changed_properties(before, after)
    ]
    return lines


def changed_properties(
    before: ElementRecord, after: ElementRecord
) -> Iterator[tuple[str, Property | None, Property | None]]:
    """Yields the properties with other values: key, old and new property; None: it was, or is, missing."""
    for key in sorted({*before.properties, *after.properties}):
        was, now = before.properties.get(key), after.properties.get(key)
        if not _same(was, now):
            yield key, was, now


def _same(one: Property | None, other: Property | None) -> bool:
    values, others = (sorted(prop.values, key=str) if prop is not None else [] for prop in (one, other))
    return len(values) == len(others) and all(map(same_value, values, others))


def _text(prop: Property | None) -> str:
    return format_values(prop.values) if prop is not None and prop.values else "(none)"


def _relations(elements: Iterable[Element]) -> set[Relation]:
    return {(e.id, r["type"], r["dst"]) for e in elements for r in e.relation_view if r["src"] == "-1"}


#: The key of a row: ("element", id), ("relation", src, pred, dst) or ("statement", triple).
_Key = tuple[str, ...]
#: By key, the contents before and after; None: absent.
_Changes = dict[_Key, tuple[Any, Any]]

_KEY_COLUMNS = {"element": "id", "relation": "src, pred, dst", "statement": "triple"}
_CONTENT = {"element": "content", "relation": "''", "statement": "present"}
#: Restricts past elements to those after a point by rowid, which is in the order of `until`.
_IN_ORDER = " AND rowid>coalesce((SELECT past FROM request WHERE number<=:first ORDER BY number DESC LIMIT 1), 0)"
_OF_ELEMENT = {"element": " AND id=:eid", "relation": " AND (src=:eid OR dst=:eid)"}


class History:
    """Reads the journal of a world model, which need not be running.

    :param path: the file of the journal.
    :param flush: has all requests so far written to it; None: those that a killed world model has left.
    """

    def __init__(self, path: Path, flush: Callable[[], None] | None = None) -> None:
        self._path = path
        self._flush = flush or (lambda: include_log(path))

    def changes(
        self,
        eid: str = "",
        since: Point | None = None,
        until: Point | None = None,
        author: str = "",
        limit: int = 0,
        context: str = SCENE,
    ) -> list[HistoryEntry]:
        """The changes after one point and up to another: an entry for each request, oldest first.

        :param eid: only changes of this element; "": all.
        :param since: None: the beginning of the journal.
        :param until: None: now.
        :param author: only changes by this author; "": all.
        :param limit: at most this number of entries, the latest ones; 0: all.
        :raises UnknownName: the element or context has never existed.
        :raises WrongValue: a point is outside the journal.
        :raises Refused: the journal cannot be read, or an entry of it is damaged.
        """
        with self._connection(context, eid) as db:
            first, last = self._between(db, since, until)
            first -= since is None  # include the first change of the journal
            if limit and not eid:
                first = max(first, _request_before(db, last, context, author, limit))
            latest = limit
            while True:
                start = max(first, _change_before(db, context, last, eid, latest)) if limit and eid else first
                entries = list(_entries(db, _changes(db, context, start, last, eid), author))
                if len(entries) >= limit or start == first:
                    return entries[-limit:]
                latest *= 4  # some were by other authors, or changed nothing

    def difference(self, since: Point | None = None, until: Point | None = None, context: str = SCENE) -> HistoryEntry:
        """The difference of a context between two points; false when there is none.

        :param since, until: None: the beginning of the journal, and now.
        :raises UnknownName, WrongValue, Refused: as for `changes`.
        """
        with self._connection(context) as db:
            first, last = self._between(db, since, until)
            total: _Changes = {}
            for _, changes in sorted(_changes(db, context, first, last).items()):
                for key, (was, now) in changes.items():
                    total[key] = total.get(key, (was, None))[0], now
            entry = _entry(db, last, total)
        entry.action = "difference"
        return entry

    def scene_at(self, at: Point | None = None, context: str = SCENE) -> HistoryEntry:
        """A past state of a context, as its difference from nothing.

        Number, time and author are those of the request that led to this state.

        :param at: None: now.
        :raises UnknownName, WrongValue, Refused: as for `changes`.
        """
        with self._connection(context) as db:
            _, number = self._between(db, None, at)
            state: _Changes = {}
            for key, _, _, content in _rows(db, context, number, number, current=True):
                state[key] = (None, content)
            entry = _entry(db, number, state)
        return entry

    # -- queries -----------------------------------------------------------------------------------------------

    @contextmanager
    def _connection(self, context: str, eid: str = "") -> Iterator[sqlite3.Connection]:
        """Opens a connection that sees one state of the journal; checks that the context and element are known."""
        self._flush()
        try:
            with closing(read_only(self._path)) as db:
                db.execute("BEGIN")
                _check_context(db, context)
                if eid and not _knows(db, context, eid):
                    raise UnknownName(f"the journal has no element {eid!r} in context {context!r}")
                yield db
        except sqlite3.Error as error:
            raise Refused(f"journal {self._path} cannot be read: {error}") from error

    def _between(self, db: sqlite3.Connection, since: Point | None, until: Point | None) -> tuple[int, int]:
        first = int(read_meta(db, "begin")) if since is None else _number(db, since)
        return first, _last(db) if until is None else _number(db, until)


def _number(db: sqlite3.Connection, point: Point) -> int:
    """The number of the last change at a point.

    :raises WrongValue: the point is outside the journal.
    """
    begin = read_meta(db, "begin")
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
    """The request before the last `limit` requests of an author in a context; 0 when there are fewer."""
    found = db.execute(
        "SELECT number FROM request WHERE number <= ? AND context IN ('', ?) AND (author=? OR ?='') "
        "ORDER BY number DESC LIMIT 1 OFFSET ?",
        (last, context, author, author, limit),
    ).fetchone()
    return int(found[0]) if found is not None else 0


def _change_before(db: sqlite3.Connection, context: str, last: int, eid: str, limit: int) -> int:
    """A change up to which an element's history can be skipped for its last `limit` changes; -1: none."""
    numbers: set[int] = set()
    names = {"context": context, "eid": eid, "last": last, "limit": limit + 1}
    for source, until, key in (
        ("element", "since", "id"),
        ("past_element", "until", "id"),
        ("relation", "since", "src"),
        ("relation", "since", "dst"),
        ("past_relation", "until", "src"),
        ("past_relation", "until", "dst"),
    ):
        order = f"ORDER BY {'rowid' if source == 'past_element' else until} DESC LIMIT :limit"
        where = f"context=:context AND {key}=:eid AND since<=:last"
        for row in db.execute(f"SELECT since, {until} FROM {source} WHERE {where} {order}", names):
            numbers.update(number for number in row if number <= last)
    latest = sorted(numbers, reverse=True)
    return latest[limit] if len(latest) > limit else -1


def _check_context(db: sqlite3.Connection, context: str) -> None:
    known = "SELECT 1 FROM context WHERE name=:c UNION ALL SELECT 1 FROM request WHERE context=:c LIMIT 1"
    if context != ONTOLOGY and not db.execute(known, {"c": context}).fetchone():
        names = ", ".join(sorted(name for (name,) in db.execute("SELECT name FROM context")))
        raise UnknownName(f"the journal has no context {context!r}; it has: {names}")


def _knows(db: sqlite3.Connection, context: str, eid: str) -> bool:
    where = "WHERE context=:c AND id=:e"
    found = db.execute(
        f"SELECT 1 FROM element {where} UNION ALL SELECT 1 FROM past_element {where} LIMIT 1", {"c": context, "e": eid}
    )
    return found.fetchone() is not None


def _rows(
    db: sqlite3.Connection, context: str, first: int, last: int, eid: str = "", current: bool = False
) -> Iterator[tuple[_Key, int, int | None, Any]]:
    """Rows that began or ended after `first` and began no later than `last`: key, since, until, content.

    :param current: includes current rows that began before `first`.
    """
    names = {"context": context, "first": first, "last": last, "eid": eid}
    for table, key in _KEY_COLUMNS.items():
        if eid and table not in _OF_ELEMENT:
            continue
        which = f"context=:context AND since<=:last{_OF_ELEMENT[table] if eid else ''}"
        present = which + ("" if current else " AND since>:first")
        past = f"{which} AND until>:first"
        if table == "element":
            past += _IN_ORDER
            # With `+`, SQLite takes the range of rowids, not the index of all past elements of the context.
            past = past if eid else f"+{past}"
        for source, until, where in ((table, "NULL", present), (f"past_{table}", "until", past)):
            columns = f"since, {until}, {_CONTENT[table]}, {key}"
            for row in db.execute(f"SELECT {columns} FROM {source} WHERE {where}", names):
                yield (table, *row[3:]), row[0], row[1], row[2]


def _changes(db: sqlite3.Connection, context: str, first: int, last: int, eid: str = "") -> dict[int, _Changes]:
    """The changes of the requests after `first` and up to `last`, by request number."""
    found: dict[int, _Changes] = {}
    for key, since, until, content in _rows(db, context, first, last, eid):
        if since > first:
            changes = found.setdefault(since, {})
            changes[key] = changes.get(key, (None, None))[0], content
        if until is not None and until <= last:
            changes = found.setdefault(until, {})
            changes[key] = content, changes.get(key, (None, None))[1]
    return found


def _entries(db: sqlite3.Connection, found: dict[int, _Changes], author: str) -> Iterator[HistoryEntry]:
    """The entries of requests by an author ("": any) that have changed something, oldest first."""
    for number, changes in sorted(found.items()):
        entry = _entry(db, number, changes)
        if entry and (not author or entry.author == author):
            yield entry


def _entry(db: sqlite3.Connection, number: int, changes: _Changes) -> HistoryEntry:
    """An entry with these changes, for the request with this number or the last one before it."""
    request = "SELECT number, stamp, author, action FROM request WHERE number <= ? ORDER BY number DESC LIMIT 1"
    entry = HistoryEntry(*db.execute(request, (number,)).fetchone())
    found = entry.changes
    for (table, *key), (was, now) in changes.items():
        if was == now:
            continue
        if table == "element":
            found.put(key[0], _record(key[0], was), _record(key[0], now))
        elif table == "relation":
            found.relate((key[0], key[1], key[2]), now is not None)
        else:
            # A row with present = 0 removes a triple of a file; without a row, the file applies.
            found.statements[key[0]] = bool(now if now is not None else not was)
    return entry


def _record(eid: str, content: str | None) -> ElementRecord | None:
    try:
        return None if content is None else read_record(eid, content)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise sqlite3.DatabaseError(f"a past state of {eid} is damaged: {error}") from error
