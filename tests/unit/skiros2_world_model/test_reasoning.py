"""Reasoners see each change before it stands; they may complete an element, or reject the change."""

import pytest

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.core.world_model_abstract_interface import WmException


class Weigher(DiscreteReasoner):
    """Weighs products, and rejects those that are called so."""

    def __init__(self):
        self.seen = []

    def parse(self, element, action):
        self.seen.append((action, element.label))
        if element.label == "rejected":
            return False
        if action != "remove" and not element.hasProperty("skiros:Weight"):
            element.setProperty("skiros:Weight", 3.0)
        return None

    def getAssociatedData(self):
        return ["skiros:Weight"]


@pytest.fixture
def weigher(model):
    weigher = Weigher()
    model.add_reasoner(weigher)
    return weigher


def product(label, parent="skiros:Scene-0"):
    element = Element("skiros:Product", label)
    element.setReasoner("Weigher")
    element.addRelation(parent, "skiros:contain", "-1")
    return element


def test_an_added_element_comes_back_completed(wm, weigher):
    element = product("a")
    wm.add_element(element)
    assert element.value_of("skiros:Weight") == 3.0
    assert wm.get_element(element.id).value_of("skiros:Weight") == 3.0
    assert not element.changes()


def test_it_sees_additions_updates_and_removals_of_its_elements_alone(wm, weigher):
    element, other = product("a"), Element("skiros:Product", "not its own")
    wm.add_elements([element, other])
    element.setProperty("skiros:ContainerState", "Full")
    wm.update_element(element)
    wm.set_relation(element.id, "skiros:at", other.id)
    wm.remove_element(element)
    assert weigher.seen == [("add", "a"), ("update", "a"), ("remove", "a")]


def test_an_element_whose_holder_changes_is_updated(wm, weigher):
    tray = Element("skiros:LargeBox", "tray")
    element = product("a")
    wm.add_elements([tray, element])
    weigher.seen.clear()
    wm.set_relation(tray.id, "skiros:contain", element.id)
    assert weigher.seen == [("update", "a")]


def test_what_it_rejects_is_refused_whole_and_what_it_saw_before_is_taken_back(wm, weigher):
    with pytest.raises(WmException, match=r"Weigher rejects to add .*rejected"):
        wm.add_elements([product("a"), product("rejected")])
    assert [e.label for e in wm.get_scene()] == ["skiros:blank_scene"]
    assert [s for s in weigher.seen if s[1] == "a"] == [("add", "a"), ("remove", "a")]


def test_a_reasoner_that_comes_later_sees_what_is_there(wm, model):
    element = product("a")
    wm.add_element(element)
    model.add_reasoner(Weigher())
    assert wm.get_element(element.id).value_of("skiros:Weight") == 3.0


def test_a_loaded_scene_takes_the_place_of_the_old_one_for_reasoners_too(wm, weigher):
    wm.add_element(product("a"))
    wm.save("scene.ttl")
    wm.add_element(product("b"))
    weigher.seen.clear()
    wm.load("scene.ttl")
    assert sorted(weigher.seen) == [("add", "a"), ("remove", "a"), ("remove", "b")]


def test_a_scene_with_an_element_that_it_rejects_is_not_loaded(wm, weigher, workspace):
    wm.add_element(product("a"))
    wm.save("scene.ttl")
    text = (workspace / "scene.ttl").read_text()
    (workspace / "bad.ttl").write_text(text.replace('"a"', '"rejected"'))
    with pytest.raises(WmException, match="rejects"):
        wm.load("bad.ttl")
    assert [e.label for e in wm.get_scene()] == ["skiros:blank_scene", "a"]


def test_elements_of_other_contexts_are_not_its_business(wm, weigher):
    element = Element("skiros:Product", "memory")
    element.setReasoner("Weigher")
    wm.add_element(element, "memory")
    assert weigher.seen == []


def test_an_element_that_names_it_no_more_is_removed_for_it(wm, weigher):
    element = product("a")
    wm.add_element(element)
    element.unsetReasoner("Weigher")
    wm.update_element(element)
    element.label = "b"
    wm.update_element(element)
    wm.remove_element(element)
    assert weigher.seen == [("add", "a"), ("remove", "a")]


def test_an_element_that_names_it_later_is_added_for_it(wm, weigher):
    element = Element("skiros:Product", "a")
    wm.add_element(element)
    element.setReasoner("Weigher")
    wm.update_element(element)
    assert weigher.seen == [("add", "a")]


def test_what_is_refused_after_it_was_asked_is_taken_back(wm, weigher):
    class Second(Weigher):
        pass

    wm.model.add_reasoner(Second())
    element, both = product("a"), Element("skiros:Product", "b")
    wm.add_elements([element, both])
    both.setReasoner("Weigher")
    both.setReasoner("Second")
    both.label = "rejected"
    weigher.parse = lambda e, action: weigher.seen.append((action, e.label))
    weigher.seen.clear()
    with pytest.raises(WmException, match="Second rejects"):
        wm.update_element(both)
    assert weigher.seen == [("add", "rejected"), ("remove", "rejected")]
    element.unsetReasoner("Weigher")
    weigher.seen.clear()
    with pytest.raises(WmException, match="Second rejects"):
        wm.update_elements([element, both])
    assert weigher.seen == [("remove", "a"), ("add", "rejected"), ("remove", "rejected"), ("add", "a")]


def test_a_request_that_cannot_be_kept_is_taken_back(workspace, tmp_path):
    journal = Journal(tmp_path / "wm.journal")
    wm = LocalWorldModel("tester", WorldModel(source_ontologies(), workspace, journal=journal))
    weigher = Weigher()
    wm.model.add_reasoner(weigher)
    journal.close()
    with pytest.raises(WmException, match="journal"):
        wm.add_element(product("a"))
    assert weigher.seen == [("add", "a"), ("remove", "a")]


def test_a_reasoner_that_fails_refuses_the_change_with_its_name(wm, weigher, caplog):
    weigher.parse = lambda element, action: 1 / 0
    with pytest.raises(WmException, match=r"Weigher.*division by zero"):
        wm.add_element(product("a"))
    assert wm.resolve_elements(product("a")) == []
    assert "division by zero" in caplog.text
