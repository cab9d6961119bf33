"""Scenes written by other tools load, including content that the ontologies do not declare."""

import logging

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model import WorldModel

HEAD = """@prefix default1: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix SUMO: <http://www.inf.ufrgs.br/phi-group/ontologies/sumo.owl#> .
@prefix cora: <http://www.inf.ufrgs.br/phi-group/ontologies/cora.owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
default1:Scene-0 a default1:Scene, owl:NamedIndividual ; rdfs:label "lab" .
"""


@pytest.fixture
def load(wm, workspace):
    def load(text, head=HEAD):
        (workspace / "scene.ttl").write_text(head + text)
        wm.load("scene.ttl")
        return wm

    return load


def test_prefixes_of_the_file_do_not_rename_those_of_the_ontologies(load):
    wm = load("SUMO:Object-3 a SUMO:Object .")
    assert wm.get_element("sumo:Object-3").type == "sumo:Object"
    assert wm.get_element("skiros:Scene-0").label == "lab"


def test_one_number_under_two_types_loads(load):
    wm = load("default1:LargeBox-7 a default1:LargeBox . default1:Starter-7 a default1:Starter .")
    assert wm.get_element("skiros:LargeBox-7").id != wm.get_element("skiros:Starter-7").id


def test_unknown_names_are_kept_and_logged_with_file_and_element(load, caplog):
    with caplog.at_level(logging.WARNING):
        wm = load("default1:Pump-4 a default1:Pump ; default1:flow 2.5 ; default1:feeds default1:Scene-0 .")
    pump = wm.get_element("skiros:Pump-4")
    assert pump.value_of("skiros:flow") == 2.5
    assert pump.hasRelation("-1", "skiros:feeds", "skiros:Scene-0")
    for kind, name in (("class", "skiros:Pump"), ("property", "skiros:flow"), ("relation", "skiros:feeds")):
        assert any("scene.ttl" in m and f"unknown {kind} {name}" in m and "skiros:Pump-4" in m for m in caplog.messages)


def test_a_position_with_x_alone_loads_and_the_rest_is_missing(load):
    wm = load('default1:LargeBox-1 a default1:LargeBox ; default1:PositionX "1.5"^^xsd:float ; default1:PositionY "" .')
    box = wm.get_element("skiros:LargeBox-1")
    assert box.value_of("skiros:PositionX") == 1.5
    assert box.value_of("skiros:PositionY") is None
    assert box.value_of("skiros:PositionZ") is None


def test_numbers_and_bools_written_as_text_are_converted(load):
    wm = load('default1:LargeBox-1 a default1:LargeBox ; default1:PositionX "1.5" ; default1:PublishTf "True" ; '
              'default1:SizeX "0.5" .')  # fmt: skip
    box = wm.get_element("skiros:LargeBox-1")
    assert box.value_of("skiros:PositionX") == 1.5
    assert box.value_of("skiros:PublishTf") is True
    assert box.hasProperty("skiros:SizeX", 0.5)  # no declared type: the text stays, and compares equal


def test_missing_class_is_derived_from_the_id(load):
    wm = load('default1:LargeBox-1 rdfs:label "tray" .')
    assert wm.get_element("skiros:LargeBox-1").type == "skiros:LargeBox"


def test_ids_need_no_number(load):
    wm = load("cora:my_robot a cora:Robot ; default1:at default1:Scene-0 .")
    assert wm.get_element("cora:my_robot").getIdNumber() == -1
    assert wm.add_element(wm.get_template_element("skiros:starter")).id == "skiros:Starter-1"


def test_a_scene_without_a_root_gets_one_at_the_start_and_is_refused_later(load, workspace):
    with pytest.raises(WmException, match="no skiros:Scene-0"):
        load("default1:LargeBox-5 a default1:LargeBox .", HEAD.rpartition("default1:Scene-0")[0])
    model = WorldModel(source_ontologies(), workspace, initial=[("scene", "scene.ttl")])
    assert {node.id for node in model.scene()} == {"skiros:Scene-0", "skiros:LargeBox-5"}


def test_relations_to_templates_are_kept(load):
    wm = load("default1:LargeBox-1 a default1:LargeBox ; default1:partReference default1:starter .")
    assert wm.get_relations("", "skiros:partReference", "skiros:starter")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("default1:LargeBox-1 a default1:LargeBox ; ", "scene.ttl, line [89]"),
        ("this is not Turtle", "scene.ttl, line 8"),
    ],
)
def test_refused_scene_keeps_the_current_one(load, wm, text, message):
    load('default1:LargeBox-1 a default1:LargeBox ; rdfs:label "present" .')
    number = wm.version
    with pytest.raises(WmException, match=message):
        load(text)
    assert wm.get_element("skiros:LargeBox-1").label == "present"
    assert wm.version == number


def test_saved_scene_loads_and_saves_unchanged(load, workspace):
    wm = load('default1:LargeBox-1 a default1:LargeBox ; rdfs:label "tray" ; default1:SizeX 0.5, 1 ; '
              "default1:contain default1:Starter-2 . default1:Starter-2 a default1:Starter .")  # fmt: skip
    wm.save("one.ttl")
    wm.load("one.ttl")
    wm.save("two.ttl")
    assert (workspace / "one.ttl").read_text() == (workspace / "two.ttl").read_text()


def test_with_strict_unknown_names_are_refused(workspace):
    wm = LocalWorldModel("tester", WorldModel(source_ontologies(), workspace, strict=True))
    (workspace / "scene.ttl").write_text(HEAD + "default1:Pump-4 a default1:Pump .")
    with pytest.raises(WmException, match="unknown class skiros:Pump"):
        wm.load("scene.ttl")


# -- ontologies of a workspace -------------------------------------------------------------------------------------

ONTOLOGY = """@prefix : <http://x.org/Factory.owl#> .
@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
<http://x.org/Factory.owl> a owl:Ontology .
:Pallet a owl:Class ; rdfs:subClassOf skiros:Container .
:euro_pallet a owl:NamedIndividual, :Pallet ; skiros:SizeX 1.2 .
"""


def test_workspace_files_whose_names_contain_owl_are_ontologies(workspace):
    (workspace / "below").mkdir()
    (workspace / "below" / "factory.owl.ttl").write_text(ONTOLOGY)
    (workspace / "scene.ttl").write_text("this is a scene, and broken; nobody reads it")
    (workspace / "catalog.xml").write_text("<catalog/>")
    wm = LocalWorldModel("tester", WorldModel(source_ontologies(), workspace))
    assert wm.is_subclass("factory:Pallet", "skiros:Location")
    assert wm.instanciate("factory:euro_pallet").value_of("skiros:SizeX") == 1.2


def test_two_files_may_bear_one_iri(workspace):
    (workspace / "one.owl").write_text(ONTOLOGY)
    (workspace / "two.owl").write_text(ONTOLOGY.replace("Pallet", "Crate").replace("pallet", "crate"))
    wm = LocalWorldModel("tester", WorldModel(source_ontologies(), workspace))
    assert {"factory:Crate", "factory:Pallet"} <= set(wm.get_sub_classes("skiros:Container"))


def test_an_ontology_that_does_not_parse_is_a_mistake_of_configuration_with_file_and_line(workspace):
    (workspace / "factory.owl").write_text(ONTOLOGY + "oops\n")
    with pytest.raises(ConfigurationError, match=r"factory\.owl, line 8"):
        WorldModel(source_ontologies(), workspace)


def test_a_workspace_that_is_not_there_is_a_mistake_of_configuration(tmp_path):
    with pytest.raises(ConfigurationError, match="none: there is no such folder"):
        WorldModel(source_ontologies(), tmp_path / "none")


def test_unknown_names_in_ontologies_are_warned_of(workspace, caplog):
    (workspace / "factory.owl").write_text(ONTOLOGY + ":steel_pallet a owl:NamedIndividual, :Pallet ; :load 9.5 .")
    with caplog.at_level(logging.WARNING):
        WorldModel(source_ontologies(), workspace)
    assert any("factory.owl has 1 mistake" in m and "factory:steel_pallet factory:load" in m for m in caplog.messages)


@pytest.mark.parametrize("filename", ["../out.ttl", "/etc/passwd", "a/../../out.ttl", "", "."])
def test_files_outside_the_workspace_are_refused(wm, filename):
    for act in (wm.load, wm.save):
        with pytest.raises(WmException, match=r"expected a file in the workspace|name of the file is missing"):
            act(filename)


@pytest.mark.parametrize("text", ["", HEAD + "oops"])
def test_an_initial_scene_that_is_missing_or_broken_is_a_mistake_of_configuration(model, workspace, text):
    if text:
        (workspace / "scene.ttl").write_text(text)
    with pytest.raises(ConfigurationError, match=r"scene .*scene\.ttl"):
        model.load_initial("scene.ttl")


RDF_XML = """<?xml version="1.0"?>
<!DOCTYPE rdf:RDF [ <!ENTITY skiros "http://rvmi.aau.dk/ontologies/skiros.owl#" > ]>
<rdf:RDF xmlns="http://x.org/Paintbot#" xml:base="http://x.org/Paintbot"
    xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#"
    xmlns:owl="http://www.w3.org/2002/07/owl#" xmlns:skiros="http://rvmi.aau.dk/ontologies/skiros.owl#">
  <owl:Ontology rdf:about="http://x.org/Paintbot"/>
  <owl:Class rdf:about="#Booth">
    <rdfs:subClassOf rdf:resource="&skiros;Location"/>
    <rdfs:subClassOf>
      <owl:Restriction>
        <owl:onProperty rdf:resource="&skiros;contain"/>
        <owl:someValuesFrom rdf:resource="&skiros;Product"/>
      </owl:Restriction>
    </rdfs:subClassOf>
  </owl:Class>
  <owl:NamedIndividual rdf:about="#red_booth">
    <rdf:type rdf:resource="#Booth"/>
    <skiros:PositionX rdf:datatype="http://www.w3.org/2001/XMLSchema#double">1.5</skiros:PositionX>
  </owl:NamedIndividual>
</rdf:RDF>
"""


def test_an_ontology_may_be_rdf_xml_as_editors_write_it(workspace):
    (workspace / "paintbot.owl").write_text(RDF_XML)
    wm = LocalWorldModel("tester", WorldModel(source_ontologies(), workspace))
    assert wm.get_super_class("paintbot:Booth") == "skiros:Location"
    booth = wm.instanciate("paintbot:red_booth")
    assert booth.value_of("skiros:PositionX") == 1.5
    assert wm.check_relation(booth, "skiros:contain", Element("skiros:Starter"), True, True)
    assert wm.check_relation(booth, "skiros:contain", Element("cora:Robot"), False, True)
