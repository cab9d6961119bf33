"""What the ontologies allow in goals: the choices for lines, and the refusal of values of another kind."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_task.core.actions import condition_predicates
from skiros2_task.core.goal_choices import GoalChoices
from skiros2_task.core.goal_completion import read_goal_vocabulary
from skiros2_task.core.goal_lines import HOLDS, OPERATORS, SOME, Line, Term
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.goal_text import GoalError
from skiros2_task.core.world import WorldView
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.vocabulary import Vocabulary, read_vocabulary
from skiros2_world_model.core.world_model import WorldModel
from support.planning_world import PlanningWorld

ONTOLOGY = """
@prefix : <http://example.org/shop.owl#> .
@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
<http://example.org/shop.owl> a owl:Ontology .
:Colour a owl:DatatypeProperty ; rdfs:domain skiros:Product ;
    rdfs:range [ a rdfs:Datatype ; owl:oneOf ( "red" "blue" "amber" ) ] .
:Layers a owl:DatatypeProperty ; rdfs:range xsd:int ;
    skiros:LowerBound "0.0"^^xsd:float ; skiros:UpperBound "9.0"^^xsd:float .
:keeps a owl:ObjectProperty ; rdfs:domain skiros:Location ; rdfs:range skiros:Product .
"""


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> PlanningWorld:
    workspace: Path = tmp_path_factory.mktemp("workspace")
    (workspace / "shop.owl.ttl").write_text(ONTOLOGY)
    world = PlanningWorld(LocalWorldModel("tester", WorldModel(source_ontologies(), workspace)))
    world.thing("skiros:Location", "shelf", Zone="north")
    world.thing("skiros:Product", "cup", Weight=0.2, Missing=False, Zone="south", Polished=True)
    world.thing("skiros:Product", "jug")
    return world


@pytest.fixture(scope="module")
def ontology(world: PlanningWorld) -> Vocabulary:
    return read_vocabulary(world.wm)


@pytest.fixture(scope="module")
def choices(world: PlanningWorld, ontology: Vocabulary) -> GoalChoices:
    view = WorldView(world.wm)
    return GoalChoices(view, read_goal_vocabulary(view), ontology)


CUP = Term("cup")


@pytest.mark.parametrize(
    ("predicate", "kind", "options", "known", "operators"),
    [
        ("skiros:Missing", bool, ("true", "false"), (), ("=",)),
        ("Missing", bool, ("true", "false"), (), ("=",)),
        ("skiros:Polished", bool, ("true", "false"), (), ("=",)),  # undeclared, but a boolean in the scene
        ("skiros:Weight", float, (), (), OPERATORS),
        ("shop:Layers", int, (), (), OPERATORS),
        ("shop:Colour", str, ("red", "blue", "amber"), (), ("=", HOLDS)),
        ("skiros:Zone", str, (), ("north", "south"), ("=", HOLDS)),
    ],
)
def test_value_is_entered_by_its_kind(
    choices: GoalChoices, predicate: str, kind: type, options: object, known: object, operators: object
) -> None:
    field = choices.field(Line(CUP, predicate, "="))
    assert (field.type, field.options, field.known, field.operators) == (kind, options, known, operators)


def test_numbers_have_their_limits_and_unit(choices: GoalChoices) -> None:
    assert choices.field(Line(CUP, "skiros:Weight", "=")).limits.text == "at least 0 kg"
    assert choices.field(Line(CUP, "shop:Layers", "=")).limits.text == "0 to 9"


def _texts(found: object) -> list[str]:
    return [choice.text for choice in found]  # type: ignore[attr-defined]


def test_only_elements_in_domain_and_range_are_offered(choices: GoalChoices) -> None:
    subjects, objects = _texts(choices.subjects("shop:keeps")), _texts(choices.objects("shop:keeps"))
    assert {"shelf", "some location"} <= set(subjects) and {"cup", "jug", "every product"} <= set(objects)
    assert not {"cup", "some product"} & set(subjects) and not {"shelf", "some location"} & set(objects)
    assert {"shelf", "cup"} <= set(_texts(choices.objects("skiros:contain")))
    assert _texts(choices.subjects("shop:Colour"))[0] in ("cup", "every product", "jug")
    assert "shelf" not in _texts(choices.subjects("shop:Colour"))


def test_predicates_that_fit_the_subject_come_first(choices: GoalChoices) -> None:
    names = [choice.term.name for choice in choices.predicates(Term("shelf"))]
    assert set(names) == {choice.term.name for choice in choices.predicates(Term())}
    assert names.index("shop:keeps") < names.index("shop:Colour")
    assert "shop:Colour" in [c.term.name for c in choices.predicates(Term("shelf")) if c.is_faint]


def test_other_predicate_drops_what_does_not_fit(choices: GoalChoices) -> None:
    line = Line(Term("shelf"), "skiros:contain", "", CUP)
    assert choices.with_predicate(line, "shop:keeps") == Line(Term("shelf"), "shop:keeps", "", CUP)
    assert choices.with_predicate(line, "shop:Colour") == Line(Term(), "shop:Colour", "=")
    assert choices.with_predicate(line, "skiros:Missing") == Line(Term("shelf"), "skiros:Missing", "=")
    number = Line(CUP, "skiros:Weight", ">", value=2.0)
    assert choices.with_predicate(number, "shop:Layers") == Line(CUP, "shop:Layers", ">", value=2.0)
    assert choices.with_predicate(number, "skiros:Missing") == Line(CUP, "skiros:Missing", "=")
    kept = Line(Term("skiros:Product", SOME), "shop:Colour", "=", value="red", is_negated=True)
    assert choices.with_predicate(kept, "skiros:contain") == Line(kept.subject, "skiros:contain", is_negated=True)


def test_boolean_without_value_is_shown_as_true(choices: GoalChoices) -> None:
    assert choices.normal(Line(CUP, "Missing", HOLDS)) == Line(CUP, "Missing", "=", value="true")
    assert choices.normal(Line(CUP, "Missing", "=", value="False")) == Line(CUP, "Missing", "=", value="false")
    assert choices.normal(Line(CUP, "Weight", HOLDS)) == Line(CUP, "Weight", HOLDS)


def _read(world: PlanningWorld, text: str, vocabulary: Vocabulary | None = None) -> None:
    view = WorldView(world.wm)
    GoalReader(view, condition_predicates(view.robots), vocabulary).read(text)


@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        ("(= (Missing cup) my_robot)", "Missing: expected = with true or false, got = my_robot"),
        ("(= (Missing cup) 1)", "Missing: expected = with true or false, got = 1"),
        ("(> (Missing cup) 0)", "Missing: expected = with true or false, got > 0"),
        ("(Missing_perhaps cup)", "Missing: expected = with true or false, got = perhaps"),
        ("(= (Polished cup) Empty)", "Polished: expected = with true or false, got = Empty"),
        ("(= (Weight cup) Empty)", "Weight: expected a number, got Empty"),
        ("(= (Layers cup) 2.5)", "Layers: expected a whole number, got 2.5"),
        ("(exists (?x - Product) (not (= (Missing ?x) Empty)))", "Missing: expected = with true"),
    ],
)
def test_goal_with_a_value_of_another_kind_is_refused(world: PlanningWorld, goal: str, reason: str) -> None:
    with pytest.raises(GoalError) as caught:
        _read(world, goal)
    assert caught.value.reason.startswith(reason)
    assert goal[caught.value.column - 1 :].startswith(caught.value.reason.partition(":")[0])


@pytest.mark.parametrize(
    "goal",
    [
        "(= (Missing cup) true)", "(= (Missing cup) False)", '(= (Missing cup) "1")',
        "(Missing cup)", "(Missing_False cup)", "(> (Weight cup) -3)", "(> (Layers cup) 2.5)", "(has_Weight cup)",
        "(= (Weight cup) 0.2)", '(= (Weight cup) "0.2")', "(= (Zone cup) east)", "(= (Zone cup) 12)",
        "(= (Colour cup) red)",
        "(= (Colour shelf) green)", "(keeps cup shelf)", "(= (Weight cup) -1)",  # accepted by the world model, too
    ],
)  # fmt: skip
def test_other_goals_are_read(world: PlanningWorld, goal: str) -> None:
    _read(world, goal)


@pytest.mark.parametrize(
    ("goal", "rest", "reason"),
    [
        ("(= (Weight cup) -1)", "Weight cup) -1)", "Weight: expected at least 0 kg, got -1"),
        ("(= (Weight cup) Empty)", "Weight cup) Empty)", "Weight: expected a number (kg), got Empty"),
        ("(= (Layers cup) 12)", "Layers cup) 12)", "Layers: expected 0 to 9, got 12"),
        ("(= (Colour cup) green)", "Colour cup) green)", "Colour: expected one of red, blue, amber, got 'green'"),
        ("(= (Colour shelf) red)", "shelf) red)", "shelf: the subject of shop:Colour is a skiros:Product, which"),
        ("(or (keeps cup cup) (Missing cup))", "cup cup) (Missing cup))", "cup: the subject of shop:keeps is a"),
        ("(exists (?x - Location) (keeps shelf ?x))", "?x))", "?x: the object of shop:keeps is a skiros:Product"),
    ],
)
def test_editors_refuse_what_the_ontologies_exclude(
    world: PlanningWorld, ontology: Vocabulary, goal: str, rest: str, reason: str
) -> None:
    with pytest.raises(GoalError) as caught:
        _read(world, goal, ontology)
    assert caught.value.reason.startswith(reason)
    assert goal[caught.value.column - 1 :] == rest


def test_editors_accept_what_the_ontologies_allow(world: PlanningWorld, ontology: Vocabulary) -> None:
    _read(world, "(= (Colour cup) amber), (forall (?x - Product) (exists (?y - Location) (keeps ?y ?x)))", ontology)


def test_enumerated_values_are_read_in_order(ontology: Vocabulary) -> None:
    assert ontology.limits("shop:Colour").choices == ("red", "blue", "amber")
    assert ontology.value_type("skiros:Product", "shop:Colour") is str
