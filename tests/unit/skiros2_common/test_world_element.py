"""Elements: identity, properties, relations, and changes since they were read."""

import logging
import threading
import time

import pytest

from skiros2_common.core.discrete_reasoner import DiscreteReasoner, reasoners
from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element


def given_out(**properties):
    return Element.shared(
        "skiros:Product",
        "skiros:starter",
        "skiros:Product-3",
        {f"skiros:{key}": Property(f"skiros:{key}", value) for key, value in properties.items()},
        ({"src": "skiros:Tray-1", "type": "skiros:contain", "dst": "-1", "state": True, "abstract": False},),
        7,
    )


class FlatClasses:
    """A world model that knows no class hierarchy."""

    def is_subclass(self, child, parent):
        return child == parent


def test_without_an_id_an_element_is_abstract():
    assert Element("skiros:Product").isAbstract()
    assert not Element("skiros:Product", "", "skiros:Product-1").isAbstract()


def test_set_uri_gives_type_and_number():
    element = Element("skiros:Product")
    assert element.getIdNumber() == -1
    element.setUri(12)
    assert element.id == "skiros:Product-12"
    assert element.getIdNumber() == 12


def test_repr_is_id_and_label_or_type_and_label():
    assert repr(Element("skiros:Product", "a")) == "skiros:Product-a"
    assert repr(Element("skiros:Product", "a", "skiros:Product-1")) == "skiros:Product-1-a"


def test_missing_property_error_names_the_existing_ones():
    with pytest.raises(UnknownName, match="no property Weight; it has: skiros:Size"):
        given_out(Size=1.0).getProperty("Weight")


@pytest.mark.parametrize(
    ("datatype", "given", "kept"),
    [("xsd:float", "1.5", 1.5), ("xsd:double", 2, 2.0), ("xsd:int", "3", 3), ("xsd:boolean", "False", False),
     ("xsd:string", "x", "x"), ("xsd:int", 3.0, 3)],
)  # fmt: skip
def test_a_datatype_sets_the_type_and_converts(datatype, given, kept):
    element = Element("skiros:Product")
    element.setProperty("skiros:P", given, datatype)
    assert element.getProperty("skiros:P").value == kept
    assert type(element.getProperty("skiros:P").value) is type(kept)


def test_an_unknown_datatype_and_an_unusable_value_are_logged(caplog):
    element = Element("skiros:Product")
    element.setProperty("skiros:Colour", "red", "xsd:colour")
    assert element.getProperty("skiros:Colour").values == ["red"]
    element.setProperty("skiros:P", "red", "xsd:float")
    assert element.getProperty("skiros:P").values == []
    assert "xsd:colour" in caplog.text
    assert "'red' cannot be made a float" in caplog.text
    with pytest.raises(WrongValue, match="'red' cannot be made a float"):
        element.setProperty("skiros:P", "red", "xsd:float", force_convertion=True)


def test_value_of_another_type_is_rejected_unless_converted(caplog):
    element = given_out(Weight=1.0)
    with caplog.at_level(logging.ERROR):
        element.setProperty("skiros:Weight", "2.5")
    assert element.getProperty("skiros:Weight").value == 1.0
    element.setProperty("skiros:Weight", "2.5", force_convertion=True)
    assert element.getProperty("skiros:Weight").value == 2.5


def test_has_property_compares_all_values_and_their_texts():
    element = given_out(Flag="True", Names=["a", "b"], Nothing=str)
    assert element.hasProperty("skiros:Flag", True)
    assert element.hasProperty("skiros:Names", "b")
    assert element.hasProperty("skiros:Nothing")
    assert not element.hasProperty("skiros:Nothing", not_none=True)


def test_set_relation_replaces_the_earlier_one():
    element = given_out()
    element.setRelation("skiros:Tray-2", "contain", "-1")
    assert [r["src"] for r in element.getRelations(pred="skiros:contain", obj="-1")] == ["skiros:Tray-2"]
    element.addRelation("-1", "skiros:at", "skiros:Location-1")
    element.setRelation("-1", "skiros:at", "skiros:Location-2")
    assert element.getRelation("-1", "skiros:at")["dst"] == "skiros:Location-2"


def test_element_as_object_is_a_local_relation():
    parent, child = Element("skiros:Tray"), Element("skiros:Product")
    parent.addRelation("-1", "skiros:contain", child)
    assert parent.local_relations == [("-1", "skiros:contain", child)]
    assert parent.getRelations() == []


def test_remove_relation_by_its_parts():
    element = given_out()
    element.removeRelation2("", "skiros:contain", "-1")
    assert not element.hasRelation("", "skiros:contain", "-1")


def test_shared_content_is_never_changed_through_the_element():
    shared = {"skiros:Weight": Property("skiros:Weight", 1.0)}
    relations = ({"src": "-1", "type": "skiros:at", "dst": "x", "state": True, "abstract": False},)
    element = Element.shared("skiros:Product", "l", "skiros:Product-1", shared, relations)
    element.getProperty("skiros:Weight").value = 2.0
    element.setProperty("skiros:New", 1)
    element._relations[0]["dst"] = "y"
    element._properties["skiros:Weight"].addValue(3.0)
    assert shared["skiros:Weight"].values == [1.0]
    assert list(shared) == ["skiros:Weight"]
    assert relations[0]["dst"] == "x"


def test_changes_are_exactly_the_differences():
    element = given_out(Weight=1.0, Size=2.0, Name="a")
    assert not element.may_be_changed
    assert not element.changes()
    element.getProperty("skiros:Weight").value = 1.0  # the same again
    assert not element.changes()
    element.getProperty("skiros:Weight").value = 3.0
    element.removeProperty("skiros:Name")
    element.setRelation("skiros:Tray-9", "skiros:contain", "-1")
    element.label = "other"
    changes = element.changes()
    assert element.may_be_changed
    assert list(changes.properties) == ["skiros:Weight"]
    assert changes.removed_properties == ["skiros:Name"]
    assert [r["src"] for r in changes.added_relations] == ["skiros:Tray-9"]
    assert [r["src"] for r in changes.removed_relations] == ["skiros:Tray-1"]
    assert changes.label == "other"


def test_changes_of_an_element_without_a_world_model_is_none():
    assert Element("skiros:Product").changes() is None


def test_changes_of_a_view_start_at_its_creation():
    element = Element("skiros:Product", "l")
    element.setProperty("skiros:Weight", 1.0)
    view = element.view()
    assert not view.may_be_changed
    view.setProperty("skiros:Weight", 2.0)
    assert list(view.changes().properties) == ["skiros:Weight"]
    assert element.getProperty("skiros:Weight").value == 1.0


def test_unknown_reasoner_code_raises():
    with pytest.raises(KeyError, match="no reasoner has the name or owns ':Colour'"):
        Element("skiros:Product").getData(":Colour")


@pytest.mark.parametrize(
    ("pattern", "is_one"),
    [
        (Element("skiros:Product"), True),
        (Element("skiros:Tray"), False),
        (Element("skiros:Product", "skiros:starter"), True),
        (Element("skiros:Product", "skiros:other"), False),
    ],
)
def test_is_instance_compares_class_and_label(pattern, is_one):
    assert given_out().isInstance(pattern, FlatClasses()) is is_one


def test_is_instance_compares_values_and_relations():
    pattern = Element("skiros:Product")
    pattern.setProperty("skiros:Weight", 1.0)
    assert given_out(Weight=1.0).isInstance(pattern, FlatClasses())
    assert not given_out(Weight=2.0).isInstance(pattern, FlatClasses())
    pattern.addRelation("skiros:Tray-1", "skiros:contain", "-1")
    assert given_out(Weight=1.0).isInstance(pattern, FlatClasses())
    pattern.addRelation("skiros:Tray-2", "skiros:contain", "-1")
    assert not given_out(Weight=1.0).isInstance(pattern, FlatClasses())


def test_append_property_creates_a_missing_property():
    element = given_out(Weight=[1.0])
    element.appendProperty("skiros:Weight", 2.0)
    element.appendProperty("skiros:Colour", "red")
    assert element.getProperty("skiros:Weight").values == [1.0, 2.0]
    assert element.getProperty("skiros:Colour").value == "red"


class Nearness(DiscreteReasoner):
    def onAddProperties(self, element):
        element.setProperty("skiros:Distance", float)

    def onRemoveProperties(self, element):
        element.removeProperty("skiros:Distance")

    def hasData(self, element, get_code):
        return element.getProperty("skiros:Distance").isSpecified()

    def getData(self, element, get_code):
        return element.getProperty("skiros:Distance").value

    def setData(self, element, data, set_code):
        element.setProperty("skiros:Distance", data)

    def getAssociatedProperties(self):
        return [":Distance"]

    def getAssociatedData(self):
        return ["skiros:Distance"]

    def run(self):
        self.ran = not self.stopRequested


@pytest.fixture
def nearness(monkeypatch):
    monkeypatch.setattr(reasoners, "_by_name", {})
    monkeypatch.setattr(reasoners, "_owners", {})
    reasoner = Nearness()
    reasoners.add(reasoner)
    return reasoner


def test_set_data_uses_the_reasoner_that_owns_the_code(nearness):
    element = Element("skiros:Product")
    nearness.addProperties(element)
    assert not element.hasData(":Distance")
    element.setData(":Distance", 2.5)
    assert element.hasData(":Distance")
    assert element.getData(":Distance") == element.getProperty("skiros:Distance").value == 2.5
    assert element.getProperty("skiros:DiscreteReasoner").value == "Nearness"
    assert element.getAssociatedReasonerId("skiros:Distance") == "Nearness"
    assert element.getAssociatedReasonerId("skiros:Weight") == ""
    assert element._getReasoner("Nearness") is nearness
    nearness.removeProperties(element)
    assert not element.hasProperty("skiros:Distance")
    assert not element.hasProperty("skiros:DiscreteReasoner", "Nearness")


def test_reasoner_runs_until_stop(nearness):
    nearness.stop()
    assert nearness.stopRequested
    nearness.execute()
    assert nearness.wait_stopped(5.0)
    assert nearness.ran
    assert not nearness.stopRequested


class Slow(Nearness):
    """Ends only when `ending` is set, whatever it was asked."""

    def __init__(self):
        self.runs = self.at_once = self.most_at_once = 0
        self.started, self.ending = threading.Semaphore(0), threading.Event()

    def run(self):
        self.runs, self.at_once = self.runs + 1, self.at_once + 1
        self.most_at_once = max(self.most_at_once, self.at_once)
        self.started.release()
        self.ending.wait(20.0)
        while not self.stopRequested:
            time.sleep(0.001)
        self.at_once -= 1


def test_stopped_run_that_takes_long_is_not_revived_by_the_next_start():
    slow = Slow()
    slow.execute()
    assert slow.started.acquire(timeout=5.0)
    for _ in range(3):  # as three loads of a scene do
        slow.stop()
        assert not slow.wait_stopped(0.05)
        slow.execute()
    assert slow.runs == 1  # the next waits for it
    slow.ending.set()
    assert slow.started.acquire(timeout=5.0)
    assert (slow.runs, slow.at_once, slow.most_at_once) == (2, 1, 1)
    slow.stop()
    assert slow.wait_stopped(5.0)
    assert (slow.runs, slow.at_once) == (2, 0)


def test_running_reasoner_is_not_started_twice():
    slow = Slow()
    slow.execute()
    slow.execute()
    assert slow.started.acquire(timeout=5.0)
    assert not slow.started.acquire(timeout=0.1)
    slow.stop()
    slow.ending.set()
    assert slow.wait_stopped(5.0)
