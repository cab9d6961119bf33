"""The world model under random requests matches a simple model of the scene and publishes all changes."""

from __future__ import annotations

import itertools
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import invariant, rule, run_state_machine_as_test

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.operations import ADD, Change, Expect, Operation, Patch, Relate
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, ElementChanges
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.replica import Replica, Snapshot
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.core.world_model import WorldModel
from support.full_disk import full_disk
from support.lab import LAB
from support.scene_model import SceneModel, full
from support.world_model_machine import (
    FILTERS,
    KEYS,
    VALUES,
    Answer,
    Refused,
    WorldModelMachine,
    fuzz_settings,
    thing_of,
)


class InProcess(WorldModelMachine):
    """Requests straight to the world model, writes through its port, and a replica that follows the changes."""

    def open(self) -> None:
        self.workspace = Path(tempfile.mkdtemp())
        (self.workspace / "lab.owl").write_text(LAB)
        self.told: list[Change] = []
        self.held: list[Element] = []
        self.issue_text: list[tuple[Element, Any, int]] = []
        self.start(WorldModel(source_ontologies(), self.workspace))

    def start(self, model: WorldModel) -> None:
        """From here on this is the world model."""
        self.model = model
        self.wm = LocalWorldModel("tester", model)
        self.replica = Replica(self.snapshot, timeout=0.0)
        model.add_listener(self.told.append)
        model.add_listener(self.replica.follow)
        self.replica.refresh()

    def teardown(self) -> None:
        shutil.rmtree(self.workspace)

    def transact(self, operations: Sequence[Operation]) -> Answer:
        try:
            outcome = self.model.transact(operations, "tester")
        except SkirosError as error:
            raise Refused(str(error)) from error
        added = [element.id for change in outcome.changes if change.action == ADD for element in change.elements]
        return Answer(outcome.ids, added)

    def state(self) -> tuple[str, SceneModel]:
        return self.model.snapshot_id, content(self.model.scene())

    def files(self, action: str, filename: str) -> None:
        self.answered(getattr(self.wm, action), filename)

    def answered(self, call: Callable[..., Any], *arguments: Any) -> Answer:
        """Makes a call that may be refused; no elements are added by it."""
        try:
            call(*arguments)
        except SkirosError as error:
            raise Refused(str(error)) from error
        return Answer([], [])

    def write(self, filename: str, content: bytes) -> None:
        path = self.workspace / filename
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)

    def snapshot(self) -> Snapshot:
        elements = [self.model.scene().element(node.id) for node in self.model.scene()]
        return Snapshot(self.model.snapshot_id, self.model.number, elements)

    # -- more rules --------------------------------------------------------------------------------------------

    @rule(data=st.data())
    def read_an_element(self, data: st.DataObject) -> None:
        """An element that is written later, when others may have changed it."""
        self.held.append(self.wm.get_element(self.draw_id(data)))

    @rule(data=st.data(), properties_only=st.booleans())
    def write_an_element(self, data: st.DataObject, properties_only: bool) -> None:
        """Of an element that was read before, what was changed since is written, and nothing else."""
        if not self.held:
            return
        element = self.held.pop(data.draw(st.integers(0, len(self.held) - 1)))
        eid, read = element.id, element.copy()
        patch = Patch(eid, self.draw_changes(data, eid))
        patch.changes.removed_properties = [
            k for k in read.property_view if full(k) in map(full, patch.changes.removed_properties)
        ]
        for key in list(patch.changes.properties):
            prop = patch.changes.properties[key]
            before = read.property_view.get(full(key))
            if key != full(key) or (before is not None and _same(before, prop)):
                del patch.changes.properties[key]
        had = [dict(r) for r in read.relation_view]
        removed = data.draw(st.lists(st.sampled_from(had), max_size=1)) if had else []
        patch.changes.added_relations = [r for r in patch.changes.added_relations if r not in had]
        patch.changes.removed_relations = removed
        if read.label == patch.changes.label:
            patch.changes.label = None
        _change(element, patch.changes)
        if properties_only:
            patch.changes.added_relations, patch.changes.removed_relations = [], []
        write = self.wm.update_element_properties if properties_only else self.wm.update_element
        self.send([patch], lambda operations: self.answered(write, element))

    @rule(data=st.data())
    def note_an_element(self, data: st.DataObject) -> None:
        """An element on which a change is based later."""
        eid = self.draw_id(data)
        self.issue_text.append((self.wm.get_element(eid), self.seen_of(eid), self.model.number))

    @rule(data=st.data())
    def change_what_was_noted(self, data: st.DataObject) -> None:
        """It is refused when the element is another one than it was, and not when nothing has changed at all."""
        if not self.issue_text:
            return
        element, seen, number = data.draw(st.sampled_from(self.issue_text))
        change = Patch(element.id, ElementChanges(label=f"based on {element.version}"))
        try:
            answer = self.transact([Expect(element.id, element.version), change])
        except Refused as refused:
            assert element.id in str(refused)
            assert self.model.number != number
            code = getattr(refused.__cause__, "code", "")
            assert element.id not in self.scene.things or "conflict" in f"{code} {refused}"
        else:
            assert answer.ids == [element.id] * 2
            assert self.seen_of(element.id) == seen
            self.scene = self.scene.after([change])
            self.snapshot_id = self.model.snapshot_id

    def seen_of(self, eid: str) -> Any:
        return repr(self.scene.things.get(eid)), {r for r in self.scene.relations if eid == r[2]}

    @rule(data=st.data())
    def statements(self, data: st.DataObject) -> None:
        """Statements in RDF about elements change the scene."""
        relation = data.draw(st.sampled_from(["skiros:contain", "skiros:at", "lab:feeds"]))
        ends = self.draw_id(data), data.draw(st.sampled_from([self.draw_id(data), "skiros:Part-9001", "lab:shelf"]))
        value = data.draw(st.booleans())
        changes = ElementChanges(label=data.draw(st.sampled_from(["one", "said so"])), type="lab:Crate")
        said = [(ends[0], relation, ends[1], value), (ends[0], "rdfs:label", f'"{changes.label}"', True)]
        said.append((ends[0], "rdf:type", "lab:Crate", True))
        operations = [Patch(ends[0], changes), Relate(ends[0], relation, ends[1], value)]
        self.send(operations, lambda operations: self.answered(self.model.modify, said, "tester", "scene"))

    @rule()
    def a_new_world_model_loads_what_was_saved(self) -> None:
        """The file says all: a new world model has the same scene, and saves it as the same text."""
        self.wm.save("saved.ttl")
        other = LocalWorldModel("other", WorldModel(source_ontologies(), self.workspace))
        other.load("saved.ttl")
        assert content(other.model.scene()).comparable() == self.scene.as_read_from_a_file().comparable()
        other.save("again.ttl")
        assert (self.workspace / "again.ttl").read_bytes() == (self.workspace / "saved.ttl").read_bytes()

    @rule(data=st.data())
    def questions(self, data: st.DataObject) -> None:
        """Elements, branches and relations are found as by looking at everything."""
        scene, wm, eid = self.scene, self.wm, self.draw_id(data)
        pred, etype = (
            data.draw(st.sampled_from(FILTERS)),
            data.draw(st.sampled_from(["skiros:Part", "sumo:Object", "lab:Pump"])),
        )
        wanted = Element(etype, data.draw(st.sampled_from(["", "one"])))
        key, value = data.draw(st.sampled_from(KEYS)), data.draw(st.sampled_from(VALUES))
        assert {e.id for e in wm.resolve_elements(wanted)} == scene.resolve(etype, wanted.label, {})
        assert {e.id for e in wm.get_branch(eid, pred, etype)} == scene.branch(eid, pred, etype)
        for src, dst in itertools.product(["", eid], repeat=2):
            for asked in ("", pred):
                relations = wm.get_relations(src, asked, dst)
                found = {(src if r["src"] == "-1" else r["src"], r["type"], r["dst"]) for r in relations}
                assert found == scene.related(src, asked, dst)
                if src and asked:
                    holds = wm.check_relation(src, asked, dst or Element(etype), True, False)
                    ends = scene.related(src, asked, dst)
                    like = scene.resolve(etype, "", {})
                    assert holds == any(d in like or dst for _, _, d in ends)
        if not isinstance(value, (list, dict)) and value != "":
            wanted.setProperty(key, value)
            assert {e.id for e in wm.resolve_elements(wanted)} == scene.resolve(etype, wanted.label, {full(key): value})

    @rule()
    def sparql(self) -> None:
        """The RDF side has the relations, classes, labels and texts of the index, and nothing else."""
        rows = self.wm.query_ontology("SELECT ?s ?p ?o { ?s ?p ?o . FILTER isIRI(?o) }", context="scene")
        types = {(eid, "rdf:type", c) for eid, t in self.scene.things.items() for c in (t.type, "owl:NamedIndividual")}
        assert {tuple(row.split()) for row in rows} == self.scene.relations | types
        rows = self.wm.query_ontology(
            "SELECT ?s ?p (COUNT(?o) AS ?n) { ?s ?p ?o . FILTER isLiteral(?o) } GROUP BY ?s ?p", context="scene"
        )
        kept = self.scene.as_read_from_a_file().things
        values = {(eid, key): len(v) for eid, t in kept.items() for key, v in t.values.items()}
        labels = {(eid, "rdfs:label"): 1 for eid, t in kept.items() if t.label}
        assert {tuple(row.split(" ")[:2]): int(row.split(" ")[2]) for row in rows} == values | labels

    @rule()
    def the_replica_is_as_the_scene(self) -> None:
        """Who follows the changes has the same scene, without having to fetch it anew but after a reset."""
        self.replica.refresh()
        assert content(self.replica.scene()).comparable() == self.scene.comparable()

    @rule()
    def the_changes_are_a_chain(self) -> None:
        assert all(a.snapshot_id == b.prev_snapshot_id for a, b in itertools.pairwise(self.told))
        assert all(a.number < b.number for a, b in itertools.pairwise(self.told))


class Inspector(DiscreteReasoner):
    """Lists all elements; opens those that name it, and rejects those of them that are called `rejected`."""

    def __init__(self, model: WorldModel) -> None:
        self.model = model
        self.seen: dict[str, str] = {}
        self.wrong: list[str] = []

    def execute(self) -> None:
        self.seen = {node.id: node.label for node in self.model.scene()}

    def parse(self, element: Element, action: str) -> bool | None:
        if (element.id in self.seen) == (action == "add"):
            self.wrong.append(f"{action} of {element.id} with {sorted(self.seen)}")
        if action == "remove":
            self.seen.pop(element.id, None)
            return None
        if element.hasProperty("skiros:DiscreteReasoner", "Inspector"):
            if element.label == "rejected":
                return False
            element.setProperty("lab:open", bool)
            element.setProperty("lab:open", True)
        self.seen[element.id] = element.label
        return None


class Kept(InProcess):
    """A world model with a reasoner and a journal, from which it recovers when it is killed."""

    def open(self) -> None:
        self.journal_file = Path(tempfile.mkdtemp()) / "wm.journal"
        super().open()

    def start(self, model: WorldModel) -> None:
        self.journal = Journal(self.journal_file)
        model = WorldModel(source_ontologies(), self.workspace, journal=self.journal)
        self.inspector = Inspector(model)
        model.add_reasoner(self.inspector)
        self.inspector.execute()
        super().start(model)

    def state(self) -> tuple[str, SceneModel]:
        snapshot_id, scene = super().state()
        scene.is_inspected = True
        return snapshot_id, scene

    def teardown(self) -> None:
        if hasattr(self, "journal"):
            self.journal.close()
        shutil.rmtree(self.journal_file.parent)
        super().teardown()

    def draw_element(self, data: st.DataObject, eid: str = "") -> Element:
        element = super().draw_element(data, eid)
        if data.draw(st.booleans(), "inspected"):
            element.property_view["skiros:DiscreteReasoner"] = Property("skiros:DiscreteReasoner", "Inspector")
            element.label = data.draw(st.sampled_from([element.label] * 4 + ["rejected"]))
        return element

    @rule()
    def killed_and_back(self) -> None:
        """It has the same scene under the same name, and the next change follows the last."""
        self.journal.close(clean=False)
        self.start(self.model)

    @rule(data=st.data())
    def request_that_cannot_be_kept(self, data: st.DataObject) -> None:
        """What the journal cannot write is refused, and all is as it was."""
        operations = [self.draw_operation(data, []) for _ in range(data.draw(st.integers(1, 3)))]
        try:
            with full_disk(self.journal):
                self.transact(operations)
        except Refused as refused:
            named = [*self.culprits(operations), f"journal {self.journal_file} cannot be written"]
            assert any(name in str(refused) for name in named), refused
        else:
            assert self.scene.after(operations).comparable() == self.scene.comparable()

    @invariant()
    def the_reasoner_has_seen_all(self) -> None:
        if hasattr(self, "scene"):
            assert not self.inspector.wrong
            assert self.inspector.seen == {eid: thing.label for eid, thing in self.scene.things.items()}


def _same(one: Property, other: Property) -> bool:
    return repr(one.values) == repr(other.values) and one.dataType() is other.dataType()


def _change(element: Element, changes: ElementChanges) -> None:
    """Changes an element as its user does."""
    if changes.type is not None:
        element.type = changes.type
    if changes.label is not None:
        element.label = changes.label
    for key in changes.removed_properties:
        element.removeProperty(key)
    for prop in changes.properties.values():
        element.put(prop.key, prop)
    element.removeRelations(changes.removed_relations)
    for r in changes.added_relations:
        element.addRelation(r["src"], r["type"], r["dst"])


def content(scene: Scene) -> SceneModel:
    return SceneModel({node.id: thing_of(node) for node in scene}, set(scene.relations()))


def test_random_requests_match_a_simple_model() -> None:
    run_state_machine_as_test(InProcess, settings=fuzz_settings(40, 30))


def test_random_requests_match_a_simple_model_with_journal_reasoner_and_restarts() -> None:
    run_state_machine_as_test(Kept, settings=fuzz_settings(40, 30))
