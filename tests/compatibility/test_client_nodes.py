"""The world model client with a node."""

import json
from pathlib import Path

import pytest

from compatibility.rules import rule
from compatibility.test_client import client_program
from contract.conftest import write_workspace
from skiros2_common.core.world_element import Element
from support.ros import Ros

SCENE = "skiros:Scene-0"


@pytest.fixture
def node(ros: Ros, tmp_path: Path):
    from skiros2_world_model.ros.world_model_interface import WorldModelInterface

    workspace = write_workspace(tmp_path / "workspace")
    params = {"workspace_dir": str(workspace), "init_scene": "blank.ttl", "journal": False}
    ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)
    return WorldModelInterface


@rule("client", "`get_scene_name()` gives the ROS parameter `wm/init_scene`")
def test_get_scene_name(node):
    assert node("tester").get_scene_name() == "blank.ttl"


@rule("client", "A program that works in two contexts leaves both as they were, with a cache and without")
@pytest.mark.parametrize("make_cache", [False, True])
def test_a_program_in_two_contexts(node, make_cache):
    client_program(node("tester", make_cache))


@rule("client", "Relations between contexts are read by `get_relations` of every client")
def test_relations_between_contexts(node):
    cached, other = node("cached", True), node("other")
    there = other.add_element(Element("skiros:Part", "there"), "database")
    cached.get_scene()
    assert other.set_relation(there.id, "skiros:at", SCENE)
    for wmi in (cached, other):
        (relation,) = wmi.get_relations(there.id, "skiros:at", SCENE)
        assert relation["src"] == "-1"


@rule(
    "wire",
    "`Property.dataValue` of a request is a JSON list; anything else is a service error and nothing changes",
    better="the error has all such properties of the request",
)
def test_data_values_that_are_no_list(node):
    import rospy

    from skiros2_msgs import msg as msgs
    from skiros2_msgs import srv as srvs

    wmi = node("tester")
    before = wmi.get_scene()[1]
    modify = rospy.ServiceProxy("wm/modify", srvs.WmModify)
    bad = {"skiros:A": "5", "skiros:B": "", "skiros:C": "no json", "skiros:Good": json.dumps([1])}
    properties = [msgs.Property(key, text, "int") for key, text in bad.items()]
    elements = [
        msgs.WmElement("", "skiros:Part", "one", properties, []),
        msgs.WmElement("", "skiros:Part", "two", [msgs.Property("skiros:D", "{}", "int")], []),
        msgs.WmElement("", "skiros:Part", "fine", [], []),
    ]
    with pytest.raises(rospy.ServiceException) as error:
        modify(author="tester", action="add", context="scene", elements=elements)
    for key in ("skiros:A", "skiros:B", "skiros:C", "skiros:D"):
        assert key in str(error.value)
    assert "skiros:Good" not in str(error.value)
    assert wmi.get_scene()[1] == before
