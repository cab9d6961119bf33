"""Reasoners parse each change before it is committed; they may complete an element or reject the change."""

import re
import threading

import pytest

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.reasoner_world_model import ReasonerWorldModel
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model import WorldModel


class Weigher(DiscreteReasoner):
    """Weighs products, and rejects those that are called so."""

    def __init__(self):
        self.seen = []
        self.started = threading.Event()

    def run(self):
        self.seen.append(("run", ""))
        self.started.set()

    def onAddProperties(self, element):
        if not element.hasProperty("skiros:Weight"):
            element.setProperty("skiros:Weight", 0.0)
        element.setProperty("skiros:SizeX", 9.0)

    def parse(self, element, action):
        self.seen.append((action, element.label))
        if element.label == "rejected":
            return False
        if action != "remove" and element.type == "skiros:Product" and not element.hasProperty("skiros:Weight"):
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
    element.appendProperty("skiros:DiscreteReasoner", "Weigher")
    element.addRelation(parent, "skiros:contain", "-1")
    return element


def test_an_added_element_comes_back_completed(wm, weigher):
    element = product("a")
    wm.add_element(element)
    assert element.value_of("skiros:Weight") == 3.0
    assert wm.get_element(element.id).value_of("skiros:Weight") == 3.0
    assert not element.changes()


def test_every_reasoner_is_offered_every_element_of_the_scene(wm, weigher):
    element, other = product("a"), Element("skiros:Part", "does not name it")
    wm.add_elements([element, other])
    element.setProperty("skiros:ContainerState", "Full")
    wm.update_element(element)
    wm.remove_element(other)
    assert weigher.seen == [
        ("add", "a"), ("add", "does not name it"), ("update", "a"), ("remove", "does not name it"),
    ]  # fmt: skip


def test_an_element_of_which_only_relations_change_is_offered(wm, weigher):
    box, part = Element("skiros:LargeBox", "box"), Element("skiros:Part", "part")
    wm.add_elements([box, part])
    weigher.seen.clear()
    box.addRelation("-1", "skiros:contain", part.id)
    wm.update_element(box)
    assert sorted(weigher.seen) == [("update", "box"), ("update", "part")]


def test_moved_element_is_parsed_without_its_holder(wm, weigher):
    tray = Element("skiros:LargeBox", "tray")
    element = product("a")
    wm.add_elements([tray, element])
    weigher.seen.clear()
    wm.set_relation(tray.id, "skiros:contain", element.id)
    assert weigher.seen == [("update", "a")]


def test_rejected_request_is_refused_and_earlier_parses_are_undone(wm, weigher):
    with pytest.raises(WmException, match=r"Weigher refuses to add .*rejected"):
        wm.add_elements([product("a"), product("rejected")])
    assert [e.label for e in wm.resolve_elements(Element(""))] == ["skiros:blank_scene"]
    assert weigher.seen == [("add", "a"), ("add", "rejected"), ("remove", "a")]


def test_existing_elements_are_not_offered_and_get_the_default_properties_they_miss(wm, model):
    element, heavy = product("a"), product("heavy")
    heavy.setProperty("skiros:SizeX", 1.0)
    wm.add_elements([element, heavy])
    weigher = Weigher()
    model.add_reasoner(weigher)
    assert weigher.seen == []
    assert wm.get_element(element.id).value_of("skiros:Weight") == 0.0
    assert wm.get_element(heavy.id).value_of("skiros:SizeX") == 1.0


def test_a_load_stops_reasoners_and_starts_them_again_with_the_loaded_scene_complete(wm, weigher, workspace):
    wm.add_element(product("a"))
    wm.save("scene.ttl")
    text = (workspace / "scene.ttl").read_text()
    text, count = re.subn(r"skiros:Weight [^;.]*3\.0[^;.]*", 'rdfs:comment "light" ', text)
    assert count == 1
    (workspace / "light.ttl").write_text(text)
    wm.add_element(product("b"))
    weigher.seen.clear()
    wm.load("light.ttl")
    assert weigher.started.wait(10.0)
    assert weigher.seen == [("run", "")]
    (element,) = wm.resolve_elements(Element("skiros:Product"))
    assert element.value_of("skiros:Weight") == 0.0


def test_a_load_that_is_refused_starts_reasoners_again(wm, weigher):
    with pytest.raises(WmException):
        wm.load("missing.ttl")
    assert weigher.started.wait(10.0)


def test_a_load_waits_until_the_reasoners_have_stopped(wm, model, workspace):
    class Slow(Weigher):
        def run(self):
            super().run()
            while not self.stopRequested:
                stopping.wait(0.01)
            self.seen.append(("stopped", wm.resolve_elements(Element("skiros:Product"))[0].label))

    stopping = threading.Event()
    wm.save("empty.ttl")
    wm.add_element(product("a"))
    slow = Slow()
    model.add_reasoner(slow)
    slow.execute()
    assert slow.started.wait(10.0)
    wm.load("empty.ttl")
    assert slow.seen[:2] == [("run", ""), ("stopped", "a")]
    slow.stop()
    slow._thread.join(10.0)


def test_elements_of_other_contexts_are_not_offered(wm, weigher):
    element = Element("skiros:Product", "memory")
    element.appendProperty("skiros:DiscreteReasoner", "Weigher")
    wm.add_element(element, "memory")
    assert weigher.seen == []


def test_refusal_after_parse_is_undone(wm, weigher):
    class Second(Weigher):
        pass

    wm.model.add_reasoner(Second())
    element, other = product("a"), product("b")
    wm.add_elements([element, other])
    weigher.parse = lambda e, action: weigher.seen.append((action, e.label))
    weigher.seen.clear()
    element.label, other.label = "c", "rejected"
    with pytest.raises(WmException, match="Second refuses"):
        wm.update_elements([element, other])
    assert weigher.seen == [("update", "c"), ("update", "rejected"), ("update", "b"), ("update", "a")]


def test_a_removal_that_cannot_be_kept_is_undone(workspace, tmp_path):
    journal = Journal(tmp_path / "wm.journal")
    wm = LocalWorldModel("tester", WorldModel(source_ontologies(), workspace, journal=journal))
    weigher = Weigher()
    wm.model.add_reasoner(weigher)
    element = product("a")
    wm.add_element(element)
    journal.close()
    for change in (lambda: wm.add_element(product("b")), lambda: wm.remove_element(element)):
        with pytest.raises(WmException, match="journal"):
            change()
    assert weigher.seen == [("add", "a"), ("add", "b"), ("remove", "b"), ("remove", "a"), ("add", "a")]


def test_an_exception_in_parse_is_logged_and_the_change_stands(wm, weigher, caplog):
    weigher.parse = lambda element, action: 1 / 0
    element = product("a")
    wm.add_element(element)
    assert wm.get_element(element.id).label == "a"
    assert "Weigher failed to add" in caplog.text
    assert "division by zero" in caplog.text


def test_relations_that_a_reasoner_adds_to_an_element_are_stored(wm, weigher):
    weigher.parse = lambda element, action: element.addRelation("-1", "skiros:at", "skiros:Scene-0")
    element = product("a")
    wm.add_element(element)
    assert wm.get_relations(element, "skiros:at", "skiros:Scene-0")
    assert element.hasRelation("-1", "skiros:at", "skiros:Scene-0")


def test_a_change_by_a_reasoner_that_cannot_be_stored_is_discarded(wm, weigher, caplog):
    def parse(element, action):
        element.setProperty("skiros:Weight", 5.0)
        element.addRelation("-1", "skiros:at", "skiros:Nothing-7")

    weigher.parse = parse
    element = product("a")
    wm.add_element(element)
    assert not wm.get_element(element.id).hasProperty("skiros:Weight")
    assert "the changes of reasoner Weigher" in caplog.text
    assert "skiros:Nothing-7" in caplog.text


class Notary(DiscreteReasoner):
    """Writes to the world model while it is asked: a note for each product."""

    def __init__(self, target):
        self.target = target
        self.seen = []

    def parse(self, element, action):
        self.seen.append((action, element.type))
        if action == "add" and element.type == "skiros:Product":
            note = Element("skiros:Part", "note")
            note.addRelation(self.target or element.id, "skiros:contain", "-1")
            self._wmi.add_element(note, "Notary")
        return element.label != "rejected"


@pytest.fixture
def notary(model):
    notary = Notary("")
    notary.init(ReasonerWorldModel(model))
    model.add_reasoner(notary)
    return notary


def test_writes_of_a_reasoner_during_parse_join_the_request(wm, notary):
    changes = []
    wm.add_listener(changes.append)
    element = product("a")
    wm.add_element(element)
    (note,) = wm.resolve_elements(Element("skiros:Part"))
    assert wm.get_relations(element, "skiros:contain", note)
    assert notary.seen == [("add", "skiros:Product"), ("add", "skiros:Part")]
    assert [[e.label for e in c.elements] for c in changes] == [["a", "note"]]
    with pytest.raises(WmException, match="refuses"):
        wm.add_element(product("rejected"))
    assert len(wm.resolve_elements(Element("skiros:Part"))) == 1


def test_a_write_that_fails_while_a_reasoner_is_asked_changes_nothing(wm, notary, caplog):
    notary.target = "skiros:Nothing-7"
    wm.add_element(product("a"))
    assert [e.label for e in wm.resolve_elements(Element("skiros:Product"))] == ["a"]
    assert wm.resolve_elements(Element("skiros:Part")) == []
    assert "Notary failed to add" in caplog.text


class Mutual(DiscreteReasoner):
    """Shares a lock between `parse` and its own thread, which uses the world model while it has the lock."""

    def __init__(self):
        self.mutex = threading.Lock()
        self.holds_lock, self.in_parse = threading.Event(), threading.Event()
        self.found = []

    def parse(self, element, action):
        self.in_parse.set()
        with self.mutex:
            self.found.append((action, element.label))

    def run(self):
        with self.mutex:
            self.holds_lock.set()
            assert self.in_parse.wait(10.0)
            note = Element("skiros:Part", "note")
            self._wmi.add_element(note, repr(self))
            self.found.append(sorted(e.label for e in self._wmi.resolve_elements(Element(""))))


def test_a_reasoner_may_use_the_world_model_with_a_lock_that_parse_waits_for(wm, model):
    mutual = Mutual()
    mutual.init(ReasonerWorldModel(model))
    model.add_reasoner(mutual)
    mutual.execute()
    assert mutual.holds_lock.wait(10.0)
    adding = threading.Thread(target=wm.add_element, args=(product("a"),), daemon=True)
    adding.start()
    adding.join(20.0)
    assert not adding.is_alive()
    assert mutual.wait_stopped(10.0)
    assert mutual.found == [["a", "note", "skiros:blank_scene"], ("add", "a"), ("add", "note")]
    assert [e.label for e in wm.resolve_elements(Element("skiros:Part"))] == ["note"]


class Helpful(Mutual):
    """Rejects products that are called so, after its other thread has written a note."""

    def parse(self, element, action):
        super().parse(element, action)
        return element.label != "rejected"


@pytest.mark.parametrize("label", ["a", "rejected"])
def test_a_write_beside_a_parse_is_a_request_of_its_own(wm, model, label):
    helpful = Helpful()
    helpful.init(ReasonerWorldModel(model))
    model.add_reasoner(helpful)
    changes = []
    wm.add_listener(changes.append)
    helpful.execute()
    assert helpful.holds_lock.wait(10.0)
    if label == "rejected":
        with pytest.raises(WmException, match="refuses"):
            wm.add_element(product(label))
    else:
        wm.add_element(product(label))
    assert helpful.wait_stopped(10.0)
    (note,) = wm.resolve_elements(Element("skiros:Part"))  # it was reported as done
    published = [(change.author, [element.label for element in change.elements]) for change in changes]
    assert published == [("tester", ["a"])] * (label == "a") + [("Helpful", ["note"])]
    assert wm.get_element(note.id).id == note.id


def test_a_write_beside_a_parse_that_depends_on_a_rejected_change_is_logged(wm, model, caplog):
    class Attached(Helpful):
        def run(self):
            with self.mutex:
                self.holds_lock.set()
                assert self.in_parse.wait(10.0)
                (found,) = self._wmi.resolve_elements(Element("skiros:Product"))
                found.setProperty("skiros:Weight", 2.0)
                self._wmi.update_element(found, "Attached")

    attached = Attached()
    attached.init(ReasonerWorldModel(model))
    model.add_reasoner(attached)
    attached.execute()
    assert attached.holds_lock.wait(10.0)
    with pytest.raises(WmException, match="refuses"):
        wm.add_element(product("rejected"))
    assert attached.wait_stopped(10.0)
    assert "a change of Attached that depends on another one is lost with it" in caplog.text
