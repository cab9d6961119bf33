"""The life cycle of reasoners in the world model server."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from compatibility.rules import rule
from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.core.world_model_abstract_interface import WmException
from skiros2_world_model.ros.world_model_server import Reasoners

PACKAGE = "packing_reasoners"
SCENE = "skiros:Scene-0"

MODULE = """
from threading import Event

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.world_element import Element

LOG = []
EVENTS = {name: Event() for name in ("running", "stopped", "second run")}
HOOK = []


class BaseReasoner(DiscreteReasoner):
    def run(self):
        LOG.append("base run")


class PackReasoner(BaseReasoner):
    def __init__(self):
        LOG.append("constructed")

    def init(self, wmi):
        super(PackReasoner, self).init(wmi)
        LOG.append("initialised")

    def parse(self, element, action):
        LOG.append((action, element.label))
        if HOOK:
            return HOOK[0](element, action)

    def run(self):
        EVENTS["second run" if EVENTS["running"].is_set() else "running"].set()
        self._mine = [e.label for e in self._wmi.resolve_elements(Element("skiros:Product"))]
        while not self.stopRequested:
            EVENTS["stopped"].wait(0.01)
        LOG.append("stopped with {}".format(self._mine))
        EVENTS["stopped"].set()

    def onAddProperties(self, element):
        if not element.hasProperty("pack:Count"):
            element.setProperty("pack:Count", 3)

    def onRemoveProperties(self, element):
        element.removeProperty("pack:Count")

    def getAssociatedProperties(self):
        return [":Count"]

    def getAssociatedData(self):
        return ["pack:Count"]

    def getAssociatedRelations(self):
        return []


class FaultyReasoner(BaseReasoner):
    def init(self, wmi):
        raise ValueError("cannot be initialised")
"""


class Server:
    """A world model with the reasoners of a package, and a client of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.model = WorldModel(source_ontologies(), folder)
        self.wmi = LocalWorldModel("client", self.model)

    def start(self) -> None:
        self.reasoners = Reasoners(self.model, [PACKAGE])
        self.module = sys.modules[f"{PACKAGE}.pack"]
        self.log, self.events, self.hook = self.module.LOG, self.module.EVENTS, self.module.HOOK
        (self.reasoner,) = (r for r in self.model.reasoning.all() if repr(r) == "PackReasoner")
        assert self.events["running"].wait(10.0)

    @property
    def seen(self) -> list[tuple[str, str]]:
        return [entry for entry in self.log if isinstance(entry, tuple)]


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    package = tmp_path / "library" / PACKAGE
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "pack.py").write_text(MODULE)
    (package / "broken.py").write_text("import nothing_that_is_installed\n")
    monkeypatch.syspath_prepend(package.parent)
    server = Server(tmp_path)
    yield server
    if hasattr(server, "reasoners"):
        server.reasoners.stop()
    for name in [name for name in sys.modules if name.partition(".")[0] == PACKAGE]:
        del sys.modules[name]


def product(label: str, reasoner: str = "") -> Element:
    element = Element("skiros:Product", label)
    if reasoner:
        element.setProperty("skiros:DiscreteReasoner", reasoner)
    element.addRelation(SCENE, "skiros:contain", "-1")
    return element


@rule(
    "reasoners",
    "Of each package in `~reasoners_pkgs` the leaf classes derived from `DiscreteReasoner` are constructed, "
    "initialised and executed",
    better="a module that cannot be imported, or a reasoner that cannot be constructed or initialised, is reported and "
    "skipped",
)
def test_leaf_classes_are_loaded_and_executed(server, caplog):
    server.start()
    assert server.log == ["constructed", "initialised"]
    assert [repr(r) for r in server.model.reasoning.all()] == ["PackReasoner"]
    assert "cannot be initialised" in caplog.text
    assert "broken" in caplog.text


@rule("reasoners", "`execute()` starts a thread that calls `run()` and returns at once; `repr` is the class name")
def test_execute_returns_at_once():
    entered, leave = threading.Event(), threading.Event()

    class Slow(DiscreteReasoner):
        def run(self):
            entered.set()
            leave.wait(10.0)

    slow = Slow()
    slow.execute()
    assert entered.wait(10.0)
    assert not leave.is_set()
    leave.set()
    assert repr(slow) == "Slow"


@rule("reasoners", "`stop()` raises a flag; `stopRequested` tells it once and lowers it again")
def test_stop_request_is_reported_once():
    reasoner = DiscreteReasoner()
    assert not reasoner.stopRequested
    reasoner.stop()
    assert [reasoner.stopRequested, reasoner.stopRequested] == [True, False]


@rule(
    "reasoners",
    "Elements that are in the scene already are not offered through `parse`: a reasoner reads them in `run`",
)
def test_existing_elements_are_not_offered(server):
    server.wmi.add_element(product("early", "PackReasoner"))
    server.start()
    assert server.seen == []


@rule(
    "reasoners",
    "Before each add, update and remove in the scene, and in no other context, every reasoner gets "
    '`parse(element, "add"|"update"|"remove")`, whether the element names it or not',
    better="when a change is refused later, the reasoners get the reverse of what they were offered",
)
def test_every_change_is_offered_to_every_reasoner(server):
    server.start()
    ids = []
    server.hook.append(lambda element, action: ids.append(element.id))
    one, other = product("one", "PackReasoner"), product("other")
    server.wmi.add_elements([one, other])
    first = one.id
    server.wmi.add_element(product("elsewhere", "PackReasoner"), "memory")
    other.setProperty("skiros:Weight", 2.0)
    server.wmi.update_element(other)
    server.wmi.remove_element(one)
    assert server.seen == [("add", "one"), ("add", "other"), ("update", "other"), ("remove", "one")]
    assert ids == [first, other.id, other.id, first]


@rule("reasoners", "The element that `parse` gets is the new one; what the reasoner changes in it is stored")
def test_changes_of_a_reasoner_are_stored(server):
    server.start()

    def weigh(element, action):
        if action != "remove":
            element.setProperty("skiros:Weight", element.getProperty("skiros:SizeX").value * 2)

    server.hook.append(weigh)
    element = product("a")
    element.setProperty("skiros:SizeX", 1.5)
    server.wmi.add_element(element)
    assert element.getProperty("skiros:Weight").value == 3.0
    element.setProperty("skiros:SizeX", 2.5)
    server.wmi.update_element(element)
    assert server.wmi.get_element(element.id).getProperty("skiros:Weight").value == 5.0


@rule("reasoners", "The answer False rejects the change", better="the whole request is refused and nothing changes")
def test_false_rejects_the_change(server):
    server.start()
    server.hook.append(lambda element, action: element.label != "bad")
    with pytest.raises(WmException, match="PackReasoner refuses"):
        server.wmi.add_elements([product("good"), product("bad")])
    assert server.wmi.resolve_elements(Element("skiros:Product")) == []
    assert server.seen == [("add", "good"), ("add", "bad"), ("remove", "good")]


@rule("reasoners", "An exception in `parse` is logged, and the change stands")
def test_an_exception_in_parse_is_logged(server, caplog):
    server.start()
    server.hook.append(lambda element, action: element.no_such_method())
    element = product("a")
    server.wmi.add_element(element)
    assert server.wmi.is_scene_element(element.id)
    assert "PackReasoner" in caplog.text
    assert "no_such_method" in caplog.text


@rule(
    "reasoners",
    "Loading a scene stops all reasoners, loads, and executes all again",
    better="it waits up to 2 s until they have stopped; a file that is refused leaves the scene, and they are executed",
)
def test_a_load_stops_and_executes_reasoners(server):
    server.wmi.add_element(product("first"))
    server.wmi.save("first.ttl")
    server.start()
    server.wmi.add_element(product("second"))
    server.wmi.load("first.ttl")
    assert "stopped with ['first']" in server.log
    assert server.events["second run"].wait(10.0)
    assert server.seen == [("add", "second")]


@rule(
    "reasoners",
    "An element read from a file whose `skiros:DiscreteReasoner` names a loaded reasoner gets that reasoner's missing "
    "default properties",
)
def test_loaded_elements_get_missing_default_properties(server):
    (server.folder / "scene.ttl").write_text(
        """@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
        @prefix pack: <http://x.org/pack.owl#> .
        skiros:Scene-0 a skiros:Scene ; skiros:contain skiros:Product-1, skiros:Product-2 .
        skiros:Product-1 a skiros:Product ; skiros:DiscreteReasoner "PackReasoner", "NotLoaded" .
        skiros:Product-2 a skiros:Product ; skiros:DiscreteReasoner "PackReasoner" ; pack:Count 7 ."""
    )
    server.wmi.load("scene.ttl")
    server.start()
    for _ in range(2):
        counts = [server.wmi.get_element(f"skiros:Product-{n}").getProperty("pack:Count").value for n in (1, 2)]
        assert counts == [3, 7]
        server.wmi.load("scene.ttl")


@rule(
    "reasoners",
    "`addProperties(e)` names the reasoner in `skiros:DiscreteReasoner` unless it is named, then calls "
    "`onAddProperties(e)`; `removeProperties(e)` takes the name away, then calls `onRemoveProperties(e)`",
)
def test_properties_are_added_and_removed(server):
    server.start()
    element = Element("skiros:Product")
    for _ in range(2):
        server.reasoner.addProperties(element)
        assert element.getProperty("skiros:DiscreteReasoner").values == ["PackReasoner"]
        assert element.getProperty("pack:Count").value == 3
    server.reasoner.removeProperties(element)
    assert not element.hasProperty("skiros:DiscreteReasoner", "PackReasoner")
    assert not element.hasProperty("pack:Count")


# -- the world model that `init` gets ------------------------------------------------------------------------------


@pytest.fixture
def wmi(server):
    """The world model as the reasoner of a running server has it."""
    server.start()
    return server.reasoner._wmi


@rule("reasoners", "`wmi.get_recursive(id, rel_filter, type_filter)` gives a dict of elements by id, the root first")
def test_get_recursive_gives_a_dict(server, wmi):
    box, part, bolt = Element("skiros:LargeBox", "box"), Element("skiros:Part", "part"), Element("skiros:Part", "bolt")
    server.wmi.add_elements([box, part, bolt])
    server.wmi.set_relation(box.id, "skiros:contain", part.id)
    server.wmi.set_relation(part.id, "skiros:hasA", bolt.id)
    found = wmi.get_recursive(box.id)
    assert list(found) == [box.id, part.id, bolt.id]
    assert found[part.id].label == "part"
    assert list(wmi.get_recursive(box.id, "skiros:contain")) == [box.id, part.id]
    assert list(wmi.get_recursive(SCENE, "", "skiros:Part")) == [SCENE]
    assert list(wmi.get_recursive(box.id, "skiros:spatiallyRelated", "skiros:Part")) == [box.id, part.id, bolt.id]


@rule("reasoners", "`wmi.get_sub_properties`, `get_sub_classes` and `get_sub_relations` include the name itself")
def test_sub_names_include_the_name(wmi):
    assert "skiros:contain" in wmi.get_sub_properties("skiros:spatiallyRelated")
    assert wmi.get_sub_relations("skiros:spatiallyRelated")[0] == "skiros:spatiallyRelated"
    assert wmi.get_sub_properties("skiros:contain") == ["skiros:contain"]
    assert set(wmi.get_sub_classes("skiros:Container")) >= {"skiros:Container", "skiros:LargeBox"}
    assert wmi.get_sub_classes("skiros:LargeBox") == ["skiros:LargeBox"]


@rule("reasoners", "`wmi.get_element(id)` and `wmi.resolve_elements(description)` read the scene")
def test_elements_are_read(server, wmi):
    element = product("a")
    server.wmi.add_element(element)
    assert wmi.get_element(element.id).label == "a"
    assert [e.id for e in wmi.resolve_elements(Element("skiros:Product", "a"))] == [element.id]
    with pytest.raises(WmException):
        wmi.get_element("skiros:Product-999")


@rule("reasoners", "`wmi.add_element(e, author)`, `update_element(e, author)` and `remove_element(e, author)` write")
def test_elements_are_written_with_their_author(server, wmi):
    authors = []
    server.model.add_listener(lambda change: authors.append((change.action, change.author)))
    element = wmi.add_element(product("a"), "PackReasoner")
    element.setProperty("skiros:Weight", 1.5)
    element.label = "b"
    wmi.update_element(element, "PackReasoner")
    assert server.wmi.get_element(element.id).label == "b"
    wmi.remove_element(element.id, "somebody")
    assert not server.wmi.is_scene_element(element.id)
    assert authors == [("add", "PackReasoner"), ("update", "PackReasoner"), ("remove", "somebody")]


@rule(
    "reasoners", "`wmi.remove_recursive(e, author, rel_filter, type_filter)` removes an element with what is under it"
)
def test_a_branch_is_removed(server, wmi):
    box, part = Element("skiros:LargeBox"), Element("skiros:Part")
    box.addRelation(SCENE, "skiros:contain", "-1")
    box.addRelation("-1", "skiros:contain", part)
    server.wmi.add_element(box)
    wmi.remove_recursive(wmi.get_element(box.id), "PackReasoner", "skiros:contain", "")
    assert [e.id for e in server.wmi.resolve_elements(Element(""))] == [SCENE]


@rule(
    "reasoners",
    "`wmi.update_properties(e, author, reasoner, publish)` writes only the reasoner's `getAssociatedData()`; without a "
    "reasoner all properties; never relations",
    differs="every change is published, also with `publish=False`; without that the copies of other programs were out "
    "of date",
)
def test_only_the_data_of_a_reasoner_are_written(server, wmi):
    element = wmi.add_element(product("a", "PackReasoner"), "PackReasoner")
    for reasoner, weight in ((server.reasoner, None), (None, 2.0)):
        changed = wmi.get_element(element.id)
        changed.setProperty("pack:Count", changed.getProperty("pack:Count").value + 1)
        changed.setProperty("skiros:Weight", 2.0)
        changed.removeRelation2(SCENE, "skiros:contain", "-1")
        wmi.update_properties(changed, "PackReasoner", reasoner, False)
        stored = server.wmi.get_element(element.id)
        assert stored.value_of("skiros:Weight") == weight
        assert stored.hasRelation(SCENE, "skiros:contain", "-1")
    assert stored.getProperty("pack:Count").value == 5


@rule(
    "reasoners", "An element that a reasoner keeps can be changed and written again and again, also back to the first"
)
def test_a_kept_element_is_written_again(server, wmi):
    kept = []
    server.hook.append(lambda element, action: kept.append(element))
    server.wmi.add_element(product("a", "PackReasoner"))
    element = kept[0]
    first = element.getProperty("pack:Count").value
    for value in (first + 1, first, first + 1):
        element.setProperty("pack:Count", value)
        wmi.update_properties(element, "PackReasoner", server.reasoner)
        assert server.wmi.get_element(element.id).getProperty("pack:Count").value == value


@rule(
    "reasoners", "`wmi.add_relation(dict, author, is_relation)`, `remove_relation` and `get_relations(dict)` take dicts"
)
def test_relations_are_dicts(server, wmi):
    box, part = Element("skiros:LargeBox"), Element("skiros:Part")
    server.wmi.add_elements([box, part])
    relation = {"src": box.id, "type": "skiros:contain", "dst": part.id}
    wmi.add_relation(relation, "PackReasoner", True)
    assert server.wmi.get_relations(box.id, "skiros:contain", part.id)
    (found,) = wmi.get_relations({"src": box.id, "type": "skiros:spatiallyRelated", "dst": ""})
    assert (found["src"], found["type"], found["dst"]) == (box.id, "skiros:contain", part.id)
    wmi.remove_relation(relation, "PackReasoner", True)
    assert wmi.get_relations({"src": box.id, "type": "", "dst": "-1"}) == []
    weight = {"src": box.id, "type": "skiros:Weight", "dst": 1.5}
    wmi.add_relation(weight, "PackReasoner", False)
    assert server.wmi.get_element(box.id).getProperty("skiros:Weight").values == [1.5]
    wmi.remove_relation(weight, "PackReasoner", False)
    assert not server.wmi.get_element(box.id).hasProperty("skiros:Weight", 1.5)


@rule(
    "reasoners",
    "`wmi.get_reasoner(name)` gives a loaded reasoner by class name or code, else None; `wmi.query(sparql)` the rows",
)
def test_reasoners_and_queries(server, wmi):
    assert wmi.get_reasoner("PackReasoner") is wmi.get_reasoner(":Count") is server.reasoner
    assert wmi.get_reasoner("Nobody") is None
    server.wmi.add_element(product("a"))
    (row,) = wmi.query("SELECT ?x WHERE { ?x rdf:type skiros:Product }")
    assert "Product-" in str(row)


@rule(
    "reasoners",
    "A reasoner may write to the world model from `parse`",
    better="it becomes part of the change that is offered: both stand, or neither",
)
def test_a_reasoner_may_write_from_parse(server, wmi):
    def parse(element, action):
        if action == "add" and element.type == "skiros:Product":
            label = Element("skiros:Part", "label of " + element.label)
            label.addRelation(element.id, "skiros:hasA", "-1")
            wmi.add_element(label, "PackReasoner")
        return element.label != "bad"

    server.hook.append(parse)
    element = product("a")
    server.wmi.add_element(element)
    with pytest.raises(WmException):
        server.wmi.add_element(product("bad"))
    (label,) = server.wmi.resolve_elements(Element("skiros:Part"))
    assert server.wmi.get_relations(element.id, "skiros:hasA", label.id)
