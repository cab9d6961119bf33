"""World models of executions: each as if it was the first one of its process."""

from __future__ import annotations

from pathlib import Path

from skiros2_common.core.world_element import Element
from skiros2_learning.local.knowledge import fresh_world_model

SCENE = Path(__file__).parents[3] / "skiros2_std_lib/demos/learning/scene/push_scene.ttl"
BOXES = "SELECT ?x WHERE { ?x a skiros:Product . ?x rdfs:label ?y }"


def test_the_ontologies_are_read_once() -> None:
    with fresh_world_model(SCENE) as first:
        knowledge = first.model.knowledge_base
    with fresh_world_model(SCENE) as second:
        assert second.model.knowledge_base is knowledge


def test_two_world_models_at_a_time_share_nothing() -> None:
    with fresh_world_model(SCENE) as one, fresh_world_model(SCENE) as other:
        assert one.model.knowledge_base is not other.model.knowledge_base


def test_changes_of_the_scene_end_with_the_execution() -> None:
    with fresh_world_model(SCENE) as first:
        before = set(map(str, first.model.triples()))
        first.add_element(Element("skiros:Product", "another"))
        first.remove_element("skiros:Product-6")
    with fresh_world_model(SCENE) as second:
        assert set(map(str, second.model.triples())) == before


def test_a_queried_scene_is_not_found_by_queries_of_the_next_execution() -> None:
    with fresh_world_model(SCENE) as first:
        first.add_element(Element("skiros:Product", "another"))
        assert len(first.query_ontology(BOXES)) == 2
    with fresh_world_model(SCENE) as second:
        assert second.query_ontology(BOXES) == ["skiros:Product-6"]


def test_changes_of_the_ontology_end_with_the_execution() -> None:
    with fresh_world_model(SCENE) as first:
        first.add_class("skiros:Crate", "skiros:Product")
        assert first.is_subclass("skiros:Crate", "skiros:Product")
    with fresh_world_model(SCENE) as second:
        assert not second.model.ontology.knows("skiros:Crate")
