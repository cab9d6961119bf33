"""What one request writes into the journal."""

from __future__ import annotations

from collections.abc import Iterable
from types import TracebackType

from skiros2_world_model.core.context_names import ONTOLOGY
from skiros2_world_model.core.journal_content import element_text
from skiros2_world_model.core.journal_file import JournalFile, JournalTransaction
from skiros2_world_model.core.scene import Provenance, Scene

#: The tables whose rows have a time, and the columns that they share with those of the past.
_TABLES = {
    "element": "context, id, since, content",
    "relation": "context, src, pred, dst, since",
    "statement": "context, triple, present, since",
}
#: Rows go to the past.
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
    """Writes what is other after one request.

    :param made: the request's first change.
    :param last: the number of its last change.
    :param action: as `HistoryEntry` tells it.
    :param next_numbers: those that the journal has of the contexts, as far as known.
    """

    def __init__(
        self,
        file: JournalFile,
        made: Provenance,
        last: int,
        action: str,
        context: str,
        next_numbers: dict[str, int],
    ) -> None:
        super().__init__(file)
        self._made = made
        self._maker = made.version, made.stamp, made.author
        self._row = made.version, last, made.stamp, made.author, action, context
        self._next_numbers = next_numbers

    def __exit__(self, kind: type | None, error: Exception | None, trace: TracebackType | None) -> None:
        done = False
        try:
            super().__exit__(kind, error, trace)
            done = error is None
        finally:
            if not done:
                self._next_numbers.clear()  # what the journal has is not known any more

    def _finish(self) -> None:
        self.db.execute(_REQUEST, self._row)
        super()._finish()

    def clear(self, context: str = "") -> None:
        """Nothing is in a context any more; with "" in none, and there are no contexts."""
        where, names = ("WHERE context=?", (context,)) if context else ("", ())
        for table in _TABLES:
            self.db.execute(_END[table] + where, (self._made.version, *names))
            self.db.execute(f"DELETE FROM {table} {where}", names)
        if not context:
            self.db.execute("DELETE FROM context")
            self._next_numbers.clear()

    def whole(self, context: str, scene: Scene, extras: Iterable[str], file: str) -> None:
        """A context is this and nothing else. Its elements know of their last change already.

        :param extras: what is beside elements, as N-Triples.
        """
        self.clear(context)
        self._context(context, scene)
        self.db.execute("UPDATE context SET file=? WHERE name=?", (file, context))
        number = self._made.version
        elements = (
            (context, n.id, number, n.made.version, n.made.stamp, n.made.author, element_text(n)) for n in scene
        )
        self.db.executemany(_NEW_ELEMENT, elements)
        relations = ((context, *relation, number) for relation in scene.relations())
        self.db.executemany("INSERT INTO relation VALUES (?,?,?,?,?)", relations)
        statements = ((context, triple, number) for triple in extras)
        self.db.executemany("INSERT OR IGNORE INTO statement VALUES (?,?,1,?)", statements)

    def step(self, context: str, scene: Scene) -> None:
        """What was changed in a scene since its `begin`."""
        self._context(context, scene)
        step = scene.step
        for eid in step.contents:
            node = scene.node(eid)
            self._element(context, eid, None if node is None else element_text(node))
        for relation in step.relations:
            self._relation((context, *relation), scene.related(*relation))
        for eid in step.elements() if step.relations else ():
            if eid not in step.contents and eid in scene:
                made = (*self._maker, context, eid)
                self.db.execute(f"UPDATE element SET made=?, stamp=?, author=? {_THE_ELEMENT}", made)

    def ontology(self, removed: Iterable[str], added: Iterable[str]) -> None:
        """The ontologies say these no more, and those from now on; both as N-Triples."""
        number = self._made.version
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
        number, key = self._made.version, (context, eid)
        existed = self.db.execute(_END_ELEMENT, (number, *key)).rowcount
        if content is None:
            self.db.execute(f"DELETE FROM element {_THE_ELEMENT}", key)
        elif existed:
            self.db.execute(_CHANGE_ELEMENT, (number, *self._maker, content, *key))
        else:
            self.db.execute(_NEW_ELEMENT, (*key, number, *self._maker, content))

    def _relation(self, key: tuple[str, ...], exists: bool) -> None:
        number = self._made.version
        if exists:
            self.db.execute("INSERT OR IGNORE INTO relation VALUES (?,?,?,?,?)", (*key, number))
        elif self.db.execute(_END["relation"] + _THE_RELATION, (number, *key)).rowcount:
            self.db.execute(f"DELETE FROM relation {_THE_RELATION}", key)
