"""An ontology with something of each kind that requests are checked against, and what it says as plain tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

LAB = """@prefix : <http://x.org/lab.owl#> .
@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
<http://x.org/lab.owl> a owl:Ontology .
:Crate a owl:Class ; rdfs:subClassOf skiros:Container , [ a owl:Restriction ; owl:onProperty :note ;
    owl:onDataRange xsd:string ; owl:maxQualifiedCardinality "1"^^xsd:nonNegativeInteger ] .
:holds a owl:ObjectProperty ; rdfs:subPropertyOf skiros:contain .
:size a owl:DatatypeProperty ; rdfs:range xsd:double .
:count a owl:DatatypeProperty ; rdfs:range xsd:int .
:open a owl:DatatypeProperty ; rdfs:range xsd:boolean .
:note a owl:DatatypeProperty ; rdfs:range xsd:string .
:kit a owl:NamedIndividual, :Crate ; :size 1.5 ; :holds :bolt ; skiros:hasA :lid ; skiros:at :shelf .
:bolt a owl:NamedIndividual, skiros:Part ; :count 4 ; skiros:contain :kit .
:lid a owl:NamedIndividual, skiros:Part ; :note "shut" .
:shelf a owl:NamedIndividual, skiros:Location .
"""
NAMESPACES = {
    "skiros": "http://rvmi.aau.dk/ontologies/skiros.owl#",
    "sumo": "http://www.inf.ufrgs.br/phi-group/ontologies/sumo.owl#",
    "lab": "http://x.org/lab.owl#",
}
DATATYPES = {
    "lab:size": float,
    "lab:count": int,
    "lab:open": bool,
    "lab:note": str,
    "skiros:Template": str,
    "skiros:DiscreteReasoner": str,
}
MOST_VALUES = {("lab:Crate", "lab:note"): 1}


@dataclass
class Template:
    type: str
    values: dict[str, list[Any]]
    relations: list[tuple[str, str]]


TEMPLATES = {
    "lab:kit": Template(
        "lab:Crate",
        {"lab:size": [1.5]},
        [("lab:holds", "lab:bolt"), ("skiros:hasA", "lab:lid"), ("skiros:at", "lab:shelf")],
    ),
    "lab:bolt": Template("skiros:Part", {"lab:count": [4]}, [("skiros:contain", "lab:kit")]),
    "lab:lid": Template("skiros:Part", {"lab:note": ["shut"]}, []),
    "lab:shelf": Template("skiros:Location", {}, []),
}
