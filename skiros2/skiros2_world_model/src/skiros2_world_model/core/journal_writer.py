"""What one request writes into the journal."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable

from skiros2_world_model.core.context_names import ONTOLOGY
from skiros2_world_model.core.journal_content import element_text
from skiros2_world_model.core.scene import Provenance, Scene

#: The tables whose rows have a time, and the columns that they share with those of the past.
_TABLES = {
    "element": "context, id, since, content",
    "relation": "context, src, pred, dst, since",
    "statement": "context, triple, present, since",
}


class JournalWriter:
    """Writes what is other after a request, within its transaction.

    :param made: the request's first change.
    :param next_numbers: those that the journal has of the contexts, as far as known.
    """

    def __init__(self, db: sqlite3.Connection, made: Provenance, next_numbers: dict[str, int]) -> None:
        self._db = db
        self._made = made
        self._next_numbers = next_numbers

    def clear(self, context: str = "") -> None:
        """Nothing is in a context any more; with "" in none, and there are no contexts."""
        where, names = ("WHERE context=?", (context,)) if context else ("", ())
        for table, columns in _TABLES.items():
            self._db.execute(
                f"INSERT INTO past_{table} (until, {columns}) SELECT ?, {columns} FROM {table} {where}",
                (self._made.version, *names),
            )
            self._db.execute(f"DELETE FROM {table} {where}", names)
        if not context:
            self._db.execute("DELETE FROM context")
            self._next_numbers.clear()

    def whole(self, context: str, scene: Scene, extras: Iterable[str], file: str) -> None:
        """A context is this and nothing else. Its elements know of their last change already.

        :param extras: what is beside elements, as N-Triples.
        """
        self.clear(context)
        self._context(context, scene)
        self._db.execute("UPDATE context SET file=? WHERE name=?", (file, context))
        number = self._made.version
        elements = (
            (context, n.id, number, n.made.version, n.made.stamp, n.made.author, element_text(n)) for n in scene
        )
        self._db.executemany("INSERT INTO element VALUES (?,?,?,?,?,?,?)", elements)
        relations = ((context, *relation, number) for relation in scene.relations())
        self._db.executemany("INSERT INTO relation VALUES (?,?,?,?,?)", relations)
        statements = ((context, triple, number) for triple in extras)
        self._db.executemany("INSERT OR IGNORE INTO statement VALUES (?,?,1,?)", statements)

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
                where = (*self._maker, context, eid)
                self._db.execute("UPDATE element SET made=?, stamp=?, author=? WHERE context=? AND id=?", where)

    def ontology(self, removed: Iterable[str], added: Iterable[str]) -> None:
        """The ontologies say these no more, and those from now on; both as N-Triples."""
        number = self._made.version
        for triples, present in ((removed, 0), (added, 1)):
            for triple in triples:
                self._end("statement", "context=? AND triple=?", (ONTOLOGY, triple))
                self._db.execute("DELETE FROM statement WHERE context=? AND triple=?", (ONTOLOGY, triple))
                self._db.execute("INSERT INTO statement VALUES (?,?,?,?)", (ONTOLOGY, triple, present, number))

    # -- rows --------------------------------------------------------------------------------------------------

    @property
    def _maker(self) -> tuple[int, float, str]:
        return self._made.version, self._made.stamp, self._made.author

    def _context(self, name: str, scene: Scene) -> None:
        number = scene.next_number
        if self._next_numbers.get(name) != number:
            row = "INSERT INTO context VALUES (?, '', ?)"
            self._db.execute(f"{row} ON CONFLICT (name) DO UPDATE SET next_number=excluded.next_number", (name, number))
            self._next_numbers[name] = number

    def _element(self, context: str, eid: str, content: str | None) -> None:
        key = (context, eid)
        existed = self._end("element", "context=? AND id=?", key)
        if content is None:
            self._db.execute("DELETE FROM element WHERE context=? AND id=?", key)
        elif existed:
            columns = "since=?, made=?, stamp=?, author=?, content=?"
            row = (self._made.version, *self._maker, content, *key)
            self._db.execute(f"UPDATE element SET {columns} WHERE context=? AND id=?", row)
        else:
            new = (*key, self._made.version, *self._maker, content)
            self._db.execute("INSERT INTO element VALUES (?,?,?,?,?,?,?)", new)

    def _relation(self, key: tuple[str, ...], exists: bool) -> None:
        if exists:
            self._db.execute("INSERT OR IGNORE INTO relation VALUES (?,?,?,?,?)", (*key, self._made.version))
        elif self._end("relation", "context=? AND src=? AND pred=? AND dst=?", key):
            self._db.execute("DELETE FROM relation WHERE context=? AND src=? AND pred=? AND dst=?", key)

    def _end(self, table: str, where: str, key: tuple[str, ...]) -> bool:
        """A row goes to the past; False when there is none."""
        columns = _TABLES[table]
        statement = f"INSERT INTO past_{table} (until, {columns}) SELECT ?, {columns} FROM {table} WHERE {where}"
        return self._db.execute(statement, (self._made.version, *key)).rowcount > 0
