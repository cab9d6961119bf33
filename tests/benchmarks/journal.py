"""What the journal costs: a restart after a kill beside a load of the same scene, and an update with and without it."""

from __future__ import annotations

import gc
import logging
import random
import sqlite3
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.measurement import Measurement, paired, seconds_per_call
from skiros2_common.core.element_content import ElementChanges
from skiros2_common.core.operations import Add, Patch
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.world_model import WorldModel

ELEMENTS = 100_000
ENTRIES = 10_000
UPDATES = 2_000
NUMBERS = [f"skiros:{kind}{axis}" for kind in ("Position", "Orientation", "Size") for axis in "XYZ"]


def measure(folder: Path) -> Iterator[Measurement]:
    logging.disable(logging.WARNING)
    try:
        yield _restart(folder)
        yield from _updates(folder)
    finally:
        logging.disable(logging.NOTSET)


def _restart(folder: Path) -> Measurement:
    """Both make a world model with 100 000 elements: from its journal, and from the file that it was saved to."""
    path = folder / "restart.journal"
    model = _model(folder, path)
    model.transact([Add(_element(number)) for number in range(1, ELEMENTS + 1)], "bench")
    _update(model, ENTRIES)
    model.save("large.ttl")
    model._journal.close(clean=False)
    del model

    def restart() -> float:
        gc.collect()  # the model before it
        start = time.perf_counter()
        again = _model(folder, path)
        seconds = time.perf_counter() - start
        assert again.recovered and len(again.scene()) == ELEMENTS + 1
        again._journal.close(clean=False)
        return seconds

    def load() -> float:
        gc.collect()
        start = time.perf_counter()
        fresh = WorldModel(source_ontologies(), folder, initial=[("scene", "large.ttl")])
        seconds = time.perf_counter() - start
        assert len(fresh.scene()) == ELEMENTS + 1
        return seconds

    name = f"restart after a kill: {ELEMENTS} elements, {ENTRIES} journal entries"
    return paired(name, restart, "start that loads the same scene", load, unit="s", runs=2, warm_up=0, target=1.5)


def _updates(folder: Path) -> Iterator[Measurement]:
    """One property of one of 5000 elements, in process, with the journal and without, and SQLite alone."""
    models = [_model(folder, folder / "updates.journal"), _model(folder, None)]
    for model in models:
        model.transact([Add(_element(number)) for number in range(1, 5001)], "bench")
    on, off = ((lambda model=model: _update(model, UPDATES, 5000)) for model in models)
    yield paired("update of a property, journal on", on, "journal off", off, unit="µs", runs=15)
    alone = _sqlite(folder / "alone.db")
    name = "journal's part of an update"
    yield paired(name, lambda: on() - off(), "SQLite, one row in WAL mode", alone, unit="µs", runs=15)
    models[0]._journal.close(clean=False)


def _model(folder: Path, journal: Path | None) -> WorldModel:
    return WorldModel(source_ontologies(), folder, journal=Journal(journal) if journal is not None else None)


def _element(number: int) -> Element:
    """An element as scenes have them: a pose, a size, some flags and names."""
    element = Element("skiros:Product", f"product {number % 50}", f"skiros:Product-{number}")
    for key in NUMBERS:
        element.setProperty(key, random.random())
    element.setProperty("skiros:PublishTf", True)
    element.setProperty("skiros:BaseFrameId", "map")
    element.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    return element


def _update(model: WorldModel, count: int, among: int = ELEMENTS) -> float:
    """Writes a property of random elements, so many times; the mean time (µs)."""
    requests = [
        [
            Patch(
                f"skiros:Product-{random.randint(1, among)}",
                ElementChanges({"skiros:PositionX": Property("skiros:PositionX", random.random())}),
            )
        ]
        for _ in range(count)
    ]
    left = iter(requests)
    return 1e6 * seconds_per_call(lambda: model.transact(next(left), "bench"), count)


def _sqlite(path: Path) -> Callable[[], float]:
    """Transactions that write one row as long as an element each; the mean time (µs)."""
    db = sqlite3.connect(path, isolation_level=None)
    db.execute("PRAGMA journal_mode=WAL")
    db.execute("PRAGMA synchronous=NORMAL")
    db.execute("CREATE TABLE t (number INTEGER PRIMARY KEY, content TEXT)")

    def write() -> None:
        db.execute("BEGIN IMMEDIATE")
        db.execute("INSERT INTO t (content) VALUES (?)", ("x" * 500,))
        db.execute("COMMIT")

    return lambda: 1e6 * seconds_per_call(write, UPDATES)
