"""Names for people: of elements, goals, and the facts of plans."""

from __future__ import annotations

import pytest

from skiros2_common.core.wording import verb, words
from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import EventQueue
from skiros2_gui.app.names import Names
from skiros2_gui.goal.readable import change_lines, why_lines
from skiros2_task.core.explain_plan import Link, WhyPlan, WhyStep
from skiros2_task.core.goal_sentence import goal_sentence
from skiros2_task.core.preview import FactChange, Preview, PreviewStep
from support.window.local_system import LocalSystem

STEPS = {1: "pick of alpha"}
LABELS = {"skiros:Tray-2": "Tray B", "skiros:Product-1": "Product A"}


@pytest.fixture
def system() -> LocalSystem:
    return LocalSystem(EventQueue(lambda: None))


def add(system: LocalSystem, label: str) -> str:
    element = Element("skiros:Product", label)
    element.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    system.world.add_element(element)
    return element.id


def named(eid: str) -> str:
    return LABELS.get(eid, eid)


def test_element_is_named_by_its_label_without_prefix(system: LocalSystem) -> None:
    bolt = add(system, "demo:bolt")
    assert Names(system).of(bolt) == "bolt"


def test_invisible_characters_are_shown(system: LocalSystem) -> None:
    names = Names(system)
    bolt = add(system, "bolt\u202eyalo\u200b")
    shown = "bolt\\u202eyalo\\u200b"
    assert names.of(bolt) == shown
    assert names.in_text(f"{bolt} is at\n\u2066the shelf") == f"{shown} is at\n\\u2066the shelf"
    change = FactChange(bolt, "skiros:at", "\u202e7", True)
    assert change.line({bolt: "bolt\u202eyalo\u200b"}) == f'+ {bolt} "{shown}" skiros:at \\u202e7'


def test_elements_with_the_same_label_are_named_with_their_ids(system: LocalSystem) -> None:
    first, second = add(system, "bolt"), add(system, "bolt")
    names = Names(system)
    assert [names.of(first), names.of(second)] == [f"bolt ({eid.removeprefix('skiros:')})" for eid in (first, second)]


def test_parameter_of_a_skill_does_not_make_a_label_ambiguous(system: LocalSystem) -> None:
    bolt = add(system, "Object")
    system.world.add_element(Element("skiros:Parameter", "Object"))
    assert Names(system).of(bolt) == "Object"


def test_element_without_label_and_unknown_element_are_named_by_their_ids(system: LocalSystem) -> None:
    plain = add(system, "")
    names = Names(system)
    assert (names.of(plain), names.of("skiros:Gone-7")) == (plain.removeprefix("skiros:"), "Gone-7")


def test_ids_in_a_text_are_replaced_with_their_labels(system: LocalSystem) -> None:
    bolt = add(system, "bolt")
    text = f'{bolt} "bolt" is not at {bolt}, nor at map:7 or http://localhost:11311/x-1'
    assert Names(system).in_text(text) == "bolt is not at bolt, nor at map:7 or http://localhost:11311/x-1"


def test_texts_of_conditions_are_readable(system: LocalSystem) -> None:
    tray, bolt = add(system, "Tray B"), add(system, "demo:m5_bolt")
    text = f"{tray}-Tray B skiros:contain {bolt}-demo:m5_bolt, {bolt} skiros:State is 'Full', any skiros:LargeBox"
    expected = "Tray B contains m5_bolt, m5_bolt state is 'Full', any large box"
    assert Names(system).readable(text) == expected


@pytest.mark.parametrize(
    ("goal", "sentence"),
    [
        ("(skiros:contain skiros:Tray-2 skiros:Product-1)", "Tray B contains Product A"),
        ("(not (skiros:at skiros:Product-1 dock))", "Product A is not at dock"),
        ("(hasA a b), (a:inFrontOf a b)", "a has b, and a in front of b"),
        ("(> (skiros:Weight skiros:Product-1) 2)", "weight of Product A > 2"),
        ('(= (skiros:ContainerState gripper) "Full")', "container state of gripper is Full"),
        ("(skiros:Fed gripper)", "fed of gripper is set"),
        ("(forall (?x - skiros:Product) (skiros:contain skiros:Tray-2 ?x))", "Tray B contains every product"),
        ("(forall (?x - skiros:Product) (not (skiros:contain a ?x)))", "a does not contain any product"),
        ("(or (a b c) (d e f))", "(or (a b c) (d e f))"),
        ("(a b", "(a b"),
    ],
)
def test_goal_is_shown_as_a_sentence(goal: str, sentence: str) -> None:
    assert goal_sentence(goal, named) == sentence


def test_changes_of_a_plan_are_sentences_with_labels() -> None:
    step = PreviewStep(
        1,
        "skiros:Pick (pick)",
        "/alpha",
        unsatisfied=["the tray is there"],
        changes=[
            FactChange("skiros:Tray-2", "skiros:contain", "skiros:Product-1", False, is_relation=True),
            FactChange("rparts:Gripper-3", "skiros:contain", "skiros:Product-1", True, is_relation=True),
            FactChange("rparts:Gripper-3", "skiros:ContainerState", "Empty", False),
            FactChange("rparts:Gripper-3", "skiros:ContainerState", "Full", True),
            FactChange("skiros:Lid-9", "", "", True),
        ],
    )
    preview = Preview([step], True, {"skiros:Lid-9": "lid", **LABELS})
    assert list(change_lines(preview, STEPS, lambda eid: LABELS.get(eid, eid.partition(":")[2]))) == [
        "1. pick of alpha",
        "     ✕ does not hold: the tray is there",
        "     Tray B no longer contains Product A",
        "     Gripper-3 contains Product A",
        "     lid is created",
        "     container state of Gripper-3 is Full (was Empty)",
        "The goal holds at the end.",
    ]


def test_purposes_of_steps_are_sentences_with_labels() -> None:
    fact = "(skiros:contain skiros:Tray-2 skiros:Product-1)"
    why = WhyPlan([WhyStep(1, "call", [Link(fact, 0)], [Link(fact, 0)], [fact])], [fact])
    assert list(why_lines(why, STEPS, named)) == [
        "1. pick of alpha",
        "     so that Tray B contains Product A, for the goal",
        "     needs: Tray B contains Product A, from the start",
        "Tray B contains Product A: holds already",
    ]


def test_names_of_the_ontology_are_shown_as_words() -> None:
    assert (words("skiros:ContainerState"), words("LargeBox"), verb("skiros:hasA")) == (
        "container state",
        "large box",
        "has",
    )
