"""Validation by a world model node: on load, and by the service `~validation`."""

from __future__ import annotations

import pytest
import rospy

from skiros2_common.core.world_element import Element
from skiros2_msgs import srv as srvs
from skiros2_world_model.ros.world_model_interface import WmException, WorldModelInterface
from support.ros import Ros, run_command

pytestmark = pytest.mark.timeout(90)

SCENE = """@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .
:Scene-0 a :Scene ; :contain :LargeBox-80 .
:LargeBox-80 a :LargeBox ; :SizeX {size} .
"""
SHAPES = """@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix sh: <http://www.w3.org/ns/shacl#> .
<urn:Weighed> a sh:PropertyShape ; sh:targetClass :Container ; sh:path :Weight ; sh:minCount 1 ;
    sh:message "a box is weighed" ; sh:severity sh:Warning .
"""


@pytest.fixture
def workspace(tmp_path):
    (tmp_path / "lab.ttl").write_text(SCENE.format(size=-1))
    (tmp_path / "better.ttl").write_text(SCENE.format(size=1))
    (tmp_path / "cell.shapes.ttl").write_text(SHAPES)
    return tmp_path


@pytest.fixture
def start(ros: Ros, workspace):
    def start(**params):
        params = {"workspace_dir": str(workspace), "init_scene": "lab.ttl", "journal": False, **params}
        return ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)

    return start


def told(findings):
    return {(f.severity, f.element, f.property, f.text) for f in findings}


SIZE = ("violation", "skiros:LargeBox-80", "skiros:SizeX", "a size is a finite number from 0 on, not -1")
WEIGHT = ("warning", "skiros:LargeBox-80", "skiros:Weight", "a box is weighed")


def test_files_are_validated_on_load_and_the_scene_on_request(ros: Ros, start, workspace):
    node = start()
    node.wait_for_line(r"lab\.ttl: 1 violation, 1 warning")
    ask = ros.service("/wm/validation", srvs.WmValidation)
    found = ask(context="scene")
    assert told(found.findings) == {SIZE, WEIGHT}
    assert {f.file for f in found.findings} == {"context scene"}
    assert 0 <= (rospy.Time.now() - found.stamp).to_sec() < 60
    wm = WorldModelInterface("tester")
    box = wm.get_element("skiros:LargeBox-80")
    box.setProperty("skiros:SizeX", 2)
    wm.update_element(box)
    assert told(wm.validate().findings) == {WEIGHT}
    wm.load("better.ttl")
    assert told(ask().findings) == {WEIGHT}
    assert wm.validate("other").findings == []
    shown = run_command(["rosrun", "skiros2_world_model", "validate"], ros.master.env)
    assert (shown.returncode, shown.stdout.splitlines()[0]) == (0, "context scene: 1 warning")


def test_a_strict_node_starts_blank_instead_of_from_a_scene_with_violations(ros: Ros, start):
    node = start(strict=True)
    node.wait_for_line("ERROR.*skiros:LargeBox-80 skiros:SizeX: a size is a finite number from 0 on")
    assert WorldModelInterface("tester").find_element("skiros:LargeBox-80") is None


def test_a_strict_node_keeps_its_scene(ros: Ros, start):
    start(strict=True, init_scene="better.ttl")
    wm = WorldModelInterface("tester")
    with pytest.raises(WmException, match=r"lab\.ttl.*skiros:SizeX"):
        wm.load("lab.ttl")
    assert wm.get_element("skiros:LargeBox-80").value_of("skiros:SizeX") == 1


def test_validation_on_load_can_be_disabled(ros: Ros, start):
    node = start(validate=False)
    assert told(ros.service("/wm/validation", srvs.WmValidation)().findings) == {SIZE, WEIGHT}
    assert "lab.ttl: 1 violation" not in node.output


def test_broken_shapes_file_ends_the_node_with_name_and_line(start, workspace):
    (workspace / "cell.shapes.ttl").write_text("@prefix sh: <http://www.w3.org/ns/shacl#> .\n<urn:S> a sh: ;;")
    node = start()
    assert node.wait() == 78
    assert "cell.shapes.ttl, line 2" in node.output


@pytest.mark.long
def test_element_of_a_class_declared_later_is_validated(start):
    start()
    wm = WorldModelInterface("tester")
    wm.add_class("skiros:Crate", "skiros:LargeBox")
    crate = Element("skiros:Crate", "one")
    crate.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    eid = wm.add_element(crate).id
    assert ("warning", eid, "skiros:Weight", "a box is weighed") in told(wm.validate().findings)
