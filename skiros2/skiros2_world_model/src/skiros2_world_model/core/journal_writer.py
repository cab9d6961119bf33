"""Writes one request to the journal."""

from __future__ import annotations

from collections.abc import Iterable
from types import TracebackType

from skiros2_world_model.core.changes import ONTOLOGY
from skiros2_world_model.core.journal_file import JournalFile, JournalTransaction
from skiros2_world_model.core.journal_state import element_text
from skiros2_world_model.core.scene import Provenance, Scene

#: The versioned tables, and the columns that they share with their `past_` tables.
_TABLES = {
    "element": "context, id, since, content",
    "relation": "context, src, pred, dst, since",
    "statement": "context, triple, present, since",
}
#: Copies rows to the `past_` table.
_END = {
    table: f"INSERT INTO past_{table} (until, {columns}) SELECT ?, {columns} FROM {table} "
    for table, columns in _TABLES.items()
}
_REQUEST = "INSERT INTO request VALUES (?,?,?,?,?,?, (SELECT max(rowid) FROM past_element))"
_THE_ELEMENT = "WHERE context=? AND id=?"
_THE_RELATION = "WHERE context=? AND src=? AND pred=? AND dst=?"
_THE_STATEMENT = "WHERE context=? AND triple=?"

_END_ELEMENT = _END["element"] + _THE_ELEMENT
_CHANGE_ELEMENT = f"UPDATE element SET since=?, made=?, stamp=?, author=?, content=? {_THE_ELEMENT}"
_NEW_ELEMENT = "INSERT INTO element VALUES (?,?,?,?,?,?,?)"


class JournalWriter(JournalTransaction):
    """The transaction that writes one request.

    :param provenance: the provenance of the request's first change.
    :param last: the number of its last change.
    :param action: see `HistoryEntry`.
    :param next_numbers: a cache of the recorded id numbers of the contexts.
    """

    def __init__(
        self,
        file: JournalFile,
        provenance: Provenance,
        last: int,
        action: str,
        context: str,
        next_numbers: dict[str, int],
    ) -> None:
        super().__init__(file)
        self._number = provenance.version
        self._columns = _columns(provenance)
        self._row = provenance.version, last, provenance.stamp, provenance.author, action, context
        self._next_numbers = next_numbers

    def __exit__(self, kind: type | None, error: Exception | None, trace: TracebackType | None) -> None:
        done = False
        try:
            super().__exit__(kind, error, trace)
            done = error is None
        finally:
            if not done:
                self._next_numbers.clear()  # the transaction was rolled back

    def _finish(self) -> None:
        self.db.execute(_REQUEST, self._row)
        super()._finish()

    def clear(self, context: str = "") -> None:
        """Moves the content of a context to the past; with "" that of all contexts, and deletes the contexts."""
        where, names = ("WHERE context=?", (context,)) if context else ("", ())
        for table in _TABLES:
            self.db.execute(_END[table] + where, (self._number, *names))
            self.db.execute(f"DELETE FROM {table} {where}", names)
        if not context:
            self.db.execute("DELETE FROM context")
            self._next_numbers.clear()

    def replace_context(self, context: str, scene: Scene, extras: Iterable[str], file: str) -> None:
        """Replaces the content of a context. The records keep their own provenance.

        :param extras: its extra triples, as N-Triples.
        """
        self.clear(context)
        self._context(context, scene)
        self.db.execute("UPDATE context SET file=? WHERE name=?", (file, context))
        number = self._number
        elements = ((context, r.id, number, *_columns(r.provenance), element_text(r)) for r in scene)
        self.db.executemany(_NEW_ELEMENT, elements)
        relations = ((context, *relation, number) for relation in scene.relations())
        self.db.executemany("INSERT INTO relation VALUES (?,?,?,?,?)", relations)
        statements = ((context, triple, number) for triple in extras)
        self.db.executemany("INSERT OR IGNORE INTO statement VALUES (?,?,1,?)", statements)

    def change_set(self, context: str, scene: Scene) -> None:
        """Writes the change set of a scene."""
        self._context(context, scene)
        changes = scene.change_set
        for eid in changes.records:
            record = scene.record(eid)
            self._element(context, eid, None if record is None else element_text(record))
        for relation in changes.relations:
            self._relation((context, *relation), scene.related(*relation))
        for eid in changes.elements() if changes.relations else ():
            if eid not in changes.records and eid in scene:
                row = (*self._columns, context, eid)
                self.db.execute(f"UPDATE element SET made=?, stamp=?, author=? {_THE_ELEMENT}", row)

    def ontology(self, removed: Iterable[str], added: Iterable[str]) -> None:
        """Writes removed and added triples of the ontologies, given as N-Triples."""
        number = self._number
        for triples, present in ((removed, 0), (added, 1)):
            for triple in triples:
                key = ONTOLOGY, triple
                self.db.execute(_END["statement"] + _THE_STATEMENT, (number, *key))
                self.db.execute(f"DELETE FROM statement {_THE_STATEMENT}", key)
                self.db.execute("INSERT INTO statement VALUES (?,?,?,?)", (*key, present, number))

    # -- rows --------------------------------------------------------------------------------------------------

    def _context(self, name: str, scene: Scene) -> None:
        number = scene.next_number
        if self._next_numbers.get(name) != number:
            row = "INSERT INTO context VALUES (?, '', ?)"
            self.db.execute(f"{row} ON CONFLICT (name) DO UPDATE SET next_number=excluded.next_number", (name, number))
            self._next_numbers[name] = number

    def _element(self, context: str, eid: str, content: str | None) -> None:
        number, key = self._number, (context, eid)
        existed = self.db.execute(_END_ELEMENT, (number, *key)).rowcount
        if content is None:
            self.db.execute(f"DELETE FROM element {_THE_ELEMENT}", key)
        elif existed:
            self.db.execute(_CHANGE_ELEMENT, (number, *self._columns, content, *key))
        else:
            self.db.execute(_NEW_ELEMENT, (*key, number, *self._columns, content))

    def _relation(self, key: tuple[str, ...], exists: bool) -> None:
        number = self._number
        if exists:
            self.db.execute("INSERT OR IGNORE INTO relation VALUES (?,?,?,?,?)", (*key, number))
        elif self.db.execute(_END["relation"] + _THE_RELATION, (number, *key)).rowcount:
            self.db.execute(f"DELETE FROM relation {_THE_RELATION}", key)


def _columns(provenance: Provenance) -> tuple[int, float, str]:
    """The values of the columns made, stamp and author."""
    return provenance.version, provenance.stamp, provenance.author
