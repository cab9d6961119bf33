"""The ontology files hold every name that scenes and skill libraries in the field use, and say the same about it.

`vocabulary.json` lists those names: classes with what is above them and what they ask of their individuals,
relations, properties and templates. The files may say more, never something else.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rdflib import OWL, RDF, RDFS, Graph, Literal, URIRef
from rdflib.term import Node

FOLDER = Path(__file__).parents[3] / "ontologies"
VOCABULARY: dict[str, dict[str, Any]] = json.loads(Path(__file__).with_name("vocabulary.json").read_text())
ONTOLOGIES = {
    "sumo": "http://www.inf.ufrgs.br/phi-group/ontologies/sumo.owl",
    "corax": "http://www.inf.ufrgs.br/phi-group/ontologies/coraX.owl",
    "cora": "http://www.inf.ufrgs.br/phi-group/ontologies/cora.owl",
    "rparts": "http://www.inf.ufrgs.br/phi-group/ontologies/RParts.owl",
    "skiros": "http://rvmi.aau.dk/ontologies/skiros.owl",
}
XML_SCHEMA = "http://www.w3.org/2001/XMLSchema"
IMPORTS = {"skiros": "rparts", "rparts": "cora", "cora": "corax", "corax": "sumo"}
OURS = {
    "skiros:Bore",
    "skiros:Clearance",
    "skiros:GripWidth",
    "skiros:InsertionAttempts",
    "skiros:SearchRadius",
    "skiros:Chamfer",
    "skiros:Depth",
    "skiros:Diameter",
    "skiros:LatchDepth",
    "skiros:LatchForce",
    "skiros:RetentionForce",
    "skiros:Friction",
    "skiros:JointNames",
    "skiros:Opening",
    "skiros:Postures",
    "skiros:LockedBy",
    "skiros:MissingParameter",
    "skiros:Unit",
    "skiros:LowerBound",
    "skiros:UpperBound",
    "skiros:hasValues",
    "skiros:hasCondition",
    "skiros:hasValue",
    "skiros:AvailableForPlanning",
    "skiros:Duration",
    "skiros:PythonModule",
    "skiros:SkillProperty",
    "skiros:RobotProperty",
    "skiros:Velocity",
    "skiros:Signal",
    "skiros:WristForce",
    "skiros:WristTorque",
    "skiros:JointTorque",
    "skiros:Distance",
    "skiros:SignalProperty",
    "skiros:SignalTopic",
    "skiros:MessageField",
    "skiros:WorkMaster",
    "skiros:WorkMasterDefinition",
    "skiros:ParameterSet",
    "skiros:Feature",
    "skiros:NeverRegion",
    "skiros:ParamDataType",
    "skiros:Prior",
    "skiros:Mean",
    "skiros:Std",
    "skiros:ParameterSetProperty",
    "skiros:SkillType",
    "skiros:AppliesTo",
    "skiros:Study",
    "skiros:Seed",
    "skiros:Date",
    "skiros:SuccessRate",
    "skiros:Validated",
    "skiros:Successes",
    "skiros:Executions",
    "skiros:LowestSuccessRate",
    "skiros:HighestSuccessRate",
    "skiros:Reward",
    "skiros:TaughtPose",
    "skiros:LiftingPose",
    "skiros:TaughtPath",
    "skiros:TeachingProperty",
    "skiros:PathSamples",
    "skiros:CameraAngleError",
    "skiros:CompliantInterface",
    "skiros:ApparentMass",
    "skiros:ContactStiffness",
    "skiros:MeanColour",
    "skiros:EstimateFitness",
    "skiros:EstimateViews",
    "skiros:PointCloudTopic",
    "skiros:UnknownObject",
    "skiros:DepthNoise",
    "skiros:EstimateProperty",
    "skiros:EstimateStamp",
    "skiros:MaxRange",
    "skiros:CameraPositionError",
    "skiros:Confidence",
    "skiros:EstimateResidual",
    "skiros:MinRange",
    "skiros:Missing",
    "skiros:PoseCovariance",
    "skiros:GripperEvents",
}
CONDITION_CLASSES = [
    "ConditionRelation",
    "ConditionProperty",
    "AbstractConditionRelation",
    "ConditionHasProperty",
    "ConditionIsSpecified",
    "ConditionGenerate",
    "ConditionOnType",
    "ConditionOr",
    "ConditionFunction",
    "ConditionSignal",
]


def iri(name: str) -> URIRef:
    prefix, local = name.split(":")
    return URIRef(f"{XML_SCHEMA if prefix == 'xsd' else ONTOLOGIES[prefix]}#{local}")


def name_of(node: Node) -> str:
    base, _, local = str(node).partition("#")
    return {iri_: prefix for prefix, iri_ in ONTOLOGIES.items()}.get(base, "xsd") + ":" + local


def names(nodes: Iterator[Node]) -> set[str]:
    return {name_of(node) for node in nodes if isinstance(node, URIRef)}


def restrictions(graph: Graph, cls: URIRef) -> list[dict[str, str]]:
    found = []
    for node in graph.objects(cls, RDFS.subClassOf):
        if (node, RDF.type, OWL.Restriction) not in graph:
            continue
        facts = {}
        for key, value in graph.predicate_objects(node):
            if key == OWL.onProperty:
                facts["property"] = name_of(value)
            elif key != RDF.type:
                facts[str(key).partition("#")[2]] = str(value) if isinstance(value, Literal) else name_of(value)
        found.append(facts)
    return found


def in_any_order(facts: list[dict[str, str]]) -> list[list[tuple[str, str]]]:
    return sorted(sorted(fact.items()) for fact in facts)


@pytest.fixture(scope="module")
def files() -> dict[str, Graph]:
    return {prefix: Graph().parse(FOLDER / f"{prefix}.ttl", format="turtle") for prefix in ONTOLOGIES}


@pytest.fixture(scope="module")
def graph(files: dict[str, Graph]) -> Graph:
    whole = Graph()
    for part in files.values():
        whole += part
    return whole


def test_each_file_is_one_ontology_with_the_iri_that_scenes_use(files: dict[str, Graph]) -> None:
    for prefix, part in files.items():
        assert set(part.subjects(RDF.type, OWL.Ontology)) == {URIRef(ONTOLOGIES[prefix])}


def test_each_ontology_imports_the_one_below_it(files: dict[str, Graph]) -> None:
    for prefix, part in files.items():
        expected = {URIRef(ONTOLOGIES[IMPORTS[prefix]])} if prefix in IMPORTS else set()
        assert set(part.objects(None, OWL.imports)) == expected


def test_a_file_says_nothing_about_an_ontology_that_it_does_not_import(files: dict[str, Graph]) -> None:
    order = list(ONTOLOGIES)
    for prefix, part in files.items():
        above = order[order.index(prefix) + 1 :]
        spoken_of = {name_of(node).split(":")[0] for triple in part for node in triple if isinstance(node, URIRef)}
        assert not spoken_of & set(above)


@pytest.mark.parametrize("name", VOCABULARY["classes"])
def test_class(graph: Graph, name: str) -> None:
    expected = VOCABULARY["classes"][name]
    assert (iri(name), RDF.type, OWL.Class) in graph
    assert names(graph.objects(iri(name), RDFS.subClassOf)) == set(expected["supers"])
    assert in_any_order(restrictions(graph, iri(name))) == in_any_order(expected["restrictions"])


@pytest.mark.parametrize(
    ("name", "kind"),
    [(name, OWL.ObjectProperty) for name in VOCABULARY["object_properties"]]
    + [(name, OWL.DatatypeProperty) for name in VOCABULARY["datatype_properties"]],
)
def test_property(graph: Graph, name: str, kind: URIRef) -> None:
    table = "object_properties" if kind == OWL.ObjectProperty else "datatype_properties"
    expected = VOCABULARY[table][name]
    assert (iri(name), RDF.type, kind) in graph
    assert names(graph.objects(iri(name), RDFS.subPropertyOf)) == set(expected["supers"])
    assert names(graph.objects(iri(name), RDFS.domain)) == ({expected["domain"]} if expected["domain"] else set())
    assert names(graph.objects(iri(name), RDFS.range)) == ({expected["range"]} if expected["range"] else set())


@pytest.mark.parametrize("name", VOCABULARY["templates"])
def test_template(graph: Graph, name: str) -> None:
    expected = VOCABULARY["templates"][name]
    facts = set(graph.predicate_objects(iri(name)))
    wanted: set[tuple[Node, Node]] = {(RDF.type, OWL.NamedIndividual), (RDF.type, iri(expected["type"]))}
    for key, text in expected["properties"].items():
        datatype = VOCABULARY["datatype_properties"][key]["range"]
        wanted.add((iri(key), Literal(text, datatype=iri(datatype) if datatype else None)))
    wanted |= {(iri(key), iri(target)) for key, target in expected["relations"]}
    assert facts == wanted


@pytest.mark.parametrize("name", CONDITION_CLASSES)
def test_every_kind_of_condition_is_a_class(graph: Graph, name: str) -> None:
    cls = iri(f"skiros:{name}")
    assert (cls, RDF.type, OWL.Class) in graph
    assert set(graph.objects(cls, RDFS.subClassOf)) == {iri("skiros:Condition")}


def test_a_parameter_points_at_its_value_and_an_or_condition_at_its_parts(graph: Graph) -> None:
    for name in ("skiros:hasValue", "skiros:hasCondition"):
        assert (iri(name), RDF.type, OWL.ObjectProperty) in graph
        assert (iri(name), RDFS.subPropertyOf, iri("skiros:skillProperty")) in graph


def test_whether_a_skill_is_planned_with_is_a_boolean_of_the_skill(graph: Graph) -> None:
    name = iri("skiros:AvailableForPlanning")
    assert (name, RDF.type, OWL.DatatypeProperty) in graph
    assert (name, RDFS.range, iri("xsd:boolean")) in graph
    assert (name, RDFS.subPropertyOf, iri("skiros:SkillProperty")) in graph


def test_nothing_is_used_that_no_file_declares(graph: Graph) -> None:
    declared = names(
        subject
        for kind in (OWL.Class, OWL.ObjectProperty, OWL.DatatypeProperty, OWL.NamedIndividual)
        for subject in graph.subjects(RDF.type, kind)
    )
    used = {
        name_of(node)
        for triple in graph
        for node in triple
        if isinstance(node, URIRef) and "#" in node and str(node).partition("#")[0] in ONTOLOGIES.values()
    }
    assert used <= declared


def test_nothing_is_declared_beside_the_vocabulary_but_what_is_listed_here(graph: Graph) -> None:
    known = {name for table in VOCABULARY.values() for name in table}
    known |= OURS | {f"skiros:{name}" for name in CONDITION_CLASSES}
    declared = names(
        subject
        for kind in (OWL.Class, OWL.ObjectProperty, OWL.DatatypeProperty, OWL.NamedIndividual)
        for subject in graph.subjects(RDF.type, kind)
    )
    assert declared == known


def test_every_term_of_skiros_but_a_template_has_a_comment(graph: Graph) -> None:
    templates = set(graph.subjects(RDF.type, OWL.NamedIndividual))
    bare = [
        name_of(subject)
        for subject in set(graph.subjects(RDF.type))
        if str(subject).startswith(ONTOLOGIES["skiros"] + "#")
        and subject not in templates
        and (subject, RDFS.comment, None) not in graph
    ]
    assert bare == []
