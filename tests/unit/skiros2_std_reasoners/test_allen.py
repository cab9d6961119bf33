"""Allen's relations between intervals."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skiros2_std_reasoners.core.allen import RELATIONS, distances, relation

TOLERANCE = 0.001
ENDS = st.integers(-4, 4)
INTERVALS = st.tuples(ENDS, ENDS).map(lambda ends: (float(min(ends)), float(max(ends))))

#: By their definition, for intervals with a length and without tolerance.
DEFINED = {
    "p": lambda a, b: a[1] < b[0],
    "m": lambda a, b: a[1] == b[0],
    "o": lambda a, b: a[0] < b[0] < a[1] < b[1],
    "s": lambda a, b: a[0] == b[0] and a[1] < b[1],
    "d": lambda a, b: b[0] < a[0] and a[1] < b[1],
    "f": lambda a, b: a[1] == b[1] and b[0] < a[0],
    "eq": lambda a, b: a == b,
}
INVERSE = {"p": "pi", "m": "mi", "o": "oi", "s": "si", "d": "di", "f": "fi", "eq": "eq"}


@given(INTERVALS.filter(lambda i: i[0] < i[1]), INTERVALS.filter(lambda i: i[0] < i[1]))
def test_exactly_the_relation_holds_that_is_defined_so(a, b):
    holding = {name for name, holds in DEFINED.items() if holds(a, b)}
    holding |= {INVERSE[name] for name, holds in DEFINED.items() if holds(b, a)}
    assert {relation(a, b, TOLERANCE)} == holding


@given(INTERVALS, INTERVALS)
def test_the_other_way_round_it_is_the_inverse_also_for_points(a, b):
    there, back = relation(a, b, TOLERANCE), relation(b, a, TOLERANCE)
    both = {**INVERSE, **{inverse: name for name, inverse in INVERSE.items()}}
    assert there in RELATIONS
    assert both[there] == back


@pytest.mark.parametrize(
    ("point", "name"), [(0.0, "s"), (2.0, "f"), (1.0, "d"), (-1.0, "p"), (3.0, "pi")]
)  # fmt: skip
def test_a_point_starts_finishes_or_is_during_an_interval(point, name):
    assert relation((point, point), (0.0, 2.0), TOLERANCE) == name


@pytest.mark.parametrize(("gap", "name"), [(0.0009, "m"), (-0.0009, "m"), (0.0011, "p"), (-0.0011, "o")])
def test_ends_closer_than_the_tolerance_are_equal(gap, name):
    assert relation((0.0, 1.0), (1.0 + gap, 3.0), TOLERANCE) == name


def test_the_distance_is_the_gap_or_from_start_to_start_and_end_to_end():
    assert distances("p", (0.0, 1.0), (3.0, 4.0)) == 2.0
    assert distances("pi", (3.0, 4.0), (0.0, 1.0)) == 2.0
    assert distances("o", (0.0, 2.0), (1.0, 4.0)) == (1.0, 2.0)
