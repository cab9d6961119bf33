"""The journal: a killed world model recovers exactly the scene that it had."""

from __future__ import annotations

import os
import resource
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.errors import ConfigurationError, Refused
from skiros2_common.core.operations import Change
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.journal import ALWAYS, NEVER, Journal
from skiros2_world_model.core.journal_file import _PAGE_SIZE
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model import WorldModel
from support.full_disk import full_disk

SCENE = "skiros:Scene-0"
SCENE_TEXT = """@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
<http://example.org/cell> rdfs:comment "about the file" .
:Scene-0 a :Scene ; :contain :LargeBox-80 .
:LargeBox-80 a :LargeBox ; rdfs:label "tray" ; :SizeX 0.5 ; :contain :Starter-81 ; :odd [ :SizeX 1.0 ] .
:Starter-81 a :Starter ; rdfs:label "starter" .
"""


class Lives:
    """World models one after the other on one journal."""

    def __init__(self, folder: Path) -> None:
        self.workspace = folder / "workspace"
        self.workspace.mkdir()
        (self.workspace / "cell.ttl").write_text(SCENE_TEXT)
        self.path = folder / "journals" / "wm.journal"
        self.journal: Journal | None = None

    def start(self, initial: Any = (), ontologies: Path | None = None, **options: Any) -> LocalWorldModel:
        self.journal = Journal(self.path, **options)
        return LocalWorldModel("tester", WorldModel(ontologies, self.workspace, journal=self.journal, initial=initial))

    def kill(self) -> None:
        """Closes the files as the end of a process does."""
        if self.journal is not None:
            self.journal.close(clean=False)
            self.journal = None

    def end(self) -> None:
        assert self.journal is not None
        self.journal.close()
        self.journal = None


@pytest.fixture
def lives(tmp_path: Path) -> Iterator[Lives]:
    lives = Lives(tmp_path)
    yield lives
    lives.kill()


def state(wm: LocalWorldModel) -> dict[str, Any]:
    """All that a world model is to have again, in the order in which it has it."""
    model = wm.model
    contexts = {}
    for name in model.contexts():
        context = model._contexts[name]
        scene = context.scene
        nodes = [
            (n.id, n.type, n.label, {k: (p.dataType(), p.values) for k, p in n.properties.items()}, n.change_info)
            for n in scene
        ]
        extras = sorted(map(str, context.extras))
        contexts[name] = nodes, set(scene.relations()), scene.next_number, context.file, extras
    return {
        "state": model.snapshot_id,
        "contexts": contexts,
        "ontology": set(map(str, model.knowledge_base.store.triples("ontology"))) if model.knowledge_base else None,
    }


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two states are equal but for the next free number, which goes up with a refused request, too."""
    for each in (one, other):
        each["contexts"] = {name: (*c[:2], *c[3:]) for name, c in each["contexts"].items()}
    return one == other


def box(label: str = "", **properties: Any) -> Element:
    element = Element("skiros:LargeBox", label)
    for key, value in properties.items():
        element.setProperty(key, value)
    return element


# -- going on ----------------------------------------------------------------------------------------------------


def test_a_world_model_that_was_killed_comes_back_as_it_was(lives: Lives) -> None:
    wm = lives.start(initial=[("scene", "cell.ttl")])
    tray = wm.get_element("skiros:LargeBox-80")
    tray.setProperty("Weight", 2.5)
    tray.setProperty("größe", ["a", "b"])
    wm.update_element(tray)
    product = box("new", Fragile=True, Count=3, Nothing=float, Deep=[{"a": [1, None]}])
    product.addRelation("skiros:LargeBox-80", "skiros:contain", "-1")
    wm.add_element(product)
    wm.set_relation(SCENE, "skiros:contain", "skiros:Starter-81")
    gone = box("gone")
    wm.add_element(gone)
    wm.remove_element(gone)
    wm.add_element(box("kept"), "memory")
    wm.add_class("skiros:NewBox", "skiros:LargeBox")
    wm.save("saved.ttl", "memory")
    before = state(wm)
    lives.kill()

    again = lives.start(initial=[("scene", "cell.ttl")])
    assert again.model.recovered
    assert state(again) == before
    assert again.get_sub_classes("skiros:LargeBox") == wm.get_sub_classes("skiros:LargeBox")
    assert len(again.query_ontology("SELECT ?c WHERE { ?x rdfs:comment ?c }", context="scene")) == 1


def test_syncs_may_begin_and_end_while_the_world_model_runs(lives: Lives) -> None:
    wm = lives.start()
    assert lives.journal is not None

    def synchronous() -> int:
        assert lives.journal is not None
        return int(lives.journal._file.writer.execute("PRAGMA synchronous").fetchone()[0])

    normal, full = 1, 2  # of SQLite; in its log's mode, only `full` syncs each commit
    assert synchronous() == normal
    for wanted, expected in ((True, full), (False, normal), (True, full)):
        lives.journal.full_sync = wanted
        assert synchronous() == expected
        wm.add_element(box())


def test_a_number_is_not_given_again_after_a_restart(lives: Lives) -> None:
    wm = lives.start()
    one = box()
    wm.add_element(one)
    wm.remove_element(one.id)
    lives.kill()
    other = box()
    lives.start().add_element(other)
    assert other.getIdNumber() == one.getIdNumber() + 1


def test_an_element_knows_its_last_change_after_a_restart(lives: Lives) -> None:
    wm = lives.start()
    wm.add_element(box())
    wm.set_relation(SCENE, "skiros:contain", "skiros:LargeBox-1")
    made = {node.id: node.change_info for node in wm.model.scene()}
    assert made["skiros:LargeBox-1"].author == "tester"
    lives.kill()
    assert {node.id: node.change_info for node in lives.start().model.scene()} == made


def test_the_numbers_go_on_and_the_first_change_continues_the_chain(lives: Lives) -> None:
    wm = lives.start()
    wm.add_element(box())
    last = wm.model.snapshot_id
    lives.kill()
    told: list[Change] = []
    wm = lives.start()
    wm.add_listener(told.append)
    wm.add_element(box())
    assert told[0].prev_snapshot_id == last


# -- starting afresh ---------------------------------------------------------------------------------------------


def test_after_a_clean_end_the_next_one_starts_from_its_files_with_higher_numbers(lives: Lives) -> None:
    wm = lives.start(initial=[("scene", "cell.ttl")])
    wm.add_element(box())
    number, snapshot = wm.model.number, wm.model.snapshot_id
    lives.end()
    wm = lives.start(initial=[("scene", "cell.ttl")])
    assert not wm.model.recovered
    assert len(wm.model.scene()) == 3
    assert wm.model.number > number
    assert wm.model.snapshot_id.split("-")[0] != snapshot.split("-")[0]


@pytest.mark.parametrize(
    ("options", "clean", "goes_on"),
    [
        ({}, False, True),
        ({"origin": "another workspace"}, False, False),
        ({"recover": NEVER}, False, False),
        ({"recover": ALWAYS}, True, True),
        ({"recover": ALWAYS, "origin": "another workspace"}, False, True),
    ],
)
def test_recovery_follows_the_parameter(lives: Lives, options: dict[str, Any], clean: bool, goes_on: bool) -> None:
    lives.start().add_element(box())
    lives.end() if clean else lives.kill()
    wm = lives.start(**options)
    assert wm.model.recovered == goes_on
    assert wm.is_scene_element("skiros:LargeBox-1") == goes_on


def test_refused_initial_file_keeps_the_journal(lives: Lives) -> None:
    lives.start(origin="a").add_element(box())
    lives.kill()
    with pytest.raises(ConfigurationError, match=r"missing\.ttl"):
        lives.start(origin="b", initial=[("scene", "missing.ttl")])
    lives.kill()
    assert lives.start(origin="a").is_scene_element("skiros:LargeBox-1")


def test_without_a_journal_numbers_increase_over_restarts(lives: Lives) -> None:
    wm = LocalWorldModel("tester", WorldModel(None, lives.workspace))
    wm.add_element(box())
    assert WorldModel(None, lives.workspace).number > wm.model.number
    with pytest.raises(Refused, match="no journal"):
        _ = wm.model.history


# -- what cannot be journalled -----------------------------------------------------------------------------------


def test_a_journal_in_use_is_refused(lives: Lives, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("skiros2_common.core.file_lock._TIMEOUT", 0.1)
    lives.start()
    with pytest.raises(ConfigurationError, match=f"{lives.path}: another process is using it"):
        Journal(lives.path)


def test_a_journal_in_no_possible_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigurationError, match=r"journal .*file/wm\.journal"):
        Journal(tmp_path / "file" / "wm.journal")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ConfigurationError, match=r"journal .*folder: unable to open"):
        Journal(tmp_path / "folder")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: -path.stat().st_size // 3 - 1])


def no_database(path: Path) -> None:
    path.write_text("this is not a journal " * 1000)


def other_database(path: Path) -> None:
    path.unlink()
    with sqlite3.connect(path) as db:
        db.execute("CREATE TABLE t (a)")
    db.close()


def garbled(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content[:4096] + os.urandom(len(content) - 4096))


def odd_content(path: Path) -> None:
    with sqlite3.connect(path) as db:
        db.execute("UPDATE element SET content='[]'")
    db.close()


@pytest.mark.parametrize("damage", [cut, no_database, other_database, garbled, odd_content])
def test_damaged_journal_is_moved_aside_and_logged(
    lives: Lives, damage: Callable[[Path], None], caplog: pytest.LogCaptureFixture
) -> None:
    wm = lives.start(initial=[("scene", "cell.ttl")])
    for _ in range(20):
        wm.add_element(box())
    assert lives.journal is not None
    lives.journal.flush()
    lives.kill()
    damage(lives.path)
    damaged = lives.path.read_bytes()
    wm = lives.start(initial=[("scene", "cell.ttl")])
    assert len(wm.model.scene()) == 3
    [aside] = lives.path.parent.glob("wm.journal.damaged-*[0-9]")
    assert aside.read_bytes() == damaged
    assert [r.message for r in caplog.records if str(aside) in r.message]
    wm.add_element(box())
    before = state(wm)
    lives.kill()
    assert state(lives.start(initial=[("scene", "cell.ttl")])) == before


def test_world_model_killed_after_a_recovery_from_a_regular_shutdown_recovers(lives: Lives) -> None:
    lives.start(origin="one").add_element(box())
    lives.end()
    wm = lives.start(origin="other", recover=ALWAYS)
    wm.add_element(box())
    before = state(wm)
    lives.kill()
    assert state(lives.start(origin="other")) == before


def garbled_pages(path: Path) -> None:
    """Garbles the pages that have a past label."""
    content = path.read_bytes()
    pages = [content[at : at + _PAGE_SIZE] for at in range(0, len(content), _PAGE_SIZE)]
    path.write_bytes(b"".join(os.urandom(_PAGE_SIZE) if b"early label" in page else page for page in pages))


def odd_past(path: Path) -> None:
    with sqlite3.connect(path) as db:
        db.execute("UPDATE past_element SET content='[]'")
    db.close()


@pytest.mark.parametrize("damage", [garbled_pages, odd_past])
def test_damage_to_past_states_is_reported_when_they_are_read(lives: Lives, damage: Callable[[Path], None]) -> None:
    wm = lives.start(initial=[("scene", "cell.ttl")])
    tray = wm.get_element("skiros:LargeBox-80")
    for number in range(100):
        tray.label = f"early label {number}" if number < 50 else f"label {number}"
        wm.update_element(tray)
    before = state(wm)
    lives.end()
    assert lives.path.stat().st_size
    damage(lives.path)

    wm = lives.start(initial=[("scene", "cell.ttl")], recover=ALWAYS)
    assert state(wm) == before
    with pytest.raises(Refused, match=f"journal {lives.path} cannot be read: "):
        wm.model.history.changes("skiros:LargeBox-80")
    wm.add_element(box())
    before = state(wm)
    lives.kill()
    assert state(lives.start(initial=[("scene", "cell.ttl")])) == before


REQUESTS: dict[str, Callable[[LocalWorldModel], Any]] = {
    "add": lambda wm: wm.add_element(box()),
    "add in a new context": lambda wm: wm.add_element(box(), "memory"),
    "relate": lambda wm: wm.set_relation(SCENE, "skiros:contain", "skiros:Starter-81"),
    "remove": lambda wm: wm.remove_element(wm.get_element("skiros:Starter-81")),
    "load": lambda wm: wm.load("cell.ttl"),
    "ontology": lambda wm: wm.add_class("skiros:NewBox", "skiros:LargeBox"),
}


@pytest.mark.parametrize("kind", REQUESTS)
def test_a_request_that_cannot_be_journalled_is_refused_and_nothing_changes(lives: Lives, kind: str) -> None:
    wm = lives.start(initial=[("scene", "cell.ttl")])
    told: list[Change] = []
    wm.add_listener(told.append)
    before = state(wm)
    assert lives.journal is not None
    with full_disk(lives.journal), pytest.raises(WmException, match=f"journal {lives.path} cannot be written: "):
        REQUESTS[kind](wm)
    assert same(state(wm), before) and not told
    REQUESTS[kind](wm)
    before = state(wm)
    lives.kill()
    assert state(lives.start(initial=[("scene", "cell.ttl")])) == before


def test_a_full_journal_refuses_requests(lives: Lives) -> None:
    wm = lives.start()
    assert lives.journal is not None
    db = lives.journal._file.writer
    db.execute(f"PRAGMA max_page_count={db.execute('PRAGMA page_count').fetchone()[0] + 10}")
    with pytest.raises(WmException, match="full"):
        for _ in range(100_000):  # until the first merge
            before = state(wm)
            wm.add_element(box("x" * 1000))
    assert same(state(wm), before)
    db.execute("PRAGMA max_page_count=1000000")
    wm.add_element(box("goes on"))
    before = state(wm)
    lives.kill()
    assert state(lives.start()) == before


def test_a_file_that_may_not_grow_refuses_requests(lives: Lives) -> None:
    """As a full disk does: the operating system refuses to write."""
    wm = lives.start()
    before = state(wm)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, limits[1]))
    try:
        with pytest.raises(WmException, match="cannot be written"):
            wm.add_element(box("y" * 1_000_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert same(state(wm), before)
    wm.add_element(box("goes on"))
    before = state(wm)
    lives.kill()
    assert state(lives.start()) == before


def test_after_the_end_requests_are_refused(lives: Lives) -> None:
    wm = lives.start()
    lives.end()
    with pytest.raises(WmException, match="closed"):
        wm.add_element(box())
    assert len(wm.model.scene()) == 1
