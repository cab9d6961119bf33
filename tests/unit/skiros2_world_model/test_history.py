"""The history: past states and changes, with their times and authors."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_world_model.core import history
from skiros2_world_model.core.history import History
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.world_model import WorldModel

SCENE = "skiros:Scene-0"


@pytest.fixture
def model(tmp_path: Path) -> Iterator[WorldModel]:
    journal = Journal(tmp_path / "wm.journal")
    yield WorldModel(None, tmp_path, journal=journal)
    journal.close()


@pytest.fixture
def mary(model: WorldModel) -> LocalWorldModel:
    return LocalWorldModel("mary", model)


@pytest.fixture
def paul(model: WorldModel) -> LocalWorldModel:
    return LocalWorldModel("paul", model)


def box(wm: LocalWorldModel, **properties: object) -> Element:
    element = Element("skiros:LargeBox")
    for key, value in properties.items():
        element.setProperty(key, value)
    wm.add_element(element)
    return element


def test_the_last_change_of_an_element_a_property_and_a_relation(mary: LocalWorldModel, paul: LocalWorldModel) -> None:
    tray = box(mary, Weight=1.0, Color="red")
    paul.set_relation(SCENE, "skiros:contain", tray)
    tray = paul.get_element(tray.id)
    tray.setProperty("Weight", 2.0)
    paul.update_element(tray)
    entries = mary.history(tray.id)[::-1]
    names = ("skiros:Weight", "skiros:Color", "skiros:contain")
    last = [next(entry for entry in entries if entry.affects([name])) for name in names]
    assert [entry.author for entry in last] == ["paul", "mary", "paul"]
    assert entries[0].number == last[0].number == tray.version
    assert not any(entry.affects(["skiros:Size"]) for entry in entries)


def test_an_element_that_is_gone_has_a_history(mary: LocalWorldModel, paul: LocalWorldModel) -> None:
    tray = box(mary, Weight=1.0)
    paul.remove_element(tray.id)
    [made, removed] = mary.history(tray.id)
    assert (made.author, made.before, [e.id for e in made.after]) == ("mary", [], [tray.id])
    assert (removed.author, [e.id for e in removed.before], removed.after) == ("paul", [tray.id], [])


def test_a_request_is_one_entry_with_all_that_it_changed(mary: LocalWorldModel) -> None:
    number = mary.model.number
    child, parent = Element("skiros:Starter"), Element("skiros:LargeBox")
    parent.addRelation("-1", "skiros:contain", child)
    mary.add_element(parent)
    [entry] = mary.history(since=number)
    assert {e.type for e in entry.after} == {"skiros:Starter", "skiros:LargeBox"}
    assert [(r["src"], r["type"]) for r in entry.related] == [(parent.id, "skiros:contain")]


def test_entry_of_a_load_has_its_file_and_the_difference(mary: LocalWorldModel) -> None:
    kept, removed = box(mary, Weight=1.0), box(mary)
    mary.save("cell.ttl")
    mary.remove_element(removed.id)
    added = box(mary)
    number = mary.model.number
    mary.load("cell.ttl")
    [entry] = mary.history(since=number)
    assert entry.action == "load cell.ttl"
    assert [e.id for e in entry.before] == [added.id]
    assert [e.id for e in entry.after] == [removed.id]
    assert kept.id in {e.id for e in mary.model.history.scene_at().after}


def test_contexts_have_histories_of_their_own(mary: LocalWorldModel) -> None:
    mary.add_element(Element("skiros:LargeBox"), "memory")
    [entry] = mary.history(context_id="memory")
    assert [e.type for e in entry.after] == ["skiros:LargeBox"]
    assert "skiros:LargeBox-1" not in {e.id for entry in mary.history() for e in entry.after}


def test_statements_of_the_ontologies_have_a_history(mary: LocalWorldModel, paul: LocalWorldModel) -> None:
    number = mary.model.number
    mary.add_class("skiros:NewBox", "skiros:LargeBox")
    paul.model.modify([("skiros:NewBox", "rdfs:subClassOf", "skiros:LargeBox", False)], "paul")
    entries = mary.history(since=number, context_id="ontology")
    assert [entry.author for entry in entries] == ["mary", "paul"]
    assert any("subClassOf" in triple for triple in entries[0].stated)
    [gone] = entries[1].unstated
    assert "subClassOf" in gone
    difference = mary.difference(number, context_id="ontology")
    assert difference.stated and all("subClassOf" not in triple for triple in difference.stated)


def test_the_difference_of_two_points_has_no_steps_between(mary: LocalWorldModel) -> None:
    tray = box(mary, Weight=1.0)
    number, then = mary.model.number, time.time()
    for weight in (2.0, 3.0):
        tray.setProperty("Weight", weight)
        mary.update_element(tray)
    passing = box(mary)
    mary.set_relation(SCENE, "skiros:contain", passing)
    mary.remove_element(passing)
    for point in (number, then):
        difference = mary.difference(point)
        [(was, now)] = difference.pairs()
        assert was and now and (was.value_of("Weight"), now.value_of("Weight")) == (1.0, 3.0)
        assert not difference.related and not difference.unrelated
    tray.setProperty("Weight", 1.0)
    mary.update_element(tray)
    assert not mary.difference(number)


def test_unknown_elements_and_points_are_named(mary: LocalWorldModel, tmp_path: Path) -> None:
    history = mary.model.history
    with pytest.raises(UnknownName, match="no element 'skiros:Box-1' in context 'scene'"):
        history.changes("skiros:Box-1")
    with pytest.raises(UnknownName, match="no context 'nowhere'; it has: scene"):
        history.scene_at(context="nowhere")
    with pytest.raises(WrongValue, match="the journal begins with change"):
        history.scene_at(0.0)
    with pytest.raises(WrongValue, match=f"the last one is {mary.model.number}"):
        history.difference(mary.model.number + 1)
    assert history.scene_at(time.time() + 1000.0).number  # the future is not other yet
    with pytest.raises(Refused, match=r"journal .*none\.journal cannot be read"):
        History(tmp_path / "none.journal").changes()


def test_the_journal_of_a_world_model_that_does_not_run_can_be_asked(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "other.journal")
    wm = LocalWorldModel("mary", WorldModel(None, tmp_path, journal=journal))
    tray = box(wm)
    journal.close()
    assert [entry.author for entry in History(tmp_path / "other.journal").changes(tray.id)] == ["mary"]


def test_last_changes_of_an_element_are_read_without_its_whole_history(
    mary: LocalWorldModel, paul: LocalWorldModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    tray, part = box(mary), box(mary)
    for number in range(300):
        tray.setProperty("Count", number)
        mary.update_element(tray)
        mary.set_relation(tray, "skiros:contain", part, number % 2 == 0)
        mary.update_element_properties(part)  # changes nothing
    paul.set_relation(tray, "skiros:at", part)

    def changes(**options: Any) -> list[tuple[int, str, list[str]]]:
        entries = mary.history(tray.id, **options)
        return [(entry.number, entry.author, history.changed_lines(entry)) for entry in entries]

    every = changes()
    rows: list[object] = []
    read = history._rows

    def counted(*arguments: object, **options: object) -> Iterator[object]:
        for row in read(*arguments, **options):  # type: ignore[arg-type]
            rows.append(row)
            yield row

    monkeypatch.setattr(history, "_rows", counted)
    for limit in (1, 2, 7):
        rows.clear()
        assert changes(limit=limit) == every[-limit:]
        assert len(rows) < 10 * limit + 10
        assert changes(until=every[-2][0], limit=limit) == every[-1 - limit : -1]
    rows.clear()
    assert changes(author="mary", limit=2) == [entry for entry in every if entry[1] == "mary"][-2:]
    assert len(rows) < 40
    assert changes(limit=10_000) == every
    assert changes(author="nobody", limit=1) == []


def test_recent_changes_are_read_without_the_older_ones(
    mary: LocalWorldModel, model: WorldModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By rowid, in the order of time. The index of elements would be read for the whole context."""
    queries: list[str] = []
    opened = history.read_only

    def traced(path: Path) -> Any:
        db = opened(path)
        db.set_trace_callback(queries.append)
        return db

    tray, before = box(mary, Weight=1.0), model.number
    tray.setProperty("skiros:Weight", 2.0)
    mary.update_element(tray)
    monkeypatch.setattr(history, "read_only", traced)
    assert model.history.difference(since=before)
    assert len(model.history.changes(limit=1)) == 1
    past = [query for query in queries if " FROM past_element WHERE " in query]
    assert len(past) == 2
    with closing(opened(model.history._path)) as db:
        for query in past:
            plan = [row[3] for row in db.execute(f"EXPLAIN QUERY PLAN {query}")]
            assert "past_element USING INTEGER PRIMARY KEY (rowid>?)" in plan[0], plan
