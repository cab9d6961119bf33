"""Scenes with problems, missing scenes and broken scenes."""

import logging
import re

import pytest

from compatibility.rules import rule
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.core.world_model_abstract_interface import WmException

HEAD = """@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
:Scene-0 a :Scene ; rdfs:label "lab" ; :contain :LargeBox-1 .
"""
#: What a line of a scene is, what loading it warns of, and what it does about that.
PROBLEMS = {
    "a doubled value": (':LargeBox-1 a :LargeBox ; :FrameId "one", "two" .', "2 values", "kept one"),
    "a dangling relation": (":LargeBox-1 a :LargeBox ; :contain :Starter-9 .", "no element .*Starter-9", "left out"),
    "an undeclared class": (":LargeBox-1 a :LargeBox . :Pump-3 a :Pump .", "unknown class skiros:Pump", "kept"),
    "an undeclared property": (":LargeBox-1 a :LargeBox ; :flow 2.5 .", "unknown property skiros:flow", "kept"),
    "an undeclared relation": (":LargeBox-1 a :LargeBox ; :feeds :Scene-0 .", "unknown relation skiros:feeds", "kept"),
    "a value of another type": (':LargeBox-1 a :LargeBox ; :PositionX "left" .', "PositionX.*left", "left out"),
    "a part of itself": (":LargeBox-1 a :LargeBox ; :contain :LargeBox-1 .", "contain themselves", "left out"),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    return tmp_path


@pytest.fixture
def start(folder):
    """A world model as the node starts it."""

    def start(scene="scene.ttl", strict=False, contexts=()):
        initial = [("scene", scene), *contexts]
        model = WorldModel(source_ontologies(), folder, strict, initial=initial, blank_on_error=True)
        return LocalWorldModel("tester", model)

    return start


@rule("robustness", "A scene with a problem loads, with one warning that names file, line and what was done")
@pytest.mark.parametrize("problem", PROBLEMS)
def test_a_scene_with_a_problem_loads(start, folder, caplog, problem):
    text, message, done = PROBLEMS[problem]
    (folder / "scene.ttl").write_text(HEAD + text)
    with caplog.at_level(logging.WARNING):
        wmi = start()
    (record,) = [r for r in caplog.records if r.levelno >= logging.WARNING]
    assert record.levelno == logging.WARNING
    assert f"{folder / 'scene.ttl'}, line 5: " in record.getMessage()
    assert re.search(message, record.getMessage())
    assert done in record.getMessage()
    assert wmi.get_element("skiros:LargeBox-1").hasRelation("skiros:Scene-0", "skiros:contain", "-1")


@rule("robustness", "All problems of a scene are in one warning", better="and say what was done about each")
def test_all_flaws_are_one_warning(start, folder, caplog):
    (folder / "scene.ttl").write_text(
        HEAD + ':LargeBox-1 a :LargeBox ;\n  :FrameId "one", "two" ;\n  :flow 1 ;\n  :contain :Starter-9 .\n'
    )
    with caplog.at_level(logging.WARNING):
        wmi = start()
    (record,) = [r for r in caplog.records if r.levelno >= logging.WARNING]
    lines = record.getMessage().splitlines()
    assert lines[0] == f"{folder / 'scene.ttl'}: loaded with 3 problems:"
    for line, name in ((6, "FrameId"), (7, "flow"), (8, "contain")):
        assert any(f"scene.ttl, line {line}: " in text and f"skiros:{name}" in text for text in lines)
    box = wmi.get_element("skiros:LargeBox-1")
    assert box.getProperty("skiros:FrameId").values == ["one"]
    assert box.getProperty("skiros:flow").value == 1
    assert box.getRelations("-1", "skiros:contain") == []


@rule("robustness", "Only a strict world model refuses a scene with problems", better="it lists all problems")
def test_a_strict_world_model_refuses_flaws(start, folder, caplog):
    (folder / "scene.ttl").write_text(HEAD + PROBLEMS["an undeclared class"][0] + PROBLEMS["a doubled value"][0])
    (folder / "good.ttl").write_text(HEAD + ":LargeBox-1 a :LargeBox .")
    wmi = start("good.ttl", strict=True)
    with pytest.raises(WmException, match=r"(?s)(FrameId.*Pump|Pump.*FrameId)"):
        wmi.load("scene.ttl")
    assert wmi.is_scene_element("skiros:LargeBox-1")


@rule("robustness", '`init_scene` that is missing: an error, a blank scene, and `save("")` writes it')
def test_save_creates_a_missing_scene_file(start, folder, caplog):
    wmi = start("new_scene.ttl")
    (record,) = [r for r in caplog.records if r.levelno == logging.ERROR]
    assert "new_scene.ttl" in record.getMessage()
    assert [e.id for e in wmi.get_scene_elements()] == ["skiros:Scene-0"]
    box = wmi.add_element(Element("skiros:LargeBox", "box"))
    assert wmi.save("")
    assert start("new_scene.ttl").get_element(box.id).label == "box"


@rule(
    "robustness",
    "`init_scene`, `load_contexts` or an ontology file that does not parse: an error that names file and reason, "
    "and the world model stays up",
)
def test_files_that_do_not_parse(start, folder, caplog):
    (folder / "scene.ttl").write_text("this is not Turtle")
    (folder / "memory.ttl").write_text(HEAD + "neither is this")
    (folder / "cell.owl").write_text("nor this")
    (folder / "plant.owl").write_text(
        "@prefix owl: <http://www.w3.org/2002/07/owl#> .\n@prefix : <http://x.org/plant.owl#> .\n"
        "<http://x.org/plant.owl> a owl:Ontology .\n:Valve a owl:Class .\n"
    )
    wmi = start(contexts=[("memory", "memory.ttl")])
    errors = [r.getMessage() for r in caplog.records if r.levelno == logging.ERROR]
    for name, line in (("scene.ttl", 1), ("memory.ttl", 5), ("cell.owl", 1)):
        assert any(error.partition(", column")[0].endswith(f"{folder / name}, line {line}") for error in errors)
    assert [e.id for e in wmi.get_scene_elements()] == ["skiros:Scene-0"]
    assert wmi.resolve_elements(Element(), "memory") == []
    assert wmi.get_type("plant:Valve") == ["owl:Class"]


@rule("robustness", 'A broken scene that `save("")` overwrites is kept beside it')
def test_a_broken_scene_is_kept_beside(start, folder):
    for number, kept in enumerate(["scene.ttl.broken", "scene.ttl.broken1"]):
        (folder / "scene.ttl").write_text(f"broken {number}")
        assert start().save("")
        assert (folder / kept).read_text() == f"broken {number}"
        assert start().get_scene_elements()[0].id == "skiros:Scene-0"
    assert start().save("")
    assert len(list(folder.glob("scene.ttl*"))) == 3


@rule("robustness", "A load at run time of a missing, broken or rootless file (no `skiros:Scene-0`) keeps the scene")
def test_refused_load_keeps_the_scene(start, folder):
    (folder / "scene.ttl").write_text(HEAD + ":LargeBox-1 a :LargeBox .")
    (folder / "broken.ttl").write_text("this is not Turtle")
    (folder / "rootless.ttl").write_text(HEAD.partition(":Scene-0")[0] + ":LargeBox-7 a :LargeBox .")
    wmi = start()
    for name in ("missing.ttl", "broken.ttl", "rootless.ttl"):
        before = wmi.get_scene()[1]
        with pytest.raises(WmException, match=name):
            wmi.load(name)
        assert wmi.is_scene_element("skiros:LargeBox-1")
        assert wmi.get_scene()[1] == before
    assert wmi.load("rootless.ttl", "memory")
    assert wmi.get_element("skiros:LargeBox-7", "memory")
