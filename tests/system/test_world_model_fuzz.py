"""Random and hostile messages to the world model node."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
import rospy
from hypothesis import strategies as st
from hypothesis.stateful import rule, run_state_machine_as_test

from skiros2_common.core.operations import Add, Operation, Relate, Remove, Update
from skiros2_common.ros.utils import element2msg, msg2element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.ros.wire import operation2msg
from support.lab import LAB
from support.ros import Ros, RosMaster
from support.scene_model import SceneModel
from support.world_model_machine import (
    BAD_NAMES,
    FILTERS,
    NOBODY,
    PREDICATES,
    TYPES,
    Answer,
    Refused,
    WorldModelMachine,
    fuzz_settings,
    thing_of,
)

NODE = "/fuzz/wm"
SERVICES = {
    "get": srvs.WmGet,
    "modify": srvs.WmModify,
    "transaction": srvs.WmTransaction,
    "snapshot": srvs.WmSnapshot,
    "scene/set_relation": srvs.WmSetRelation,
    "scene/query_relations": srvs.WmQueryRelations,
    "load_and_save": srvs.WoLoadAndSave,
    "ontology/query": srvs.WoQuery,
    "ontology/modify": srvs.WoModify,
}
SCENE = "skiros:Scene-0"
TEXTS = [
    "",
    "scene",
    "ontology",
    "nowhere",
    "a/b",
    "../x",
    "\x00",
    "日本",
    "x" * 100_000,
    "'; DROP",
    "%s",
    "{}",
    "-1",
    SCENE,
]


class Node:
    """A world model node, its services, and what it publishes."""

    def __init__(self, ros: Ros, workspace: Path) -> None:
        self.workspace = workspace
        self.program = ros.run(
            "skiros2_world_model",
            "world_model_server_node",
            name="wm",
            namespace="fuzz",
            params={"workspace_dir": str(workspace)},
        )
        self._proxies: dict[str, rospy.ServiceProxy] = {}
        for name, kind in SERVICES.items():
            ros.service(f"{NODE}/{name}", kind)
            self._proxies[name] = rospy.ServiceProxy(f"{NODE}/{name}", kind, persistent=True)
        self.monitor = ros.messages(f"{NODE}/monitor", msgs.WmMonitor)

    def call(self, service: str, *fields: object) -> object:
        """The answer; raises `Refused` when the node refuses. A node that does not answer fails the test."""
        try:
            return self._proxies[service](*fields)
        except rospy.ServiceException as error:
            said = str(error)
            _, answered, text = said.partition("responded with an error: ")
            assert answered, said
            assert "error processing request" not in said, said  # a crash in the handler, no refusal
            raise Refused(ast.literal_eval(text).decode()) from None  # rospy gives the bytes as Python writes them

    def state(self) -> tuple[str, SceneModel]:
        answer = self.call("snapshot", "")
        elements = [msg2element(message) for message in answer.elements]
        relations = {(e.id, r["type"], r["dst"]) for e in elements for r in e.relation_view}
        return answer.snapshot_id, SceneModel({e.id: thing_of(e) for e in elements}, relations)


@pytest.fixture(scope="module")
def node(ros_master: RosMaster, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Node]:
    workspace = tmp_path_factory.mktemp("fuzz")
    (workspace / "lab.owl").write_text(LAB)
    (workspace / "blank.ttl").write_text(
        "@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .\n"
        "@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .\n"
        'skiros:Scene-0 a skiros:Scene ; rdfs:label "skiros:blank_scene" .\n'
    )
    ros = Ros(ros_master)
    node = Node(ros, workspace)
    yield node
    ros.stop()


class OverRos(WorldModelMachine):
    """Requests through the services of a node that serves all runs."""

    node: Node

    def sendable(self, texts: Sequence[str]) -> Sequence[str]:
        return [text for text in texts if text.isascii() or "\ud800" not in text]  # messages hold UTF-8

    def open(self) -> None:
        self.files("load", "blank.ttl")
        self.node.monitor.clear()
        self.first_snapshot = self.node.state()[0]

    def transact(self, operations: Sequence[Operation]) -> Answer:
        answer = self.node.call("transaction", "fuzz", "scene", [operation2msg(o) for o in operations])
        added = [element.id for change in answer.changes if change.action == "add" for element in change.elements]
        return Answer(list(answer.ids), added)

    def state(self) -> tuple[str, SceneModel]:
        return self.node.state()

    def files(self, action: str, filename: str) -> None:
        self.node.call("load_and_save", action, filename, "scene")

    def write(self, filename: str, content: bytes) -> None:
        path = self.node.workspace / filename
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)

    @rule(data=st.data(), action=st.sampled_from(["add", "update", "update_properties", "remove", "remove_recursive"]))
    def modify(self, data: st.DataObject, action: str) -> None:
        """The service that programs in the field call."""
        ids = data.draw(
            st.lists(st.sampled_from([*sorted(self.scene.things), *self.sendable(NOBODY)]), min_size=1, max_size=2)
        )
        elements = [self.draw_element(data, "" if action == "add" else eid) for eid in ids]
        if data.draw(st.integers(0, 3)) == 0:
            elements[0].type = data.draw(st.sampled_from(self.sendable(BAD_NAMES)))
        relation_filter, type_filter = data.draw(st.sampled_from(FILTERS)), ""
        operations: list[Operation] = {
            "add": lambda: [Add(e) for e in elements],
            "update": lambda: [Update(e) for e in elements],
            "update_properties": lambda: [Update(e, False) for e in elements],
            "remove": lambda: [Remove(e.id, False) for e in elements],
            "remove_recursive": lambda: [Remove(e.id, True, relation_filter) for e in elements],
        }[action]()
        sent = [element2msg(e) for e in elements]

        def transact(operations: Sequence[Operation]) -> Answer:
            request = "fuzz", action, relation_filter if "remove" in action else "", type_filter, "scene", sent
            answered = [e.id for e in self.node.call("modify", *request).elements]
            return Answer(answered, answered)

        self.send(operations, transact)

    @rule(data=st.data(), value=st.booleans())
    def set_relation(self, data: st.DataObject, value: bool) -> None:
        ends = [data.draw(st.sampled_from([*sorted(self.scene.things), *self.sendable(NOBODY)])) for _ in range(2)]
        pred = data.draw(st.sampled_from([*PREDICATES, *self.sendable(BAD_NAMES)]))

        def transact(operations: Sequence[Operation]) -> Answer:
            relation = msgs.Relation(ends[0], pred, ends[1])
            assert self.node.call("scene/set_relation", "fuzz", relation, value).ok
            return Answer([], [])

        self.send([Relate(ends[0], pred, ends[1], value)], transact)

    @rule(data=st.data(), service=st.sampled_from(["get", "scene/query_relations", "ontology/query", "snapshot"]))
    def ask_anything(self, data: st.DataObject, service: str) -> None:
        """Questions of any kind are answered or refused, and change nothing."""
        text = st.sampled_from([*TEXTS, *TYPES, *PREDICATES, *FILTERS, "SELECT ?x { ?x ?y ?z }", "ASK {}"])
        element = msgs.WmElement(data.draw(text), data.draw(text), data.draw(text), [], [])
        action = data.draw(st.sampled_from(["get", "get_template", "resolve", "get_recursive", "", "GET"]))
        request = {
            "get": lambda: (action, data.draw(text), element, data.draw(text), data.draw(text)),
            "scene/query_relations": lambda: (msgs.Relation(data.draw(text), data.draw(text), data.draw(text)),),
            "ontology/query": lambda: (data.draw(text), data.draw(text), data.draw(st.booleans())),
            "snapshot": lambda: (data.draw(text),),
        }[service]()
        try:
            self.node.call(service, *request)
        except Refused as refused:
            assert len(str(refused)) > 20

    def teardown(self) -> None:
        """All changes were published, in a chain."""
        if not hasattr(self, "snapshot_id") or self.snapshot_id == self.first_snapshot:
            return
        monitor = self.node.monitor
        monitor.wait_for(lambda m: m.snapshot_id == self.snapshot_id)
        told = monitor.all
        first = next(i for i, m in enumerate(told) if m.prev_snapshot_id == self.first_snapshot)
        for before, after in zip(told[first:], told[first + 1 :], strict=False):
            assert before.snapshot_id == after.prev_snapshot_id


def test_random_requests_match_a_plain_model(node: Node) -> None:
    OverRos.node = node
    run_state_machine_as_test(OverRos, settings=fuzz_settings(40, 25))
    assert "Traceback" not in node.program.output


# -- hostile messages ------------------------------------------------------------------------------------------------


def _part(**fields: object) -> object:
    return msgs.WmElement(**{"type": "skiros:Part", **fields})


def _valued(text: str, kind: str, key: str = "skiros:PositionX") -> object:
    return _part(properties=[msgs.Property(key, text, kind)])


def hostile_requests() -> dict[str, tuple[str, tuple[object, ...], str]]:
    """By flaw: the service, the fields of the request, and a part of the error text."""
    endless = "[" * 100_000 + "]" * 100_000

    def modify(action: str, *elements: object, context: str = "scene", type_filter: str = "") -> tuple[object, ...]:
        return "fuzz", action, "", type_filter, context, list(elements)

    def transaction(**fields: object) -> tuple[object, ...]:
        return "fuzz", "scene", [msgs.WmOperation(**fields)]

    def statements(*parts: str, context: str = "scene") -> tuple[object, ...]:
        return "fuzz", context, [msgs.Statement(msgs.Relation(*parts), True)]

    return {
        "an action that is none, of nothing": ("modify", modify("improve"), "unknown action 'improve'"),
        "an action that is empty": ("modify", modify("", _part()), "unknown action ''"),
        "a context that is not a name": ("modify", modify("add", _part(), context="a/b"), "a/b"),
        "a context that is the ontologies": ("modify", modify("add", _part(), context="ontology"), "ontology"),
        "a reasoner that is none": ("modify", modify("update_properties", _part(), type_filter="Oracle"), "Oracle"),
        "no class": ("modify", modify("add", msgs.WmElement()), "class"),
        "a type name that is not a type": ("modify", modify("add", _valued("[1]", "os.system")), "os.system"),
        "a type name that is a builtin": ("modify", modify("add", _valued("[1]", "eval")), "eval"),
        "an element as a value": ("modify", modify("add", _valued("[{}]", "skiros_wm::Element")), "element"),
        "JSON that is none": ("modify", modify("add", _valued("oops", "str")), "oops"),
        "JSON without end": ("modify", modify("add", _valued(endless, "list")), "skiros:PositionX"),
        "a text for a number": ("modify", modify("add", _valued('["left"]', "str")), "PositionX"),
        "a bool for a number": ("modify", modify("add", _valued("[true]", "bool")), "PositionX"),
        "a number that no float holds": ("modify", modify("add", _valued(f"[{10**400}]", "int")), "PositionX"),
        "a number that no int holds": ("modify", modify("add", _valued("[" + "9" * 5000 + "]", "int")), "PositionX"),
        "half a letter": ("modify", modify("add", _valued('["\\ud800"]', "str", "skiros:any")), "skiros:any"),
        "a property that is not a name": ("modify", modify("add", _valued("[1]", "int", "a b")), "a b"),
        "the class as a property": ("modify", modify("add", _valued('["x"]', "str", "rdf:type")), "rdf:type"),
        "a relation of nobody": (
            "modify",
            modify("add", _part(relations=[msgs.Relation("skiros:Part-9", "skiros:at", "-1")])),
            "skiros:Part-9",
        ),
        "an element in itself": (
            "modify",
            modify("add", _part(relations=[msgs.Relation("-1", "skiros:contain", "-1")])),
            "in itself",
        ),
        "a reference to nothing": (
            "modify",
            modify("add", _part(relations=[msgs.Relation("-1", "skiros:at", "#9")])),
            "#9",
        ),
        "an operation that is none": ("transaction", transaction(action="improve"), "unknown operation 'improve'"),
        "a relation that is missing": ("transaction", transaction(action="relate"), "one relation"),
        "a template that is none": (
            "transaction",
            transaction(action="instantiate", element=msgs.WmElement(label="skiros:none")),
            "skiros:none",
        ),
        "the removal of the root": ("modify", modify("remove_recursive", msgs.WmElement(id=SCENE)), SCENE),
        "SPARQL that does not parse": ("ontology/query", ("SELECT oops", "", True), "SELECT oops"),
        "SPARQL that writes": ("ontology/query", ("INSERT DATA { :a :b :c }", "", True), "INSERT"),
        "SPARQL that deletes": ("ontology/query", ("DROP ALL", "", True), "DROP ALL"),
        "SPARQL that asks others": (
            "ontology/query",
            ("SELECT * { SERVICE <http://localhost:1/> { ?x ?y ?z } }", "", True),
            "SERVICE",
        ),
        "a statement that is none": ("ontology/modify", statements("a", "b", "c"), "'a'"),
        "a statement about nobody": (
            "ontology/modify",
            statements("skiros:Part-9", "skiros:PositionX", "1.5"),
            "skiros:Part-9",
        ),
        "a class as an element": (
            "ontology/modify",
            statements("skiros:Jar", "rdf:type", "owl:Class"),
            "belongs in the ontologies",
        ),
        "a blank node as an element": (
            "ontology/modify",
            statements("_:x", "rdf:type", "skiros:Part"),
            "blank nodes",
        ),
        "a file action that is none": ("load_and_save", ("delete", "lab.owl", "scene"), "unknown action 'delete'"),
        "a file of another format": ("load_and_save", ("load", "picture.ttl", "scene"), "picture.ttl"),
        "a file name that is a folder": ("load_and_save", ("load", "folder", "scene"), "folder"),
        "a file name that is none": ("load_and_save", ("save", "", "empty"), "name of the file"),
    }


def test_hostile_requests_are_rejected_without_effect(node: Node) -> None:
    (node.workspace / "picture.ttl").write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00")
    (node.workspace / "folder").mkdir(exist_ok=True)
    node.call("load_and_save", "load", "blank.ttl", "scene")
    before, scene = node.state()
    wrong = []
    for what, (service, fields, named) in hostile_requests().items():
        try:
            node.call(service, *fields)
            said = "nothing"
        except Refused as refused:
            said = str(refused)
        if named not in said or len(said) > 5000:
            wrong.append(f"{what}: {len(said)} characters: {said[:300]}")
        after, scene_after = node.state()
        assert (after, scene_after.comparable()) == (before, scene.comparable()), what
    assert not wrong, "\n".join(wrong)
    assert "Traceback" not in node.program.output


@pytest.mark.long
def test_request_of_100_000_elements_is_atomic(node: Node) -> None:
    node.call("load_and_save", "load", "blank.ttl", "scene")
    before = node.state()[0]
    contained = [msgs.Relation(SCENE, "skiros:contain", "-1")]
    operations = [
        msgs.WmOperation(action="add", element=_part(label="one of many", relations=contained)) for _ in range(100_000)
    ]
    operations[-1].element.properties = [msgs.Property("skiros:PositionX", '["left"]', "str")]
    with pytest.raises(Refused, match="PositionX"):
        node.call("transaction", "fuzz", "scene", operations)
    assert node.state()[0] == before
    operations[-1].element.properties = []
    assert len(set(node.call("transaction", "fuzz", "scene", operations).ids)) == 100_000
    wanted = msgs.WmElement(type="skiros:Part", label="one of many")
    assert len(node.call("get", "resolve", "scene", wanted, "", "").elements) == 100_000
    node.call("load_and_save", "load", "blank.ttl", "scene")
    assert set(node.state()[1].things) == {SCENE}
