"""Checks of `rdfs:domain` and `rdfs:range`: the classes that the two ends of a relation may have."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model import WorldModel

#: `cora:robotPart` is declared from a `sumo:Device` to a `cora:Robot`, and is a subproperty of `sumo:part`.
RELATION = "cora:robotPart"
SCENE = """
@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix cora: <http://www.inf.ufrgs.br/phi-group/ontologies/cora.owl#> .
skiros:Scene-0 a skiros:Scene ; skiros:contain skiros:LargeBox-1, cora:Robot-2 .
cora:Robot-2 a cora:Robot .
skiros:LargeBox-1 a skiros:LargeBox ; cora:robotPart cora:Robot-2 .
"""


@pytest.fixture
def ontology() -> Ontology:
    return Ontology(
        [
            ("a:Dog", "rdfs:subClassOf", "a:Animal"),
            ("a:Bone", "rdf:type", "owl:Class"),
            ("a:eats", "rdfs:domain", "a:Animal"),
            ("a:eats", "rdfs:range", "a:Bone"),
            ("a:gnaws", "rdfs:subPropertyOf", "a:eats"),
        ]
    )


def test_subclasses_fit_a_domain(ontology: Ontology) -> None:
    assert ontology.domain_range_violations("a:Dog", "a:eats", "a:Bone") == []


def test_subproperty_inherits_domain_and_range(ontology: Ontology) -> None:
    assert ontology.domain_range_violations("a:Bone", "a:gnaws", "a:Dog") == [
        "the subject of a:eats is a a:Animal, which a:Bone is not",
        "the object of a:eats is a a:Bone, which a:Dog is not",
    ]


def test_reader_during_a_check_gets_all_of_its_result(ontology: Ontology, monkeypatch: pytest.MonkeyPatch) -> None:
    relation, found = ("a:Bone", "a:gnaws", "a:Dog"), []
    check = ontology.is_subclass

    def check_later(child: str, parent: str) -> bool:
        monkeypatch.undo()
        found.append(list(ontology.domain_range_violations(*relation)))  # as another thread does meanwhile
        return check(child, parent)

    monkeypatch.setattr(ontology, "is_subclass", check_later)
    assert ontology.domain_range_violations(*relation) == found[0]
    assert len(found[0]) == 2


def test_unknown_classes_break_no_rule(ontology: Ontology) -> None:
    assert ontology.domain_range_violations("a:Cat", "a:eats", "") == []


def _world_model(workspace: Path, strict: bool) -> tuple[LocalWorldModel, Element, Element]:
    wm = LocalWorldModel("tester", WorldModel(source_ontologies(), workspace, strict))
    box, robot = Element("skiros:LargeBox"), Element("cora:Robot")
    wm.add_elements([box, robot])
    return wm, box, robot


def test_lenient_world_model_warns_of_wrong_class(workspace: Path, caplog: pytest.LogCaptureFixture) -> None:
    wm, box, robot = _world_model(workspace, strict=False)
    with caplog.at_level(logging.WARNING):
        wm.set_relation(box.id, RELATION, robot.id)
    assert "the subject of cora:robotPart is a sumo:Device, which skiros:LargeBox is not" in caplog.text
    assert wm.get_relations(box.id, RELATION, robot.id)


def test_strict_world_model_refuses_wrong_class(workspace: Path) -> None:
    wm, box, robot = _world_model(workspace, strict=True)
    with pytest.raises(WmException, match="the subject of cora:robotPart is a sumo:Device"):
        wm.set_relation(box.id, RELATION, robot.id)
    assert not wm.get_relations(box.id, RELATION, robot.id)


def test_file_with_wrong_class_is_loaded_with_a_warning(workspace: Path, caplog: pytest.LogCaptureFixture) -> None:
    (workspace / "scene.ttl").write_text(SCENE)
    model = WorldModel(source_ontologies(), workspace)
    with caplog.at_level(logging.WARNING):
        model.load("scene.ttl", "tester", "scene")
    assert "skiros:LargeBox-1 cora:robotPart: the subject of cora:robotPart is a sumo:Device" in caplog.text
    assert "line 6" in caplog.text
