"""A journal of weeks beside one of a morning: an update, `history`, `diff` and a restart must not cost more.

The rows are written to the file as requests write them, without the world model, which would take minutes for a million
entries. `weeks_month` has the ten million of a busy month.
"""

from __future__ import annotations

import logging
import random
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.journal import _element, _update
from benchmarks.measurement import Measurement, paired
from skiros2_common.core.operations import Add
from skiros2_world_model.core.history import History
from skiros2_world_model.core.journal import ALWAYS, Journal
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.world_model import WorldModel

FEW, MANY = 10_000, 1_000_000
ELEMENTS = 200
RUNS = 7
UPDATES = 200
#: The entries of a difference, and of the history of an element.
RECENT, LATEST = 500, 20
#: What the large journal may cost beside the small one.
FLAT = 1.5


def measure(folder: Path, entries: int = MANY) -> Iterator[Measurement]:
    """Measures a journal with that number of entries beside a small one."""
    logging.disable(logging.WARNING)
    few, many = (_Past(folder / f"weeks-{number}.journal", folder, number) for number in (FEW, entries))
    try:
        cases: list[tuple[str, str, Callable[[_Past], float], int]] = [
            ("an update", "µs", lambda past: past.update(), RUNS),
            (f"history of an element, the latest {LATEST} entries", "ms", lambda past: past.history(), RUNS),
            (f"diff of {RECENT} entries", "ms", lambda past: past.difference(), RUNS),
            ("restart", "s", lambda past: past.restart(), 1),
        ]
        for name, unit, call, runs in cases:
            yield paired(
                f"journal of {entries} entries: {name}",
                lambda call=call: call(many),  # type: ignore[misc]
                f"the same, {FEW} entries",
                lambda call=call: call(few),  # type: ignore[misc]
                unit=unit,
                runs=runs,
                warm_up=1 if runs > 1 else 0,
                target=FLAT,
            )
    finally:
        few.close()
        many.close()
        logging.disable(logging.NOTSET)


class _Past:
    """A world model with a journal with a number of entries."""

    def __init__(self, path: Path, folder: Path, entries: int) -> None:
        self._path, self._folder = path, folder
        self._model = self._start()
        self._model.transact([Add(_element(number)) for number in range(1, ELEMENTS + 1)], "bench")
        self._write(entries)
        self._model = self._start()  # numbers continue after the written ones
        self.update()

    def close(self) -> None:
        self._model._journal.close()  # type: ignore[union-attr]

    def update(self) -> float:
        """An update of a random element (µs)."""
        return _update(self._model, UPDATES, ELEMENTS)

    def history(self) -> float:
        """The latest changes of a random element (ms)."""
        eid = f"skiros:Product-{random.randint(1, ELEMENTS)}"
        return 1e3 * _seconds(lambda: self._model.history.changes(eid, limit=LATEST))

    def difference(self) -> float:
        """The difference between now and a number of entries ago (ms)."""
        history, now = self._model.history, self._model.number
        return 1e3 * _seconds(lambda: history.difference(since=now - RECENT))

    def restart(self) -> float:
        """A restart after a kill (s)."""
        self._model._journal.close(clean=False)  # type: ignore[union-attr]
        start = time.perf_counter()
        self._model = self._start()
        seconds = time.perf_counter() - start
        assert self._model.recovered and len(History(self._path).changes(limit=1)) == 1
        return seconds

    def _start(self) -> WorldModel:
        journal = Journal(self._path, recover=ALWAYS, max_bytes=1 << 40)
        return WorldModel(source_ontologies(), self._folder, journal=journal)

    def _write(self, entries: int) -> None:
        """Adds the rows of a number of updates of random elements, and closes the journal."""
        journal = self._model._journal
        assert journal is not None
        journal.flush()  # the elements may be in its log only
        first, now = self._model.number + 1, time.time()
        with journal._file.transaction() as db:
            products = "SELECT context, id, since, content FROM element WHERE id LIKE 'skiros:Product-%'"
            known = db.execute(products).fetchall()
            before = db.execute("SELECT max(rowid) FROM past_element").fetchone()[0] or 0
            rows = [[*row, row[3].replace("product", "article")] for row in known]

            def past() -> Iterator[tuple[object, ...]]:
                for number in range(first, first + entries):
                    row = rows[random.randrange(len(rows))]
                    yield (number, *row[:4])
                    row[2:] = number, row[4], row[3]  # the label changes

            requests = (
                (n, n, now + (n - first) * 1e-3, "bench", "change", "scene", before + n - first + 1)
                for n in range(first, first + entries)
            )
            db.executemany("INSERT INTO past_element VALUES (?,?,?,?,?)", past())
            db.executemany("INSERT INTO request VALUES (?,?,?,?,?,?,?)", requests)
            present = "UPDATE element SET since=?, content=? WHERE context=? AND id=?"
            db.executemany(present, ((r[2], r[3], r[0], r[1]) for r in rows))
        journal.close(clean=False)


def _seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start
