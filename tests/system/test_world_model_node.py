"""The world model node: services, topics, parameters, shutdown and restart."""

from __future__ import annotations

import itertools
import json
import os
import signal
import socket
import threading
import time
from pathlib import Path

import pytest
import rospy
import tf2_ros
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage

from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.ros.ontology_interface import OntologyInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import ROOT, Ros, RosMaster, wait_until

pytestmark = pytest.mark.timeout(90)

SCENE = "skiros:Scene-0"

SCENE_TEXT = """@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
:Scene-0 a :Scene ; :FrameId "map" ; :contain :LargeBox-80 .
:LargeBox-80 a :LargeBox ; rdfs:label "tray" ; :SizeX 0.5 ; :contain :Starter-81 .
:Starter-81 a :Starter ; rdfs:label "starter" .
"""


@pytest.fixture
def workspace(tmp_path):
    folder = tmp_path / "workspace"
    (folder / "scenes").mkdir(parents=True)
    (folder / "scenes" / "lab.ttl").write_text(SCENE_TEXT)
    return folder


@pytest.fixture
def start(ros: Ros, workspace):
    """Starts a world model node and waits until it answers."""

    def start(**params):
        params = {"workspace_dir": str(workspace), **params}
        node = ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)
        ros.service("/wm/get", srvs.WmGet)
        return node

    return start


@pytest.fixture(scope="module")
def shared(ros_master: RosMaster, tmp_path_factory: pytest.TempPathFactory):
    """The services of a node that the tests of the services share."""
    workspace = tmp_path_factory.mktemp("shared")
    ros = Ros(ros_master)
    ros.run(
        "skiros2_world_model", "world_model_server_node", name="wm", namespace="shared",
        params={"workspace_dir": str(workspace)},
    )  # fmt: skip
    yield Services(ros, "/shared/wm", workspace)
    ros.stop()


@pytest.fixture
def wm(shared: Services):
    """These, with a fresh scene."""
    (shared.workspace / "lab.ttl").write_text(SCENE_TEXT)
    shared.call("load_and_save", srvs.WoLoadAndSave, "load", "lab.ttl", "scene")
    return shared


class Services:
    """The services of a world model, called as programs in the field call them."""

    def __init__(self, ros: Ros, node: str = "/wm", workspace: Path | None = None):
        self.ros = ros
        self.node = node
        self.workspace = workspace
        self.modify_service = ros.service(f"{node}/modify", srvs.WmModify)
        self.get_service = ros.service(f"{node}/get", srvs.WmGet)

    def get(self, action="get", element=None, context="scene", **filters):
        element = element if element is not None else msgs.WmElement()
        return self.get_service(action=action, context=context, element=element, **filters)

    def element(self, eid):
        return self.get(element=msgs.WmElement(id=eid)).elements[0]

    def modify(self, action, *elements, context="scene", **filters):
        answer = self.modify_service(author="field", action=action, context=context, elements=list(elements), **filters)
        return list(answer.elements)

    def call(self, name, kind, *fields):
        return self.ros.service(f"{self.node}/{name}", kind)(*fields)


def message(eid="", etype="", label="", relations=(), **properties):
    names = {str: "str", int: "int", float: "float", bool: "bool"}
    props = [
        msgs.Property(f"skiros:{key}", json.dumps([value]), names[type(value)]) for key, value in properties.items()
    ]
    return msgs.WmElement(eid, etype, label, props, [msgs.Relation(*r) for r in relations])


def values(element):
    return {p.key: json.loads(p.dataValue) for p in element.properties}


def refusal(call, *arguments, **fields):
    """What the service says when it refuses."""
    with pytest.raises(rospy.ServiceException) as error:
        call(*arguments, **fields)
    return str(error.value)


# -- the services --------------------------------------------------------------------------------------------------


def test_element_is_read_by_id_with_relations_in_both_directions(wm):
    tray = wm.element("skiros:LargeBox-80")
    assert (tray.id, tray.type, tray.label) == ("skiros:LargeBox-80", "skiros:LargeBox", "tray")
    assert values(tray) == {"skiros:SizeX": [0.5]}
    assert {(r.subjectId, r.predicate, r.objectId) for r in tray.relations} == {
        ("-1", "skiros:contain", "skiros:Starter-81"),
        (SCENE, "skiros:contain", "-1"),
    }


def test_templates_are_read_by_name_or_iri(wm):
    for name in ("skiros:starter", "http://rvmi.aau.dk/ontologies/skiros.owl#starter"):
        (starter,) = wm.get("get_template", message(label=name)).elements
        assert (starter.id, starter.type, starter.label) == ("", "skiros:Starter", "skiros:starter")
        assert values(starter)["skiros:Weight"] == [3.0]


def test_elements_are_resolved_by_type_label_and_properties(wm):
    def found(**wanted):
        return [e.id for e in wm.get("resolve", message(**wanted)).elements]

    assert found(etype="skiros:Container") == ["skiros:LargeBox-80"]
    assert found(etype="skiros:Container", label="other") == []
    assert found(etype="sumo:Object", SizeX=0.5) == ["skiros:LargeBox-80"]
    assert found(etype="skiros:Container", SizeX="", SizeY="") == ["skiros:LargeBox-80"]
    assert found(etype="skiros:Container", SizeX=0.4) == []


def test_branch_is_read_along_a_relation(wm):
    def found(**filters):
        return [e.id for e in wm.get("get_recursive", message(SCENE), **filters).elements]

    assert found(relation_filter="skiros:sceneProperty") == [SCENE, "skiros:LargeBox-80", "skiros:Starter-81"]
    assert found(relation_filter="skiros:hasA") == [SCENE]
    assert found(relation_filter="skiros:contain", type_filter="skiros:Product") == ["skiros:Starter-81"]


def test_add_returns_the_new_id(wm):
    relation = ("skiros:LargeBox-80", "skiros:contain", "-1")
    (added,) = wm.modify("add", message(etype="skiros:Starter", label="new", relations=[relation], Weight=2.5))
    assert added.id == "skiros:Starter-82"
    assert values(wm.element(added.id)) == {"skiros:Weight": [2.5]}
    (clash,) = wm.modify("add", message("skiros:Product-80", "skiros:Product"))
    assert clash.id == "skiros:Product-83"


def test_update_writes_the_whole_element(wm):
    tray = message("skiros:LargeBox-80", "skiros:LargeBox", "renamed", [(SCENE, "skiros:contain", "-1")], SizeY=2.0)
    (answer,) = wm.modify("update", tray)
    assert (answer.label, values(answer)) == ("renamed", {"skiros:SizeY": [2.0]})
    assert [r.subjectId for r in answer.relations] == [SCENE]


def test_update_of_properties_keeps_relations(wm):
    (answer,) = wm.modify("update_properties", message("skiros:LargeBox-80", "skiros:LargeBox", "tray", SizeY=2.0))
    assert values(answer) == {"skiros:SizeY": [2.0]}
    assert len(answer.relations) == 2


def test_remove_removes_an_element_or_its_branch(wm):
    wm.modify("remove", message("skiros:LargeBox-80"))
    assert wm.element("skiros:Starter-81").relations == []
    (tray,) = wm.modify(
        "add", message(etype="skiros:LargeBox", relations=[("-1", "skiros:contain", "skiros:Starter-81")])
    )
    wm.modify("remove_recursive", message(tray.id))
    assert wm.get("resolve", message(etype="skiros:Manipulatable")).elements == []


def test_relations_are_set_and_queried(wm):
    relation = msgs.Relation("skiros:Starter-81", "skiros:at", "skiros:LargeBox-80")
    assert wm.call("scene/set_relation", srvs.WmSetRelation, "field", relation, True).ok
    ask = srvs.WmQueryRelationsRequest(msgs.Relation("skiros:Starter-81", "skiros:conditionProperty", ""))
    (found,) = wm.call("scene/query_relations", srvs.WmQueryRelations, ask).matches
    assert found == relation
    assert wm.call("scene/set_relation", srvs.WmSetRelation, "field", relation, False).ok
    assert wm.call("scene/query_relations", srvs.WmQueryRelations, ask).matches == []


def test_ontologies_are_queried_and_extended(wm):
    query = "SELECT ?x ?y WHERE { ?x rdfs:label ?y . ?x a/rdfs:subClassOf* skiros:Container }"
    assert wm.call("ontology/query", srvs.WoQuery, query, "", True).answer == ["skiros:LargeBox-80 tray "]
    iri = "<http://rvmi.aau.dk/ontologies/skiros.owl#LargeBox-80>"
    assert wm.call("ontology/query", srvs.WoQuery, query, "", False).answer == [f'{iri} "tray" ']
    statement = msgs.Statement(msgs.Relation("skiros:Tote", "rdfs:subClassOf", "skiros:Container"), True)
    assert wm.call("ontology/modify", srvs.WoModify, "field", "", [statement]).ok
    wm.modify("add", message(etype="skiros:Tote", label="tote"))
    assert len(wm.get("resolve", message(etype="skiros:Container")).elements) == 2


def test_statements_about_elements_change_the_scene(wm):
    def modify(*statements):
        made = [msgs.Statement(msgs.Relation(*parts), value) for *parts, value in statements]
        return wm.call("ontology/modify", srvs.WoModify, "field", "scene", made)

    modify(
        ("skiros:Part-90", "rdf:type", "skiros:Part", True),
        ("skiros:Part-90", "rdfs:label", '"a part"', True),
        ("skiros:LargeBox-80", "skiros:contain", "skiros:Part-90", True),
        ("skiros:LargeBox-80", "skiros:contain", "skiros:Starter-81", False),
        ("skiros:LargeBox-80", "skiros:SizeX", '"0.5"^^xsd:double', False),
        ("skiros:LargeBox-80", "skiros:SizeY", "1.5", True),
    )
    tray = wm.element("skiros:LargeBox-80")
    assert values(tray) == {"skiros:SizeY": [1.5]}
    assert {r.objectId for r in tray.relations} == {"skiros:Part-90", "-1"}
    assert wm.element("skiros:Part-90").label == "a part"
    assert "skiros:Part-99" in refusal(modify, ("skiros:Part-99", "skiros:SizeX", "1.5", True))


def test_scenes_are_saved_and_loaded(wm):
    assert wm.call("load_and_save", srvs.WoLoadAndSave, "save", "saved.ttl", "scene").ok
    wm.modify("remove_recursive", message("skiros:LargeBox-80"))
    assert wm.call("load_and_save", srvs.WoLoadAndSave, "load", "saved.ttl", "scene").ok
    assert wm.element("skiros:Starter-81").label == "starter"
    assert (wm.workspace / "saved.ttl").read_text().startswith("@prefix")


def test_lock_is_granted_in_turn_and_released_once(ros: Ros, wm):
    lock = ros.service("/shared/wm/lock", SetBool)
    assert lock(True).success
    taken = threading.Event()
    waiting = threading.Thread(target=lambda: lock(True).success and taken.set())
    waiting.start()
    assert not taken.wait(0.3)
    assert lock(False).success
    assert taken.wait(5.0)
    waiting.join()
    assert lock(False).success
    assert not lock(False).success


def test_lock_of_a_dead_node_is_released(ros: Ros, wm):
    code = (
        "import rospy; from std_srvs.srv import SetBool; rospy.init_node('holder'); "
        "rospy.ServiceProxy('/shared/wm/lock', SetBool)(True); print('locked', flush=True); rospy.spin()"
    )
    holder = ros.program(str(ROOT / ".venv/bin/python3"), "-c", code)
    holder.wait_for_line("locked")
    holder.signal(signal.SIGKILL)
    lock = ros.service("/shared/wm/lock", SetBool)
    assert lock(True).success
    assert lock(False).success


# -- the monitor ---------------------------------------------------------------------------------------------------


def test_changes_are_published_as_a_chain(ros: Ros, wm):
    monitor = ros.messages("/shared/wm/monitor", msgs.WmMonitor)
    before = wm.get(element=message(SCENE)).snapshot_id
    monitor.wait_for(lambda m: m.snapshot_id == before)  # the latched one
    monitor.clear()
    (part,) = wm.modify("add", message(etype="skiros:Part", label="part"))
    wm.modify("update_properties", message(part.id, "skiros:Part", "part", SizeX=1.0))
    relation = msgs.Relation(SCENE, "skiros:contain", part.id)
    wm.call("scene/set_relation", srvs.WmSetRelation, "field", relation, True)
    wm.call("scene/set_relation", srvs.WmSetRelation, "field", relation, False)
    wm.modify("remove", message(part.id))
    wm.call("load_and_save", srvs.WoLoadAndSave, "load", "lab.ttl", "scene")
    monitor.wait_for(lambda m: m.action == "reset")
    told = monitor.all
    assert [m.action for m in told] == ["add", "update", "add", "remove", "remove", "reset"]
    assert [m.author for m in told[:5]] == ["field"] * 5
    assert all(a.snapshot_id == b.prev_snapshot_id for a, b in itertools.pairwise(told))
    assert [[e.id for e in m.elements] for m in told[:2]] == [[part.id], [part.id]]
    assert values(told[1].elements[0]) == {"skiros:SizeX": [1.0]}
    assert told[2].elements == []
    assert [(r.subjectId, r.objectId) for r in told[2].relation] == [(SCENE, part.id)]
    assert {e.id for e in told[5].elements} == {SCENE, "skiros:LargeBox-80", "skiros:Starter-81"}
    assert wm.get(element=message(SCENE)).snapshot_id == told[-1].snapshot_id


def test_late_subscriber_receives_the_last_change(ros: Ros, wm):
    (part,) = wm.modify("add", message(etype="skiros:Part", label="part"))
    last = ros.messages("/shared/wm/monitor", msgs.WmMonitor).wait_for()
    assert [e.id for e in last.elements] == [part.id]


# -- bad input -----------------------------------------------------------------------------------------------------


def bad_requests():
    def modify(action, *elements, **filters):
        return lambda wm: wm.modify(action, *elements, **filters)

    def load(action, filename, context="scene"):
        return lambda wm: wm.call("load_and_save", srvs.WoLoadAndSave, action, filename, context)

    def relate(*parts):
        return lambda wm: wm.call("scene/set_relation", srvs.WmSetRelation, "field", msgs.Relation(*parts), True)

    wrong_type = message(etype="skiros:Part")
    wrong_type.properties = [msgs.Property("skiros:Value", '["/etc/passwd"]', "os.system")]
    no_json = message(etype="skiros:Part")
    no_json.properties = [msgs.Property("skiros:Value", "[oops", "str")]
    return {
        "get of no element": (lambda wm: wm.element("skiros:Part-9"), "skiros:Part-9"),
        "get of an unknown action": (lambda wm: wm.get("fetch"), "unknown action 'fetch'"),
        "get of an unknown context": (lambda wm: wm.get(element=message(SCENE), context="nowhere"), "nowhere"),
        "get of an unknown template": (lambda wm: wm.get("get_template", message(label="skiros:no")), "skiros:no"),
        "get of a branch of no element": (lambda wm: wm.get("get_recursive", message("skiros:Part-9")), "Part-9"),
        "modify with an unknown action": (modify("change", message(SCENE)), "unknown action 'change'"),
        "add without class": (modify("add", message(label="part")), "cannot be the name of a class"),
        "add of a type name that is not a type": (modify("add", wrong_type), "unknown type name 'os.system'"),
        "add of a value that is not JSON": (modify("add", no_json), "is not a JSON list"),
        "add of a value of another type": (modify("add", message(etype="skiros:Part", PositionX="left")), "PositionX"),
        "add under no element": (
            modify("add", message(etype="skiros:Part", relations=[("skiros:Part-9", "skiros:contain", "-1")])),
            "skiros:Part-9",
        ),
        "add of two, one of them bad": (
            modify("add", message(etype="skiros:Part"), message(etype="skiros:Part", PositionX="left")),
            "PositionX",
        ),
        "update of no element": (modify("update", message("skiros:Part-9", "skiros:Part")), "skiros:Part-9"),
        "update by an unknown reasoner": (
            modify("update_properties", message("skiros:LargeBox-80", "skiros:LargeBox"), type_filter="NoReasoner"),
            "NoReasoner",
        ),
        "removal of no element": (modify("remove", message("skiros:Part-9")), "skiros:Part-9"),
        "removal of the root": (modify("remove_recursive", message(SCENE)), SCENE),
        "a relation to no element": (relate(SCENE, "skiros:contain", "skiros:Part-9"), "skiros:Part-9"),
        "a tray in itself": (relate("skiros:Starter-81", "skiros:contain", "skiros:LargeBox-80"), "in itself"),
        "SPARQL that does not parse": (
            lambda wm: wm.call("ontology/query", srvs.WoQuery, "SELECT oops", "", True),
            "SELECT oops",
        ),
        "a statement that is none": (
            lambda wm: wm.call(
                "ontology/modify", srvs.WoModify, "field", "", [msgs.Statement(msgs.Relation("a", "b", "c"), True)]
            ),
            "'a' is not an RDF term",
        ),
        "loading what is not there": (load("load", "none.ttl"), "none.ttl"),
        "loading what is not RDF": (load("load", "broken.ttl"), "broken.ttl, line 1"),
        "loading from outside": (load("load", "../none.ttl"), "none.ttl: expected a file in the workspace"),
        "saving to outside": (load("save", "../../out.ttl"), "out.ttl: expected a file in the workspace"),
        "an unknown file action": (load("delete", "lab.ttl"), "unknown action 'delete'"),
        "an unknown operation": (
            lambda wm: wm.call(
                "transaction", srvs.WmTransaction, "field", "scene", [msgs.WmOperation(action="improve")]
            ),
            "unknown operation 'improve'",
        ),
    }


def test_bad_requests_are_rejected_with_the_reason_and_without_effect(wm):
    (wm.workspace / "broken.ttl").write_text("this is not Turtle")
    before = wm.get("get_recursive", message(SCENE), relation_filter="skiros:sceneProperty")
    for what, (request, wanted) in bad_requests().items():
        said = refusal(request, wm)
        assert wanted in said.replace("\\'", "'"), what
        after = wm.get("get_recursive", message(SCENE), relation_filter="skiros:sceneProperty")
        assert (after.snapshot_id, after.elements) == (before.snapshot_id, before.elements), what
    assert not list(wm.workspace.parent.glob("**/out.ttl"))
    assert "Traceback" not in wm.ros.programs[0].output, "a refusal is not a crash"


def test_request_with_one_bad_element_is_rejected_as_a_whole(wm):
    elements = [message(etype="skiros:Part", label=str(i)) for i in range(2000)]
    elements[-1] = message(etype="skiros:Part", PositionX="left")
    assert "PositionX" in refusal(wm.modify, "add", *elements)
    assert wm.get("resolve", message(etype="skiros:Part")).elements == []


# -- parameters ----------------------------------------------------------------------------------------------------


def test_without_a_scene_the_scene_is_blank(ros: Ros, start):
    start()
    assert [e.id for e in Services(ros).get("resolve", message(etype="sumo:Entity")).elements] == [SCENE]


def test_contexts_are_loaded_at_start(ros: Ros, start):
    start(load_contexts=["memory scenes/lab.ttl"])
    services = Services(ros)
    assert services.get(element=message("skiros:Starter-81"), context="memory").elements[0].label == "starter"
    assert "skiros:Starter-81" in refusal(services.element, "skiros:Starter-81")


def test_unknown_names_are_logged_or_rejected(ros: Ros, start):
    node = start()
    Services(ros).modify("add", message(etype="skiros:Pump", label="pump"))
    node.wait_for_line("field: unknown class skiros:Pump .*pump")


def test_strict_rejects_unknown_names(ros: Ros, start):
    start(strict=True)
    assert "unknown class skiros:Pump" in refusal(Services(ros).modify, "add", message(etype="skiros:Pump"))


@pytest.mark.parametrize(
    ("params", "culprit"),
    [
        ({"load_contexts": ["a/b scenes/lab.ttl"]}, "a/b"),
        ({"load_contexts": 5}, "/wm/load_contexts is 5, expected a list"),
        ({"workspace_dir": "/no/such/folder"}, "/no/such/folder"),
        ({"reasoners_pkgs": ["no_such_reasoners"]}, "no_such_reasoners"),
    ],
)
def test_configuration_error_ends_the_node_with_one_line(ros: Ros, workspace, params, culprit):
    params = {"workspace_dir": str(workspace), **params}
    node = ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)
    assert node.wait() == 78
    assert [line for line in node.output.splitlines() if culprit in line], node.output
    assert "Traceback" not in node.output


def test_a_namespace_moves_the_whole_node(ros: Ros, workspace):
    ros.run(
        "skiros2_world_model", "world_model_server_node", name="wm", namespace="cell",
        params={"workspace_dir": str(workspace), "init_scene": "scenes/lab.ttl"},
    )  # fmt: skip
    get = ros.service("/cell/wm/get", srvs.WmGet)
    assert get(action="get", context="scene", element=message("skiros:Starter-81")).elements


def test_the_ontology_node_serves_ontologies_alone(ros: Ros, workspace):
    (workspace / "factory.owl").write_text(
        "<http://x.org/Factory.owl> a <http://www.w3.org/2002/07/owl#Ontology> .\n"
        "<http://x.org/Factory.owl#Pallet> a <http://www.w3.org/2002/07/owl#Class> .\n"
    )
    ros.run("skiros2_world_model", "ontology_server_node", name="ontology", params={"workspace_dir": str(workspace)})
    query = ros.service("/ontology/ontology/query", srvs.WoQuery)
    assert query("SELECT ?x { ?x a owl:Class . FILTER(STRSTARTS(STR(?x), STR(factory:))) }", "", True).answer == [
        "factory:Pallet"
    ]
    modify = ros.service("/ontology/ontology/modify", srvs.WoModify)
    statement = msgs.Statement(msgs.Relation("factory:Crate", "rdf:type", "owl:Class"), True)
    assert modify("field", "", [statement]).ok
    assert "nowhere" in refusal(modify, "field", "nowhere", [statement])
    assert ros.service("/ontology/lock", SetBool)(True).success
    assert "/ontology/get" not in ros.master.services()


# -- the end and return of the server ------------------------------------------------------------------------------


@pytest.mark.parametrize("make_cache", [False, True])
def test_client_continues_with_a_restarted_server(ros: Ros, start, make_cache):
    start(init_scene="scenes/lab.ttl", journal=False)
    client = WorldModelInterface("tester", make_cache=make_cache)
    client.add_element(Element("skiros:Part", "first life"))
    os.kill(ros.master.node_pid("/wm"), signal.SIGKILL)
    start(init_scene="scenes/lab.ttl", journal=False)
    # What the second life has is seen at once by calls, and by a replica when the new server is heard.
    wait_until(lambda: not client.resolve_elements(Element("skiros:Part", "first life")))
    client.add_element(Element("skiros:Part", "second life"))
    assert len(client.resolve_elements(Element("skiros:Part", "second life"))) == 1
    assert client.get_element("skiros:Starter-81").label == "starter"


@pytest.mark.parametrize("make_cache", [False, True])
def test_client_that_missed_an_ontology_change_queries_again(ros: Ros, start, make_cache):
    start()
    client, other = (WorldModelInterface(name, make_cache) for name in ("tester", "other"))
    assert not client.is_subclass("skiros:OddPart", "skiros:Part")
    client.remote.unfollow()
    other.add_class("skiros:OddPart", "skiros:Part")
    other.add_element(Element("skiros:OddPart", "odd"))
    client.remote.follow()
    wait_until(lambda: client.is_subclass("skiros:OddPart", "skiros:Part"))
    assert client.resolve_element(Element("skiros:Part")).label == "odd"


def test_replica_and_ontologies_have_the_same_revision(ros: Ros, start):
    start()
    client, other = WorldModelInterface("tester", make_cache=True), WorldModelInterface("other")
    assert not client.is_subclass("skiros:OddPart", "skiros:Part")
    client.remote.unfollow()
    other.add_class("skiros:OddPart", "skiros:Part")
    other.add_element(Element("skiros:OddPart", "odd"))
    client.catch_up()
    assert client.resolve_element(Element("skiros:Part")).label == "odd"


def test_call_without_a_server_raises(ros: Ros, start):
    node = start()
    client = WorldModelInterface("tester")
    client.remote.services.get.timeout = client.remote.services.query.timeout = 0.2
    node.stop()
    assert not client.is_connected()
    with pytest.raises(WmException, match="service /wm/get does not answer"):
        client.get_element(SCENE)


def test_a_client_waits_for_the_server(ros: Ros, start):
    made = []
    waiting = threading.Thread(target=lambda: made.append(OntologyInterface("early")))
    waiting.start()
    start()
    waiting.join(20.0)
    assert made and made[0].is_subclass("skiros:LargeBox", "sumo:Object")


def test_calls_of_many_threads_are_independent(ros: Ros, start):
    start()
    client = WorldModelInterface("tester")
    elements = [Element("skiros:Part", f"part {i}") for i in range(8)]
    client.add_elements(elements)
    wrong = []

    def work(element):
        for _ in range(50):
            found = client.get_element(element.id)
            if found.label != element.label:
                wrong.append((element, found))

    threads = [threading.Thread(target=work, args=(e,)) for e in elements]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@pytest.mark.timeout(45)  # of the 60 s that rospy listens to a stranger
@pytest.mark.parametrize("words", [b"", b"\x10\x00", b"POST /RPC2 HTTP/1.1\r\nHost: localhost\r\n\r\n"])
def test_foreign_connections_do_not_block_others(ros: Ros, start, words):
    start()
    get = rospy.ServiceProxy("/wm/get", srvs.WmGet)
    address = ros.master.service_address("/wm/get")
    with socket.create_connection(address) as stranger:
        stranger.sendall(words)
        assert get(action="get", element=msgs.WmElement(id=SCENE)).elements
        if len(words) > 4:
            stranger.settimeout(30.0)
            with pytest.raises(ConnectionResetError):
                stranger.recv(1)


def test_concurrent_writers_of_different_properties_lose_nothing(ros: Ros, start):
    start()
    clients = [WorldModelInterface(name, make_cache=True) for name in ("one", "two")]
    part = Element("skiros:Part", "part")
    clients[0].add_element(part)

    def write(client, key):
        element = client.get_element(part.id)
        for number in range(1, 101):
            element.setProperty(key, number)
            client.update_element(element)

    keys = ("skiros:SizeX", "skiros:SizeY")
    clients[1].catch_up()
    threads = [threading.Thread(target=write, args=pair) for pair in zip(clients, keys, strict=True)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for client in clients:
        client.catch_up()
        found = client.get_element(part.id)
        assert [found.value_of(key) for key in keys] == [100, 100]


def test_reasoner_properties_are_written_alone(ros: Ros, start):
    start(init_scene="scenes/lab.ttl", reasoners_pkgs=["skiros2_std_reasoners"])
    services = Services(ros)
    tray = message("skiros:LargeBox-80", "skiros:LargeBox", "renamed", SizeX=0.7, SizeY=0.8, Weight=1.5)
    (answer,) = services.modify("update_properties", tray, type_filter="AauSpatialReasoner")
    assert answer.label == "tray"
    assert values(answer) == {"skiros:SizeX": [0.7], "skiros:SizeY": [0.8]}
    assert len(answer.relations) == 2


# -- tf ------------------------------------------------------------------------------------------------------------


def test_elements_are_published_on_tf_at_25_hz_under_their_parent_frame(ros: Ros, start):
    start(reasoners_pkgs=["skiros2_std_reasoners"])
    wm = WorldModelInterface("tester", make_cache=True)
    tray, hidden = Element("skiros:LargeBox", "tray"), Element("skiros:LargeBox", "hidden")
    for element in (tray, hidden):
        element.setData(":Pose", ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]))
        element.addRelation(SCENE, "skiros:contain", "-1")
    hidden.setProperty("skiros:PublishTf", False)
    tray.setProperty("skiros:PushToFrameId", "also_tray")
    wm.add_elements([tray, hidden])
    tf = ros.messages("/tf", TFMessage)
    first = tf.wait_for(lambda m: any(t.child_frame_id == tray.id for t in m.transforms))
    (transform,) = [t for t in first.transforms if t.child_frame_id == tray.id]
    assert transform.header.frame_id == "map"
    assert transform.transform.translation.y == 2.0
    assert {t.child_frame_id for t in first.transforms} == {tray.id, "also_tray"}
    begin = transform.header.stamp.to_sec()
    last = tf.wait_for(lambda m: m.transforms and m.transforms[0].header.stamp.to_sec() > begin + 2.0)
    count = [m for m in tf.all if m.transforms and begin <= m.transforms[0].header.stamp.to_sec()]
    rate = (len(count) - 1) / (last.transforms[0].header.stamp.to_sec() - begin)
    assert 22.0 < rate < 28.0


def test_tf_is_available_for_moving_moved_and_removed_elements(ros: Ros, start):
    start(reasoners_pkgs=["skiros2_std_reasoners"])
    wm = WorldModelInterface("tester", make_cache=True)
    buffer = tf2_ros.Buffer()
    tf2_ros.TransformListener(buffer)
    still, belt = Element("skiros:LargeBox", "still"), Element("skiros:LargeBox", "belt")
    for element in (still, belt):
        element.setData(":Pose", ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]))
        element.addRelation(SCENE, "skiros:contain", "-1")
    wm.add_elements([still, belt])

    def position(element, at=rospy.Time(0)):  # noqa: B008 - the latest
        return buffer.lookup_transform("map", element.id, at, rospy.Duration(5.0)).transform.translation

    for element in (still, belt):
        assert position(element).x == 1.0
        assert position(element, rospy.Time.now()).x == 1.0, "and now, a moment later"
    begin = rospy.Time.now()
    belt.setProperty("skiros:VelocityX", 1.0, "xsd:float")
    wm.update_element(belt)
    moved = wait_until(lambda: (x := position(belt).x) > 1.2 and x, what="movement")
    assert moved == pytest.approx(1.0 + (rospy.Time.now() - begin).to_sec(), abs=0.5)
    wait_until(lambda: wm.get_element(belt.id).getData(":Position")[0] > 1.2, what="the movement in the scene")
    assert position(belt, begin + rospy.Duration(0.2)).x < position(belt, begin + rospy.Duration(0.4)).x
    belt = wm.get_element(belt.id)
    belt.setProperty("skiros:VelocityX", 0.0, "xsd:float")
    belt.setData(":Position", [9.0, 2.0, 3.0])
    wm.update_element(belt)
    wait_until(lambda: position(belt, rospy.Time.now()).x == 9.0, what="the new place")
    late = tf2_ros.Buffer()
    tf2_ros.TransformListener(late)
    late.lookup_transform("map", still.id, rospy.Time(0), rospy.Duration(5.0))
    late.lookup_transform("map", still.id, rospy.Time.now(), rospy.Duration(5.0))
    assert late.lookup_transform("map", belt.id, rospy.Time(0), rospy.Duration(5.0)).transform.translation.x == 9.0
    removed = belt.id
    wm.remove_element(belt)
    tf = ros.messages("/tf", TFMessage)
    gone = tf.wait_for(lambda m: all(t.child_frame_id != removed for t in m.transforms))
    assert [t.child_frame_id for t in gone.transforms] == [still.id]


def test_poses_are_rebased_with_external_transforms(ros: Ros, start):
    start(reasoners_pkgs=["skiros2_std_reasoners"])
    wm = WorldModelInterface("tester", make_cache=True)
    part = Element("skiros:Part", "seen by a camera")
    part.setData(":Pose", ([1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]))
    part.setProperty("skiros:BaseFrameId", "camera")
    part.addRelation(SCENE, "skiros:contain", "-1")
    wm.add_element(part)
    assert part.value_of("skiros:BaseFrameId") == "camera"
    ros.program("rosrun", "tf2_ros", "static_transform_publisher", "0", "0", "5", "0", "0", "0", "map", "camera")
    wait_until(lambda: wm.get_element(part.id).value_of("skiros:BaseFrameId") == "map")
    assert wm.get_element(part.id).getData(":Position") == pytest.approx([1.0, 0.0, 5.0])
    reasoner = wm.get_reasoner("AauSpatialReasoner")
    position, _ = reasoner.get_transform("camera", part.id, rospy.Duration(5.0))
    assert position == pytest.approx((1.0, 0.0, 0.0))


def test_node_shuts_down_in_time(ros: Ros, start):
    node = start(reasoners_pkgs=["skiros2_std_reasoners"])
    begin = time.monotonic()
    node.interrupt()
    assert node.wait(10.0) == 0
    assert time.monotonic() - begin < 5.0
    assert "Traceback" not in node.output
