"""Mistakes in ontologies are named with the file, the element and the nearest name when they are loaded."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.ontology_lint import unused_prefixes
from skiros2_world_model.core.report import Finding
from skiros2_world_model.core.validation import validate_file

PREFIXES = """
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix my: <http://example.org/my.owl#> .
<http://example.org/my.owl> a owl:Ontology .
my:Cup a owl:Class ; rdfs:subClassOf skiros:Product .
my:holds a owl:ObjectProperty ; rdfs:subPropertyOf skiros:sceneProperty ; rdfs:domain skiros:Location .
my:Volume a owl:DatatypeProperty ; rdfs:subPropertyOf skiros:sceneProperty ; rdfs:range xsd:float ; rdfs:domain my:Cup .
"""


def findings_of(text: str, folder: Path) -> list[Finding]:
    path = folder / "my.owl.ttl"
    path.write_text(PREFIXES + text)
    return KnowledgeBase(source_ontologies(), folder).lint(path)


MISTAKES = {
    "superclass": ("my:Mug a owl:Class ; rdfs:subClassOf skiros:Produkt .",
                   "my:Mug skiros:Produkt: unknown class, after rdfs:subClassOf; did you mean skiros:Product?"),
    "prefix of a class": ("my:Mug a owl:Class ; rdfs:subClassOf my:Product .",
                          "my:Mug my:Product: unknown class, after rdfs:subClassOf; did you mean skiros:Product?"),
    "filler": ("my:Mug a owl:Class ; rdfs:subClassOf [a owl:Restriction ; owl:onProperty my:holds ; "
               "owl:someValuesFrom my:Cupp] .",
               "my:Cupp: unknown class, after owl:someValuesFrom; did you mean my:Cup?"),
    "restricted property": ("my:Mug a owl:Class ; rdfs:subClassOf [a owl:Restriction ; owl:onProperty my:hold ; "
                            "owl:someValuesFrom my:Cup] .",
                            "my:hold: unknown property, after owl:onProperty; did you mean my:holds?"),
    "superproperty": ("my:has a owl:ObjectProperty ; rdfs:subPropertyOf skiros:containn .",
                      "my:has skiros:containn: unknown property, after rdfs:subPropertyOf; did you mean "
                      "skiros:contain?"),
    "range": ("my:has a owl:ObjectProperty ; rdfs:range skiros:Locaton .",
              "my:has skiros:Locaton: unknown class, after rdfs:range; did you mean skiros:Location?"),
    "datatype": ("my:Mass a owl:DatatypeProperty ; rdfs:range xsd:flaot .",
                 "my:Mass xsd:flaot: unknown class, after rdfs:range; did you mean xsd:float?"),
    "term of RDFS": ("my:Mug a owl:Class ; rdfs:subClasOf skiros:Product .",
                     "my:Mug rdfs:subClasOf: unknown property; did you mean rdfs:subClassOf?"),
    "term of OWL": ("my:has a owl:ObjectPropety .",
                    "my:has owl:ObjectPropety: unknown class, after rdf:type; did you mean owl:ObjectProperty?"),
    "class as text": ('my:Mug a owl:Class ; rdfs:subClassOf "skiros:Product" .',
                      "my:Mug rdfs:subClassOf: expected a class, got a literal"),
    "class of an individual": ("my:cup a owl:NamedIndividual, my:Cupp .",
                               "my:cup my:Cupp: unknown class, after rdf:type; did you mean my:Cup?"),
    "property of an individual": ("my:cup a my:Cup ; my:Volum 1.0 .",
                                  "my:cup my:Volum: unknown property; did you mean my:Volume?"),
    "relation of an individual": ("my:shelf a skiros:Location ; my:hold my:cup .",
                                  "my:shelf my:hold: unknown relation; did you mean my:holds?"),
    "value of another type": ('my:cup a my:Cup ; my:Volume "much" .',
                              "my:cup my:Volume: expected xsd:float, got str 'much'"),
    "text that is not a number": ('my:cup a my:Cup ; my:Volume "much"^^xsd:float .',
                               "my:cup my:Volume: wrong xsd:float: 'much' is not a valid float"),
    "element as a value": ("my:cup a my:Cup ; my:Volume skiros:Product .",
                           "my:cup my:Volume: expected a literal, got skiros:Product"),
    "value as an element": ('my:shelf a skiros:Location ; my:holds "cup" .',
                            "my:shelf my:holds: expected an element, got a literal"),
    "domain of a relation": ("my:cup a my:Cup . my:mug a my:Cup ; my:holds my:cup .",
                             "my:mug my:holds: the subject of my:holds is a skiros:Location, which my:Cup is not"),
    "domain of a property": ("my:shelf a skiros:Location ; my:Volume 1.0 .",
                             "my:shelf my:Volume: the subject of my:Volume is a my:Cup, which skiros:Location is not"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_mistake_in_an_ontology_is_named(name: str, tmp_path: Path) -> None:
    text, expected = MISTAKES[name]
    found = findings_of(text, tmp_path)
    assert expected in [str(finding).removeprefix("warning: ") for finding in found]
    assert all(finding.code for finding in found)


def test_ontology_without_mistakes_has_no_findings(tmp_path: Path) -> None:
    text = """
        my:Mug a owl:Class ; rdfs:subClassOf my:Cup, [a owl:Restriction ; owl:onProperty my:Volume ;
            owl:onDataRange xsd:float ; owl:maxQualifiedCardinality 1] ; rdfs:label "mug"@en ;
            <http://purl.org/dc/elements/1.1/creator> "somebody" .
        my:Shelf owl:equivalentClass [a owl:Class ; owl:unionOf (skiros:Location my:Cup)] .
        my:mug a my:Mug ; my:Volume 1.5 ; rdfs:comment "a mug" .
        my:shelf a skiros:Location ; my:holds my:mug .
    """
    assert findings_of(text, tmp_path) == []


def test_own_ontologies_have_no_mistakes() -> None:
    knowledge_base = KnowledgeBase(source_ontologies())
    files = sorted(source_ontologies().glob("*.ttl"))
    assert files
    assert [str(finding) for file in files for finding in knowledge_base.lint(file)] == []


def test_unused_prefix_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.ttl"
    path.write_text('@prefix a: <urn:x#> .\n@prefix b: <urn:b:y#> .\nPREFIX c: <urn:c#>\n# b:x\na:x a:y "b:x" .\n')
    assert [str(finding) for finding in unused_prefixes(path)] == [
        "warning: b:: the prefix is not used",
        "warning: c:: the prefix is not used",
    ]


def test_world_model_warns_of_mistakes_at_its_start(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "my.owl.ttl"
    path.write_text(PREFIXES + "my:Mug a owl:Class ; rdfs:subClassOf skiros:Produkt .\n")
    with caplog.at_level(logging.WARNING):
        knowledge_base = KnowledgeBase(source_ontologies(), tmp_path)
    assert knowledge_base.index.has_class("my:Mug")
    assert [record.getMessage() for record in caplog.records] == [
        f"ontology {path} has 1 mistake:\n"
        "    warning: my:Mug skiros:Produkt: unknown class, after rdfs:subClassOf; did you mean skiros:Product?"
    ]


def test_scene_names_the_nearest_class_and_property(tmp_path: Path) -> None:
    (tmp_path / "my.owl.ttl").write_text(PREFIXES)
    scene = tmp_path / "scene.ttl"
    scene.write_text(
        PREFIXES.partition("<http://example.org/my.owl> a")[0]
        + "skiros:Cup-1 a skiros:Produkt ; my:Volum 1.0 . skiros:Shelf-2 a skiros:Location ; my:Volume 2.0 ; "
        "my:hold skiros:Cup-1 ."
    )
    found = validate_file(scene, KnowledgeBase(source_ontologies(), tmp_path)).findings
    assert {(finding.code, finding.element, finding.text) for finding in found if finding.code} == {
        ("unknown-class", "skiros:Cup-1", "unknown class skiros:Produkt; did you mean skiros:Product?"),
        ("unknown-property", "skiros:Cup-1", "unknown property my:Volum; did you mean my:Volume?"),
        ("unknown-relation", "skiros:Shelf-2", "unknown relation my:hold; did you mean my:holds?"),
        ("domain-range", "skiros:Shelf-2", "the subject of my:Volume is a my:Cup, which skiros:Location is not"),
    }
