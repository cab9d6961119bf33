"""After any sequence of requests, accepted and refused, with kills in between, the journal has the world model, and its
history every state that there was."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.operations import Add, Operation, Patch, Relate, Remove, Update
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, ElementChanges
from skiros2_world_model.core.history import HistoryEntry
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from support.fuzz import examples

TYPES = ["skiros:LargeBox", "skiros:Starter"]
IDS = ["skiros:Scene-0", *(f"{etype}-{number}" for etype in TYPES for number in range(1, 5))]
CELL = """@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .
:Scene-0 a :Scene ; :contain :LargeBox-1, :LargeBox-2, :LargeBox-3 . :LargeBox-1 a :LargeBox ; :contain :Starter-1 .
:LargeBox-2 a :LargeBox ; :contain :Starter-2 ; :hasA :Starter-1 . :LargeBox-3 a :LargeBox ; :at :LargeBox-1 .
:Starter-1 a :Starter . :Starter-2 a :Starter ; :A 1 ; :B "b" . :Starter-3 a :Starter ; :A 1 ; :SizeX 0.5 .
"""
PREDICATES = ["skiros:contain", "skiros:hasA", "skiros:at"]
VALUES = st.one_of(
    st.booleans(),
    st.integers(-3, 3),
    st.floats(),
    st.text(max_size=3),
    st.lists(st.integers(0, 2), max_size=2),
    st.dictionaries(st.text(max_size=2), st.none() | st.booleans(), max_size=2),
)
ids = st.sampled_from(IDS)


@st.composite
def properties(draw: st.DrawFn) -> dict[str, Property]:
    keys = draw(st.lists(st.sampled_from(["skiros:A", "skiros:B", "skiros:SizeX"]), unique=True))
    found = {}
    for key in keys:
        value = draw(st.floats(0, 1)) if key == "skiros:SizeX" else draw(VALUES)
        found[key] = Property(key, [value] * draw(st.integers(1, 2)) if key != "skiros:SizeX" else value)
    return found


@st.composite
def elements(draw: st.DrawFn) -> Element:
    element = Element(draw(st.sampled_from(TYPES)), draw(st.text(max_size=2)), draw(st.just("") | ids))
    for key, prop in draw(properties()).items():
        element.put(key, prop)
    for src, pred in draw(st.lists(st.tuples(ids, st.sampled_from(PREDICATES)), max_size=2)):
        element.addRelation(src, pred, "-1")
    return element


@st.composite
def changes(draw: st.DrawFn) -> ElementChanges:
    return ElementChanges(draw(properties()), draw(st.lists(st.sampled_from(["skiros:A", "skiros:B"]), unique=True)))


operations: st.SearchStrategy[Operation] = st.one_of(
    st.builds(Add, elements()),
    st.builds(Update, elements(), st.booleans()),
    st.builds(Patch, ids, changes()),
    st.builds(Remove, ids, st.booleans()),
    st.builds(Relate, ids, st.sampled_from(PREDICATES), ids, st.booleans()),
)
contexts = st.sampled_from(["scene", "scene", "scene", "memory"])
requests = st.one_of(
    st.tuples(st.just("transact"), st.lists(operations, min_size=1, max_size=3), contexts),
    st.tuples(st.just("transact"), st.lists(operations, min_size=1, max_size=3), contexts),
    st.tuples(st.just("load"), st.sampled_from(["cell.ttl", "missing.ttl"]), contexts),
    st.tuples(st.just("save"), st.just("saved.ttl"), contexts),
    st.tuples(st.just("class"), st.sampled_from(["skiros:One", "skiros:Two"]), st.booleans()),
    st.tuples(st.just("kill"), st.none(), st.none()),
)


def ask(model: WorldModel, kind: str, what: Any, where: Any) -> None:
    if kind == "transact":
        model.transact(what, "author", where)
    elif kind == "load":
        model.load(what, "author", where)
    elif kind == "save":
        model.save(what, where)
    else:
        model.modify([(what, "rdf:type", "owl:Class", where), (what, "rdfs:label", '"a"@en', where)], "author")


def content(model: WorldModel) -> dict[str, Any]:
    found: dict[str, Any] = {
        name: (context.file, sorted(map(str, context.extras)))
        for name, context in model._contexts.items()
        if context.scene or context.extras
    }
    for name in found.copy():
        for node in model.scene(name):
            values = {key: (p.dataType(), repr(p.values)) for key, p in node.properties.items()}
            found[f"{name} {node.id}"] = node.type, node.label, values, node.change_info
        found[f"{name} relations"] = sorted(model.scene(name).relations())
    # the blank nodes of files have other names each time
    found["ontology"] = {str(t) for t in model.knowledge_base.store.triples("ontology") if "_:" not in str(t)}
    found["state"] = model.snapshot_id
    return found


def told(entry: HistoryEntry) -> dict[str, Any]:
    return {
        e.id: (e.type, e.label, properties_of(e), sorted((r["type"], r["dst"]) for r in e.relation_view))
        for e in entry.after
    }


def present(model: WorldModel, context: str = "scene") -> dict[str, Any]:
    scene = model.scene(context)
    return {
        node.id: (
            node.type,
            node.label,
            properties_of(scene.element(node.id)),
            sorted((pred, dst) for _, pred, dst in scene.relations(node.id)),
        )
        for node in scene
    }


def properties_of(element: Any) -> dict[str, str]:
    return {key: repr(prop.values) for key, prop in element.property_view.items()}


def replayed(entries: list[HistoryEntry]) -> dict[str, Any]:
    """What the entries, one after the other, make of an empty context."""
    elements: dict[str, Element] = {}
    relations: set[tuple[str, str, str]] = set()
    for entry in entries:
        for was, now in entry.pairs():
            if was is not None:
                before = elements.pop(was.id)
                assert (before.type, before.label, properties_of(before)) == (was.type, was.label, properties_of(was))
            if now is not None:
                elements[now.id] = now
        relations -= {(r["src"], r["type"], r["dst"]) for r in entry.unrelated}
        relations |= {(r["src"], r["type"], r["dst"]) for r in entry.related}
    return {
        eid: (e.type, e.label, properties_of(e), sorted((p, dst) for src, p, dst in relations if src == eid))
        for eid, e in elements.items()
    }


@pytest.mark.filterwarnings("ignore")
@settings(max_examples=examples(60), suppress_health_check=list(HealthCheck))
@example(  # a relation of another context is refused, after the context of the request was created
    sequence=[("transact", [Relate(IDS[0], "skiros:contain", IDS[0]), Add(Element(TYPES[0]))], "memory")]
)
@given(sequence=st.lists(requests, min_size=1, max_size=12))
def test_recovered_state_equals_the_state_of_the_world_model(sequence: list[tuple[str, Any, Any]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "cell.ttl").write_text(CELL)
        path = Path(folder) / "wm.journal"

        def start() -> tuple[WorldModel, Journal]:
            journal = Journal(path)
            return WorldModel(ONTOLOGIES, Path(folder), journal=journal, initial=[("scene", "cell.ttl")]), journal

        model, journal = start()
        states = [(model.number, present(model))]
        for kind, what, where in [*sequence, ("kill", None, None)]:
            before = content(model)
            if kind == "kill":
                journal.close(clean=False)
                model, journal = start()
                assert content(model) == before
                continue
            try:
                ask(model, kind, what, where)
            except SkirosError as error:
                assert "journal" not in str(error)
                assert content(model) == before
            states.append((model.number, present(model)))
        history = model.history
        for number, state in states:
            assert told(history.scene_at(number)) == state
            assert replayed(history.changes(until=number)) == state
        for number, state in states[::3]:
            difference = history.difference(number, states[-1][0])
            assert bool(difference) == (state != states[-1][1])
        journal.close()


ONTOLOGIES = source_ontologies()
