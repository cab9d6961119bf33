"""Prefixes of ontologies, and names of IRIs."""

import pytest

from skiros2_world_model.core.prefixes import Prefixes, prefix_of

SKIROS = "http://rvmi.aau.dk/ontologies/skiros.owl"


@pytest.mark.parametrize(
    ("iri", "prefix"),
    [
        ("http://x.org/xyz.owl", "xyz"),
        ("http://x.org/paintbot", "paintbot"),
        ("http://x.org/a/coraX.owl", "corax"),
        ("http://x.org/RParts.owl#", "rparts"),
        ("http://x.org/lab/", "lab"),
        ("urn:lab", "urn:lab"),
    ],
)
def test_the_prefix_is_the_last_segment_in_lower_case_without_extension(iri, prefix):
    assert prefix_of(iri) == prefix


def test_a_name_and_its_iri_lead_to_each_other():
    prefixes = Prefixes()
    prefixes.add_ontology(SKIROS)
    assert prefixes.name(f"{SKIROS}#LargeBox-80") == "skiros:LargeBox-80"
    assert prefixes.iri("skiros:LargeBox-80") == f"{SKIROS}#LargeBox-80"


def test_names_without_prefix_are_in_the_default_one():
    prefixes = Prefixes()
    prefixes.add_ontology(SKIROS)
    assert prefixes.iri(":contain") == prefixes.iri("contain") == f"{SKIROS}#contain"
    assert prefixes.namespaces()[""] == f"{SKIROS}#"


def test_a_namespace_that_no_ontology_declares_gets_its_prefix_when_it_is_first_seen():
    prefixes = Prefixes()
    assert prefixes.name("http://x.org/lab.owl#Bench") == "lab:Bench"
    assert prefixes.iri("lab:Bench") == "http://x.org/lab.owl#Bench"


def test_the_first_namespace_of_a_prefix_keeps_it_and_names_of_the_other_stay_iris():
    prefixes = Prefixes()
    prefixes.add_ontology("http://one.org/lab.owl")
    other = "http://two.org/lab.owl#Bench"
    assert prefixes.name(other) == other
    assert prefixes.iri(other) == other
    assert prefixes.iri("lab:Bench") == "http://one.org/lab.owl#Bench"


def test_a_prefix_that_nobody_knows_gets_a_namespace_that_leads_back_to_it():
    prefixes = Prefixes()
    iri = prefixes.iri("factory:Bench")
    assert Prefixes().name(iri) == "factory:Bench"


@pytest.mark.parametrize("iri", ["http://purl.org/dc/terms/title", "urn:a:b", "http://x.org/lab.owl#"])
def test_an_iri_without_a_local_name_after_a_hash_is_its_own_name(iri):
    assert Prefixes().name(iri) == iri


def test_the_vocabularies_of_rdf_and_owl_are_known_from_the_start():
    assert Prefixes().name("http://www.w3.org/1999/02/22-rdf-syntax-ns#type") == "rdf:type"
    assert Prefixes().iri("owl:Class") == "http://www.w3.org/2002/07/owl#Class"
