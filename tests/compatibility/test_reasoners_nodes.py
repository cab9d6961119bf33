"""The unchanged reasoners in tests/libraries/belt_reasoners on a world model node."""

from __future__ import annotations

from pathlib import Path

import pytest
import rospy
import tf2_ros

from compatibility.rules import rule
from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.world_model_abstract_interface import WmException
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.programs import Program
from support.ros import Ros, wait_until

pytestmark = pytest.mark.timeout(120)

SCENE = "skiros:Scene-0"
LIBRARIES = Path(__file__).parents[1] / "libraries"

SCENE_TEXT = """@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
skiros:Scene-0 a skiros:Scene ; skiros:FrameId "map" ; skiros:DiscreteReasoner "AauSpatialReasoner" ;
    skiros:contain skiros:LargeBox-1 .
skiros:LargeBox-1 a skiros:LargeBox ; rdfs:label "box" ; skiros:DiscreteReasoner "StockReasoner" ;
    skiros:contain skiros:Part-2 .
skiros:Part-2 a skiros:Part .
"""


class Line:
    """A world model node with the package, and a client."""

    def __init__(self, node: Program) -> None:
        self.node = node
        self.wmi = WorldModelInterface("tests", make_cache=True)
        self.modify = rospy.ServiceProxy("/wm/modify", srvs.WmModify)
        self.load_and_save = rospy.ServiceProxy("/wm/load_and_save", srvs.WoLoadAndSave)

    def stock(self, eid: str):
        return self.wmi.get_element(eid).getProperty("belt:Stock").value

    def log(self) -> tuple[int, list[str]]:
        """How often the reasoner's `run` was called, and what `parse` has seen."""
        books = self.wmi.resolve_elements(Element("skiros:Location", "log book"))
        if not books or not books[0].hasProperty("belt:Log", not_none=True):
            return 0, []
        rounds, _, seen = books[0].getProperty("belt:Log").value.partition(";")
        return int(rounds), [entry for entry in seen.split(",") if entry]

    def add(self, etype: str, label: str, parent: str = SCENE) -> Element:
        element = Element(etype, label)
        element.addRelation(parent, "skiros:contain", "-1")
        return self.wmi.add_element(element)


@pytest.fixture
def line(ros: Ros, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Line:
    monkeypatch.syspath_prepend(LIBRARIES)
    (tmp_path / "line.ttl").write_text(SCENE_TEXT)
    env = {**ros.master.env, "PYTHONPATH": f"{LIBRARIES}:{ros.master.env['PYTHONPATH']}"}
    params = {
        "workspace_dir": str(tmp_path),
        "init_scene": "line.ttl",
        "reasoners_pkgs": ["skiros2_std_reasoners", "belt_reasoners"],
    }
    node = ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params, env=env)
    ros.service("/wm/get", srvs.WmGet)
    return Line(node)


@rule(
    "reasoners",
    "A package of reasoners written for SkiROS2 runs unchanged: `run` reads the scene, `parse` sees every change and "
    "completes elements, own data are written with `update_properties`",
)
def test_a_package_of_reasoners_runs_unchanged(line):
    box = "skiros:LargeBox-1"
    wait_until(lambda: line.stock(box) == 1, what="the stock of the loaded box")
    assert line.wmi.get_element(box).label == "box"
    part = line.add("skiros:Part", "bolt", box)
    assert part.getProperty("skiros:Weight").value == 0.25
    wait_until(lambda: line.stock(box) == 2, what="the stock with the new part")
    line.wmi.remove_element(part)
    wait_until(lambda: line.stock(box) == 1, what="the stock without it")
    expected = ["update box", "add bolt", "update box", "remove bolt", "update box"]  # box: when its stock is written
    wait_until(lambda: line.log() == (1, expected), what="the log book")


@rule("reasoners", "A reasoner that rejects a change with False makes the request fail, and nothing changes")
def test_a_rejected_change_fails(line):
    with pytest.raises(WmException, match="StockReasoner"):
        line.add("skiros:Part", "forbidden")
    assert line.wmi.resolve_elements(Element("skiros:Part", "forbidden")) == []


@rule("reasoners", "A reasoner never ends the server, whatever it raises and wherever")
def test_a_reasoner_never_ends_the_server(line):
    part = line.add("skiros:Part", "explosive")
    assert line.wmi.is_scene_element(part.id)
    for text in ("broken_import", "FaultyConstructor", "FaultyInit", "FaultyRun", "what is this?"):
        line.node.wait_for_line(text)
    assert line.node.running


@rule("reasoners", "`load_and_save` of a scene: the reasoner stops, and its `run` is called again for the loaded scene")
def test_a_load_restarts_the_reasoner(line):
    box = "skiros:LargeBox-1"
    wait_until(lambda: line.log()[0] == 1, what="the first run")
    line.add("skiros:Part", "bolt", box)
    wait_until(lambda: line.stock(box) == 2, what="the stock with the new part")
    line.load_and_save("load", "line.ttl", "scene")
    wait_until(lambda: line.log()[0] == 2, what="the second run")
    wait_until(lambda: line.stock(box) == 1, what="the stock of the loaded scene")


@rule(
    "reasoners",
    "`wm/modify` `update_properties` with a reasoner's class name as `type_filter` writes exactly its "
    "`getAssociatedData()`",
)
def test_update_properties_writes_the_data_of_a_reasoner_alone(line):
    box = line.add("skiros:LargeBox", "box")
    message = msgs.WmElement(box.id, "skiros:LargeBox", "renamed", [], [])
    message.properties = [
        msgs.Property("belt:Stock", "[7]", "int"),
        msgs.Property("skiros:SizeX", "[0.5]", "float"),
        msgs.Property("skiros:DiscreteReasoner", '["StockReasoner"]', "str"),
    ]
    answer = line.modify(
        author="tests", action="update_properties", context="scene", elements=[message], type_filter="StockReasoner"
    )
    (written,) = answer.elements
    assert written.label == "box"
    assert {p.key: p.dataValue for p in written.properties} == {"belt:Stock": "[7]"}


@rule("reasoners", "A client computes with the reasoner: data by its codes, relations by `get_reasoner_relations`")
def test_a_client_computes_with_the_reasoner(line):
    full, empty = line.add("skiros:LargeBox", "full"), line.add("skiros:LargeBox", "empty")
    for element, stock in ((full, 5), (empty, 0)):
        element.setData(":Stock", stock)
        line.wmi.update_element(element)
    assert line.wmi.get_element(full.id).hasProperty("skiros:DiscreteReasoner", "StockReasoner")
    assert [r["type"] for r in line.wmi.get_reasoner_relations(full, ":fuller", empty)] == [":fuller"]
    assert line.wmi.get_reasoner_relations(empty, ":fuller", full) == []


@rule(
    "spatial",
    "An element with a pose and `skiros:PublishTf` is on tf below its spatial parent",
    better="below a parent that is not published it is connected to the nearest published ancestor; `validate` reports "
    "where none is",
)
def test_frame_below_an_unpublished_one_is_connected_to_the_root(line):
    buffer = tf2_ros.Buffer()
    tf2_ros.TransformListener(buffer)
    shelf, cup = Element("skiros:LargeBox", "shelf"), Element("skiros:Part", "cup")
    shelf.setData(":Pose", ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]))
    shelf.setProperty("skiros:PublishTf", False)
    shelf.addRelation(SCENE, "skiros:contain", "-1")
    line.wmi.add_element(shelf)
    cup.setData(":Pose", ([2.0, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0]))
    cup.addRelation(shelf.id, "skiros:contain", "-1")
    line.wmi.add_element(cup)
    found = buffer.lookup_transform("map", cup.id, rospy.Time(0), rospy.Duration(20.0)).transform
    assert (found.translation.x, found.translation.z) == pytest.approx((-1.0, 0.5))
    assert abs(found.rotation.z) == pytest.approx(1.0)
    assert not buffer.can_transform("map", shelf.id, rospy.Time(0))
