"""Change sets: merging, inverting, JSON, and reverting a change of the scene."""

import pytest

from skiros2_common.core.changeset import ChangeSet, ElementRecord, merge
from skiros2_common.core.errors import Conflict, Refused, WrongValue
from skiros2_common.core.operations import Add, Apply, Patch, Relate, Remove
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, ElementChanges
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.core.world_model import WorldModel

BOX = "skiros:LargeBox"
CONTAIN = "skiros:contain"


def record(label, **values):
    return ElementRecord("a:T-1", "a:T", label, {f"a:{key}": Property(f"a:{key}", v) for key, v in values.items()})


def test_merged_change_sets_lead_from_the_first_state_to_the_last():
    one, two, three = record("one"), record("two"), record("three")
    relation = ("a:T-1", "a:p", "a:T-2")
    merged = merge(
        [
            ChangeSet({"a:T-1": (one, two)}, {relation: True}, {"s": True}),
            ChangeSet({"a:T-1": (two, three)}, {relation: False}, {"s": False, "t": True}),
        ]
    )
    assert merged == ChangeSet({"a:T-1": (one, three)}, {}, {"t": True})


def test_effective_change_set_omits_elements_with_equal_content():
    same = ChangeSet({"a:T-1": (record("x", size=1), record("x", size=1))})
    assert not same.effective()
    assert ChangeSet({"a:T-1": (record("x", size=1), record("x", size=2))}).effective()
    assert ChangeSet({"a:T-1": (None, record("x"))}).effective()


def test_json_keeps_types_and_statements():
    values = {"number": 1.5, "whole": 2, "flag": True, "text": "ä", "table": {"k": [1]}, "empty": float}
    changes = ChangeSet(
        {"a:T-1": (None, record("x", **values)), "a:T-2": (record("y"), None)},
        {("a:T-1", "a:p", "a:T-3"): True, ("a:T-2", "a:p", "a:T-3"): False},
        {"<a:s> <a:p> <a:o>": True},
    )
    read = ChangeSet.from_json(changes.to_json())
    assert (read.relations, read.statements, list(read.records)) == (
        changes.relations,
        changes.statements,
        ["a:T-1", "a:T-2"],
    )
    after = read.records["a:T-1"][1]
    assert {key: (p.values, p.dataType()) for key, p in after.properties.items()} == {
        key: (p.values, p.dataType()) for key, p in record("x", **values).properties.items()
    }


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"elements":[1],"relations":[],"statements":[]}', '{"elements":0}'])
def test_text_that_is_no_change_set_is_refused(text):
    with pytest.raises(WrongValue):
        ChangeSet.from_json(text)


# -- reverting ---------------------------------------------------------------------------------------------------


class Cell:
    """A world model whose changes are read from its journal."""

    def __init__(self, folder):
        self.journal = Journal(folder / "journal.db")
        self.model = WorldModel(source_ontologies(), journal=self.journal)

    def do(self, *operations, author="me"):
        """Makes a request; returns its change set, as the journal has it."""
        outcome = self.model.transact(list(operations), author)
        return self.model.history.changes(since=outcome.changes[0].number - 1)[-1].changes

    def revert(self, changes):
        return self.do(Apply(changes.inverse()))

    def state(self):
        scene = self.model.scene()
        content = {r.id: (r.type, r.label, {k: p.values for k, p in r.properties.items()}) for r in scene}
        return content, set(scene.relations())


@pytest.fixture
def cell(tmp_path):
    cell = Cell(tmp_path)
    cell.do(Add(Element(BOX, "tray")), Relate(ROOT, CONTAIN, f"{BOX}-1"))
    cell.do(Add(Element(BOX, "part")), Relate(f"{BOX}-1", CONTAIN, f"{BOX}-2"))
    yield cell
    cell.journal.close()


TRAY, PART = f"{BOX}-1", f"{BOX}-2"
REQUESTS = {
    "values": [Patch(PART, ElementChanges({"skiros:Weight": Property("skiros:Weight", 2.0)}, label="new"))],
    "addition": [Add(Element(BOX, "third"), "x"), Relate(TRAY, CONTAIN, "#x")],
    "move": [Relate(TRAY, CONTAIN, PART, False), Relate(ROOT, CONTAIN, PART)],
    "removal": [Remove(TRAY)],
    "class": [Patch(PART, ElementChanges(type="skiros:Product"))],
}


@pytest.mark.parametrize("name", REQUESTS)
def test_reverted_change_restores_the_scene_and_its_reversal_the_change(cell, name):
    before = cell.state()
    changes = cell.do(*REQUESTS[name])
    after = cell.state()
    assert before != after
    reverted = cell.revert(changes)
    assert cell.state() == before
    cell.revert(reverted)
    assert cell.state() == after


def weigh(value, key="skiros:Weight"):
    return Patch(PART, ElementChanges({key: Property(key, value)}))


def test_refused_revert_lists_all_parts_that_have_changed_since_and_changes_nothing(cell):
    changes = cell.do(weigh(1.0), Patch(TRAY, ElementChanges(label="mine")))
    cell.do(weigh(2.0), author="/vision")
    cell.do(Patch(TRAY, ElementChanges(label="theirs")), author="/planner")
    before = cell.state()
    with pytest.raises(Conflict) as refused:
        cell.revert(changes)
    assert f"{PART} was changed by vision at" in str(refused.value)
    assert "Weight is now 2, expected 1" in str(refused.value)
    assert f"{TRAY} was changed by planner at" in str(refused.value)
    assert "its label is now theirs, expected mine" in str(refused.value)
    assert cell.state() == before


def test_revert_keeps_other_values_and_relations_of_the_elements(cell):
    changes = cell.do(weigh(1.0))
    cell.do(weigh(3.0, "skiros:SizeX"), Relate(ROOT, "skiros:at", PART))
    cell.revert(changes)
    scene = cell.model.scene()
    assert not cell.model.reader.find(PART, "scene").hasProperty("skiros:Weight")
    assert scene.record(PART).properties["skiros:SizeX"].value == 3.0
    assert scene.related(ROOT, "skiros:at", PART)


@pytest.mark.parametrize(
    ("name", "since", "reason"),
    [
        ("addition", Relate(f"{BOX}-3", CONTAIN, PART), "relation added"),
        ("addition", Remove(f"{BOX}-3"), "no longer exists"),
        ("move", Relate(ROOT, CONTAIN, PART, False), "was removed"),
        ("move", Remove(TRAY, recursive=False), "cannot restore"),
        ("values", Remove(PART), "no longer exists"),
        ("class", Patch(PART, ElementChanges(type="skiros:Tool")), "its class is now skiros:Tool"),
    ],
)
def test_revert_is_refused_if_its_part_has_changed(cell, name, since, reason):
    changes = cell.do(*REQUESTS[name])
    cell.do(since)
    before = cell.state()
    with pytest.raises(Conflict, match=reason):
        cell.revert(changes)
    assert cell.state() == before


def test_removal_of_the_root_is_refused(cell):
    root = cell.model.scene().record(ROOT)
    relations = dict.fromkeys(cell.model.scene().relations(ROOT), False)
    with pytest.raises(Refused, match="root of the scene"):
        cell.do(Apply(ChangeSet({ROOT: (root, None)}, relations)))
