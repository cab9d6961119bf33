"""A request that concerns several contexts is applied, recorded and published as a whole, or not at all."""

import sqlite3

import pytest

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.operations import Add, Relate
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model import WorldModel
from support.full_disk import full_disk


class Guard(DiscreteReasoner):
    """Rejects every change once it is `on`."""

    on = False

    def parse(self, element, action):
        return not self.on


@pytest.fixture
def journalled(workspace, tmp_path):
    journal = Journal(tmp_path / "wm.journal")
    model = WorldModel(source_ontologies(), workspace, journal=journal)
    yield LocalWorldModel("tester", model)
    journal.close()


def note_of(part):
    """Adds a note in `memory`, to which a part of the scene refers."""
    return [Add(Element("skiros:Part", "note"), "note"), Relate(part.id, "skiros:at", "#note")]


def part_in(wm):
    part = Element("skiros:Part", "part")
    wm.add_element(part)
    return part


def state(wm):
    return [
        (e.id, e.label, e.relation_view) for name in ("scene", "memory") for e in wm.resolve_elements(Element(""), name)
    ]


def test_relation_of_an_element_in_another_context_is_added(journalled):
    part, changes = part_in(journalled), []
    journalled.add_listener(changes.append)
    journalled.transact(note_of(part), "memory")
    (note,) = journalled.resolve_elements(Element("skiros:Part"), "memory")
    assert journalled.get_element(part.id).hasRelation("-1", "skiros:at", note.id)
    assert [change.context for change in changes] == ["memory", "scene"]
    assert [change.number for change in changes] == [changes[0].number, changes[0].number + 1]


def test_rejected_removal_of_a_dangling_relation_undoes_the_removal(journalled):
    guard = Guard()
    journalled.model.add_reasoner(guard)
    part = part_in(journalled)
    journalled.transact(note_of(part), "memory")
    (note,) = journalled.resolve_elements(Element("skiros:Part"), "memory")
    before, number, changes = state(journalled), journalled.model.number, []
    journalled.add_listener(changes.append)
    guard.on = True
    with pytest.raises(WmException, match="Guard refuses"):
        journalled.remove_element(note, context_id="memory")
    assert (state(journalled), journalled.model.number, changes) == (before, number, [])
    guard.on = False
    journalled.remove_element(note, context_id="memory")
    assert not journalled.get_element(part.id).hasRelation("-1", "skiros:at", note.id)


def test_journal_that_fails_for_two_contexts_has_nothing_of_either(journalled, tmp_path):
    part = part_in(journalled)
    before = state(journalled)
    with full_disk(journalled.model._journal), pytest.raises(WmException, match="No space left"):
        journalled.transact(note_of(part), "memory")
    assert state(journalled) == before
    with sqlite3.connect(tmp_path / "wm.journal") as db:
        assert db.execute("SELECT count(*) FROM element WHERE content LIKE '%note%'").fetchone() == (0,)
    journalled.transact(note_of(part), "memory")
    assert [entry.action for entry in journalled.history(context_id="memory")] == ["change"]
