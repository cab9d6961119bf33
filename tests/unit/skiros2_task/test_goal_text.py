"""The parser of goal texts."""

from __future__ import annotations

import pytest

from skiros2_task.core.goal_text import (
    GoalError,
    Name,
    ParsedAtom,
    ParsedComparison,
    ParsedEquality,
    ParsedJunction,
    ParsedNot,
    ParsedQuantifier,
    parse_goals,
)


def atom(text: str) -> str:
    """How a parsed goal reads, without places."""
    return shown(parse_goals(text)[0])


def shown(goal: object) -> str:
    if isinstance(goal, ParsedAtom):
        return f"({' '.join([goal.predicate.text, *(t.text for t in goal.terms)])})"
    if isinstance(goal, ParsedNot):
        return f"(not {shown(goal.part)})"
    if isinstance(goal, ParsedJunction):
        return f"({' '.join(['and' if goal.every else 'or', *map(shown, goal.parts)])})"
    if isinstance(goal, ParsedComparison):
        return f"({goal.operator} ({goal.property.text} {goal.subject.text}) {goal.value})"
    assert isinstance(goal, ParsedQuantifier)
    typed = " ".join(f"{v.text} - {c.text if c else 'anything'}" for v, c in goal.variables)
    return f"({'forall' if goal.every else 'exists'} ({typed}) {shown(goal.body)})"


@pytest.mark.parametrize(
    "text",
    [
        "(skiros:at cora:Robot-1 skiros:Location-2)",
        "(Painted skiros:Product-12)",
        "(not (skiros:contain a b))",
        "(and (p a) (or (q b c) (not (r d))))",
        "(forall (?x - skiros:Product) (skiros:contain skiros:LargeBox-80 ?x))",
        "(exists (?x - skiros:Product ?y - skiros:Location) (skiros:at ?x ?y))",
        "(>= (skiros:Weight a) 2.5)",
        "(and)",
    ],
)
def test_each_form_is_parsed(text: str) -> None:
    assert atom(text) == text


def test_commas_between_goals_are_optional() -> None:
    assert [shown(g) for g in parse_goals("(p a), (q b)(r c)\n(s d)")] == ["(p a)", "(q b)", "(r c)", "(s d)"]


def test_comments_and_line_breaks_are_ignored() -> None:
    text = "; where it belongs\n(skiros:contain ; the tray\n  a\n b) ; done"
    assert atom(text) == "(skiros:contain a b)"


def test_keywords_are_case_insensitive() -> None:
    assert atom("(NOT (Forall (?x - T) (AND (p ?x))))") == "(not (forall (?x - T) (and (p ?x))))"


def test_variables_share_type() -> None:
    assert atom("(forall (?a ?b - t ?c) (p ?a ?b))") == "(forall (?a - t ?b - t ?c - anything) (p ?a ?b))"


def test_type_may_follow_dash_without_space() -> None:
    assert atom("(forall (?x -t) (p ?x))") == "(forall (?x - t) (p ?x))"


def test_quoted_name_may_contain_signs() -> None:
    (goal,) = parse_goals('(state "Half full (nearly)" a)')
    assert isinstance(goal, ParsedAtom)
    assert goal.terms == (Name("Half full (nearly)", 1, 8), Name("a", 1, 29))


@pytest.mark.parametrize("word", ["and", "not", "(", ",", ">="])
def test_quoted_name_is_not_keyword(word: str) -> None:
    assert parse_goals(f'("{word}" a "{word}")') == (
        ParsedAtom(Name(word, 1, 2), (Name("a", 1, 5 + len(word)), Name(word, 1, 7 + len(word)))),
    )


def test_implication_becomes_disjunction() -> None:
    assert atom("(imply (p a) (q b))") == "(or (not (p a)) (q b))"


@pytest.mark.parametrize(
    ("text", "value"), [("2", 2.0), ("-1e3", -1000.0), ("Red", "Red"), ("nan", "nan"), ('"2"', "2")]
)
def test_property_equals_number_or_text(text: str, value: object) -> None:
    (goal,) = parse_goals(f"(= (p a) {text})")
    assert isinstance(goal, ParsedComparison)
    assert goal.value == value


def test_equality_of_two_names_is_parsed() -> None:
    assert parse_goals("(= ?x a)") == (ParsedEquality(Name("?x", 1, 4), Name("a", 1, 7)),)


def test_error_marker_is_aligned_after_tabs() -> None:
    with pytest.raises(GoalError) as caught:
        parse_goals("(p a)\r\n\t(q\t(r b))\r\n")
    assert str(caught.value).splitlines()[1:] == ["  \t(q\t(r b))", "  \t  \t^"]


def test_names_have_position() -> None:
    (goal,) = parse_goals("\n  (p\n     a)")
    assert isinstance(goal, ParsedAtom)
    assert (goal.predicate.line, goal.predicate.column) == (2, 4)
    assert (goal.terms[0].line, goal.terms[0].column) == (3, 6)


@pytest.mark.parametrize(
    ("text", "place", "expected"),
    [
        ("", "line 1, column 1", "the goal is empty"),
        ("  ; only a comment\n", "line 1", "the goal is empty"),
        ("skiros:at a b", "line 1, column 1", "expected a goal, which starts with (, found 'skiros:at'"),
        ("(p a", "line 1, column 5", "found the end"),
        ("(p a))", "line 1, column 6", "expected a goal, which starts with (, found ')'"),
        ("(p a),", "line 1, column 7", "expected a goal, which starts with (, found the end"),
        ("(p (q a))", "line 1, column 4", "expected a name, or ) at the end of (p ..., found '('"),
        ("(p a)\n(not)", "line 2, column 5", "expected a goal"),
        ("(not (p a) (q b))", "line 1, column 12", "expected ) at the end of (not"),
        ("()", "line 1, column 2", "expected a predicate, found ')'"),
        ("(forall (x - t) (p x))", "line 1, column 10", "expected a variable, such as ?x, found 'x'"),
        ("(forall () (p a))", "line 1, column 10", "expected a variable"),
        ("(forall (- t) (p a))", "line 1, column 10", "expected a variable before the -"),
        ("(exists (?x -) (p ?x))", "line 1, column 14", "expected a type after the -"),
        ("(> (w a) heavy)", "line 1, column 10", "expected a number, found 'heavy'"),
        ("(> (w a) nan)", "line 1, column 10", "expected a number, found 'nan'"),
        ("(forall (?x ?x - t) (p ?x))", "line 1, column 13", "'?x' is declared twice"),
        ("(imply (p a))", "line 1, column 13", "expected a goal"),
        ("(= a)", "line 1, column 5", "expected an element, found ')'"),
        ("(= )", "line 1, column 4", "expected (property element), or an element, after ="),
        ("(> 2 (w a))", "line 1, column 4", "expected (property element) after >"),
        ('(p "a', "line 1, column 4", "this quote is not closed"),
        ('(p "")', "line 1, column 4", "expected a name between the quotes"),
    ],
)
def test_error_has_position_and_expected_token(text: str, place: str, expected: str) -> None:
    with pytest.raises(GoalError) as caught:
        parse_goals(text)
    assert place in str(caught.value)
    assert expected in str(caught.value)


def test_error_shows_line_with_marker() -> None:
    with pytest.raises(GoalError) as caught:
        parse_goals("(p a),\n(q (r b))")
    assert str(caught.value).splitlines()[1:] == ["  (q (r b))", "     ^"]


def test_deep_nesting_raises_goal_error() -> None:
    with pytest.raises(GoalError, match="nested more than 100 deep"):
        parse_goals("(not " * 5000)
