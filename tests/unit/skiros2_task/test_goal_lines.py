"""Goals as lines."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skiros2_task.core.goal_lines import EVERY, HOLDS, OPERATORS, SOME, Line, Term, read_lines, write_lines
from skiros2_task.core.goal_text import GoalError, parse_goals

_BOX, _NUT, _PRODUCT = Term("box"), Term("nut"), "skiros:Product"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("(contain box nut)", Line(_BOX, "contain", "", _NUT)),
        ("(not (contain box nut))", Line(_BOX, "contain", "", _NUT, is_negated=True)),
        ('(contain "bench 1" nut)', Line(Term("bench 1"), "contain", "", _NUT)),
        ("(Open box)", Line(_BOX, "Open", HOLDS)),
        ("(= (State box) Painted)", Line(_BOX, "State", "=", value="Painted")),
        ('(= (State box) "two words")', Line(_BOX, "State", "=", value="two words")),
        ('(= (State box) "12")', Line(_BOX, "State", "=", value="12")),
        ("(>= (Weight box) 2.5)", Line(_BOX, "Weight", ">=", value=2.5)),
        (
            "(forall (?x - skiros:Product) (contain box ?x))",
            Line(_BOX, "contain", "", Term(_PRODUCT, EVERY)),
        ),
        (
            "(forall (?x - skiros:Product) (exists (?y - skiros:Box) (not (contain ?y ?x))))",
            None,  # the order of the quantifiers differs from that of subject and object
        ),
        (
            "(exists (?x - skiros:Box) (forall (?y - skiros:Product) (not (contain ?x ?y))))",
            Line(Term("skiros:Box", SOME), "contain", "", Term(_PRODUCT, EVERY), is_negated=True),
        ),
        ("(or (Open box) (Open nut))", None),
        ("(imply (Open box) (Open nut))", None),
        ("(not (exists (?x - skiros:Box) (Open ?x)))", None),
        ("(= box nut)", None),
    ],
)
def test_line_expresses_a_condition_or_keeps_its_text(text: str, line: Line | None) -> None:
    (found,) = read_lines(text)
    if line is None:
        assert parse_goals(found.text)[0] is not None and not found.predicate
    else:
        assert found == line
    assert read_lines(write_lines([found])) == (found,)


def test_conjunction_is_split_into_lines() -> None:
    lines = read_lines("(and (Open box) (and (Open nut))), (not (Open lid))")
    assert write_lines(lines) == "(Open box), (Open nut), (not (Open lid))"


def test_incomplete_lines_are_not_part_of_the_goal() -> None:
    incomplete = [Line(), Line(_BOX), Line(_BOX, "contain"), Line(_BOX, "Weight", ">")]
    assert write_lines([*incomplete, Line(_BOX, "Open", HOLDS)]) == "(Open box)"


def test_unreadable_text_has_no_lines() -> None:
    with pytest.raises(GoalError):
        read_lines("(contain box")


_names = st.sampled_from(["box", "skiros:Nut-1", "bench 1", "a,b"])
_terms = st.builds(Term, _names, st.sampled_from(["", EVERY, SOME]))
_values = st.one_of(st.floats(-1e6, 1e6), st.sampled_from(["Full", "two words", "7", "-1e3"]))


@given(st.lists(st.tuples(_terms, st.sampled_from(["", *OPERATORS]), _terms, _values, st.booleans()), min_size=1))
def test_written_lines_are_read_again(parts: list[tuple[Term, str, Term, float | str, bool]]) -> None:
    lines = []
    for subject, operator, other, value, is_negated in parts:
        number = value if operator in ("", "=", HOLDS) or isinstance(value, float) else 1.0
        compared = number if operator not in ("", HOLDS) else ""
        other = other if not operator else Term()
        lines.append(Line(subject, "skiros:p", operator, other, compared, is_negated))
    assert read_lines(write_lines(lines)) == tuple(lines)
