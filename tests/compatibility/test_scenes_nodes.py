"""The world model node with missing and broken scenes."""

from pathlib import Path

import pytest

from compatibility.rules import rule
from skiros2_common.core.world_element import Element
from support.ros import Ros

HEAD = "@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .\n:Scene-0 a :Scene .\n"


@pytest.fixture
def start(ros: Ros, tmp_path: Path):
    def start(**params):
        params = {"workspace_dir": str(tmp_path), "journal": False, **params}
        return ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)

    return start


@pytest.fixture
def connect():
    from skiros2_world_model.ros.world_model_interface import WorldModelInterface

    return lambda: WorldModelInterface("tester")


@rule("robustness", '`init_scene` that is missing: the node stays up with a blank scene, which `save("")` writes there')
def test_a_missing_scene(start, connect, tmp_path):
    node = start(init_scene="new.ttl")
    wmi = connect()
    node.wait_for_line(r"ERROR.*new\.ttl")
    assert wmi.get_scene_name() == "new.ttl"
    box = wmi.add_element(Element("skiros:LargeBox", "box"))
    assert wmi.save("")
    assert box.id.partition(":")[2] in (tmp_path / "new.ttl").read_text()
    assert node.status is None


@rule("robustness", "Files that do not parse: the node says so with file and line, and stays up")
def test_broken_files(start, connect, tmp_path):
    for name in ("scene.ttl", "memory.ttl", "cell.owl"):
        (tmp_path / name).write_text(HEAD + "no Turtle")
    node = start(init_scene="scene.ttl", load_contexts=["memory memory.ttl"])
    wmi = connect()
    for name in ("scene.ttl", "memory.ttl", "cell.owl"):
        node.wait_for_line(rf"ERROR.*{name}, line 3")
    assert [e.id for e in wmi.get_scene_elements()] == ["skiros:Scene-0"]
    assert wmi.save("")
    assert (tmp_path / "scene.ttl.broken").read_text() == HEAD + "no Turtle"


@rule("robustness", "A scene with problems starts a node")
def test_flaws(start, connect, tmp_path):
    (tmp_path / "scene.ttl").write_text(HEAD + ":Pump-1 a :Pump ; :contain :Pump-9 .")
    node = start(init_scene="scene.ttl")
    assert connect().is_scene_element("skiros:Pump-1")
    node.wait_for_line(r"WARN.*scene\.ttl: loaded with 2 problems")
