"""Rules of the demo's scene and ontology."""

from pathlib import Path

import pytest
from rdflib import OWL, RDF, RDFS, Graph, URIRef

FOLDER = Path(__file__).parents[3] / "skiros2_std_lib/demos/timed_skills/owl"
SKIROS = "http://rvmi.aau.dk/ontologies/skiros.owl#"
CORA = "http://www.inf.ufrgs.br/phi-group/ontologies/cora.owl#"
DEMO = "http://example.org/skiros2/demo.owl#"
ROOT = URIRef(SKIROS + "Scene-0")
CARRIES = (URIRef(SKIROS + "contain"), URIRef(SKIROS + "hasA"))


@pytest.fixture(scope="module")
def scene() -> Graph:
    return Graph().parse(FOLDER / "pick_place_scene.ttl")


@pytest.fixture(scope="module")
def ontology() -> Graph:
    return Graph().parse(FOLDER / "demo.owl.ttl")


def elements(scene: Graph) -> set[URIRef]:
    return set(scene.subjects(RDF.type, OWL.NamedIndividual))


def labelled(scene: Graph, label: str) -> URIRef:
    (found,) = (s for s, o in scene.subject_objects(RDFS.label) if str(o) == label)
    return found


def holders(scene: Graph, element: URIRef) -> list[URIRef]:
    return [s for predicate in CARRIES for s in scene.subjects(predicate, element)]


def test_element_ids_are_class_and_unique_number(scene: Graph) -> None:
    numbers = []
    for element in elements(scene):
        (cls,) = set(scene.objects(element, RDF.type)) - {OWL.NamedIndividual}
        name, _, number = str(element).rpartition("-")
        assert name == str(cls)
        numbers.append(int(number))
    assert len(set(numbers)) == len(numbers)


def test_each_element_has_one_parent(scene: Graph) -> None:
    assert holders(scene, ROOT) == []
    for element in elements(scene) - {ROOT}:
        above = holders(scene, element)
        assert len(above) == 1, element
        while above != [ROOT]:
            above = holders(scene, above[0])


def test_every_element_has_a_pose(scene: Graph) -> None:
    parts = [f"Position{a}" for a in "XYZ"] + [f"Orientation{a}" for a in "XYZW"]
    for element in elements(scene):
        assert all(len(list(scene.objects(element, URIRef(SKIROS + part)))) == 1 for part in parts), element


def test_a_tray_and_a_gripper_are_full_when_they_hold_something_else_empty(scene: Graph) -> None:
    state = URIRef(SKIROS + "ContainerState")
    told = dict(scene.subject_objects(state))
    assert {labelled(scene, name) for name in ("Tray A", "Tray B", "Tray C", "Tray D", "Gripper")} == set(told)
    for element, value in told.items():
        holds = list(scene.objects(element, CARRIES[0]))
        assert str(value) == ("Full" if holds else "Empty")


def test_there_are_two_workstations_with_their_trays_and_three_products(scene: Graph) -> None:
    for station in ("Workstation 1", "Workstation 2"):
        trays = list(scene.objects(labelled(scene, station), CARRIES[0]))
        assert [set(scene.objects(tray, RDF.type)) - {OWL.NamedIndividual} for tray in trays] == [
            {URIRef(DEMO + "Tray")}
        ] * 2
    assert [str(scene.value(holders(scene, labelled(scene, f"Product {p}"))[0], RDFS.label)) for p in "ABC"] == [
        "Tray A",
        "Tray D",
        "Tray C",
    ]


def test_the_robot_has_the_label_that_the_launch_file_names_and_a_place_to_start_from(scene: Graph) -> None:
    robot = labelled(scene, "demo:mobile_manipulator")
    assert (robot, RDF.type, URIRef(CORA + "Robot")) in scene
    start = scene.value(robot, URIRef(SKIROS + "hasStartLocation"))
    assert str(scene.value(start, RDFS.label)) == "Charging station"
    launch = (FOLDER.parent / "launch" / "demo.launch").read_text()
    assert 'name="robot_ontology_prefix" value="demo"' in launch
    assert 'name="robot_name" value="mobile_manipulator"' in launch


def test_scene_uses_declared_demo_names_only(scene: Graph, ontology: Graph) -> None:
    declared = set(ontology.subjects(RDF.type, OWL.Class))
    used = {node for triple in scene for node in triple if isinstance(node, URIRef) and str(node).startswith(DEMO)}
    assert {node for node in used if "-" not in str(node).partition("#")[2]} <= declared
