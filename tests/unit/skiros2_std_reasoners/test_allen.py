"""Allen's relations between intervals with a length; tests/compatibility/test_spatial.py has the whole table."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skiros2_std_reasoners.core.relations import interval_relation as relation
from skiros2_std_reasoners.core.relations import same

ENDS = st.integers(-4, 4)
INTERVALS = st.tuples(ENDS, ENDS).map(lambda ends: (float(min(ends)), float(max(ends)))).filter(lambda i: i[0] < i[1])

#: By their definition, without tolerance.
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


@given(INTERVALS, INTERVALS)
def test_exactly_the_defined_relation_holds(a, b):
    holding = {name for name, holds in DEFINED.items() if holds(a, b)}
    holding |= {INVERSE[name] for name, holds in DEFINED.items() if holds(b, a)}
    assert {relation(a, b)[0]} == holding


@given(INTERVALS, INTERVALS)
def test_inverse_relation_holds_for_swapped_intervals(a, b):
    both = {**INVERSE, **{inverse: name for name, inverse in INVERSE.items()}}
    assert both[relation(a, b)[0]] == relation(b, a)[0]


@pytest.mark.parametrize(
    ("one", "other", "equal"), [(0.0, 0.001, True), (0.0, 0.0011, False), (1e4, 1e4 + 0.009, True), (10.0, 10.1, False)]
)
def test_lengths_are_equal_within_the_tolerance(one, other, equal):
    assert same(one, other) is same(-other, -one) is equal
