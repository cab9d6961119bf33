"""The building blocks of the scene, each compared with a simple implementation."""

import math

from hypothesis import given
from hypothesis import strategies as st

from skiros2_common.core.property import Property, same_value
from skiros2_world_model.core.indexes import IdIndex, PropertyPool, ValueIndex

STEPS = st.lists(st.tuples(st.booleans(), st.sampled_from("kl"), st.sampled_from("abc")))


@given(STEPS)
def test_id_index_holds_added_ids_until_they_are_discarded(steps):
    index, model = IdIndex(), set()
    for add, key, eid in steps:
        if add:
            index.add(key, eid)
            model.add((key, eid))
        else:
            index.discard(key, eid)
            model.discard((key, eid))
        assert {(k, e) for k in index for e in index.ids(k)} == model
        assert all(index.has(k, e) == ((k, e) in model) for k in "kl" for e in "abc")
        assert len(index) == len({k for k, _ in model})
        assert all(len(index.ids(k)) == sum(known == k for known, _ in model) for k in "kl")


def test_the_ids_of_a_key_come_in_the_order_in_which_they_were_added():
    index = IdIndex()
    for eid in ("c", "a", "b"):
        index.add("k", eid)
    assert list(index.ids("k")) == ["c", "a", "b"]


PLAIN = st.one_of(
    st.booleans(),
    st.integers(-3, 3),
    st.integers(),
    st.floats(),
    st.sampled_from([0.0, -0.0, 1.0, 2.0, 2**53, 2**53 + 1, float(2**53)]),
    st.sampled_from(["", "1", " 1.0", "true", "True", "False", "0", "-0", "1_0", "nan", "inf", "9007199254740993"]),
    st.integers().map(str),
    st.floats().map(repr),
    st.text(max_size=3),
)
VALUES = st.one_of(PLAIN, st.lists(PLAIN, max_size=2), st.dictionaries(st.text(max_size=1), PLAIN, max_size=1))


def found(index, value):
    groups = index.candidates(value)
    return None if groups is None else {eid for group in groups for eid in group}


@given(st.lists(st.lists(VALUES, max_size=3), max_size=6), VALUES)
def test_a_value_index_misses_no_element_that_has_the_value(elements, wanted):
    index = ValueIndex()
    for number, values in enumerate(elements):
        index.add(str(number), values)
    having = {str(number) for number, values in enumerate(elements) if any(same_value(v, wanted) for v in values)}
    among = found(index, wanted)
    assert (among is None) == isinstance(wanted, (list, dict))
    assert among is None or having <= among


@given(st.lists(VALUES, max_size=3), VALUES)
def test_an_element_that_has_its_values_no_more_is_not_found(values, wanted):
    index = ValueIndex()
    index.add("a", values)
    index.discard("a", values)
    assert not found(index, wanted)


def test_a_value_index_finds_few_others():
    index = ValueIndex()
    for number in range(100):
        index.add(f"number {number}", [number])
        index.add(f"text {number}", [f"word {number}"])
    index.add("yes", [True])
    assert found(index, 1) == found(index, "1.0") - {"yes"} == {"number 1"}
    assert found(index, "word 1") == {"text 1"}
    assert found(index, True) == {"yes"}


def same_property(one, other):
    return (one.key, one.dataType(), repr(one.values)) == (other.key, other.dataType(), repr(other.values))


@given(st.lists(VALUES, max_size=30))
def test_a_pool_gives_an_equal_property_for_each(values):
    pool = PropertyPool(size=5)
    for value in values:
        prop = Property("a:p", [value])
        assert same_property(pool.shared(prop), prop)


def test_pool_distinguishes_zero_from_minus_zero_and_no_value_from_an_empty_one():
    pool = PropertyPool()
    for value in (0.0, -0.0, 0, False, "", "''", "0", float, str):
        pool.shared(Property("a:p", value))
    assert math.copysign(1, pool.shared(Property("a:p", -0.0)).value) == -1
    assert math.copysign(1, pool.shared(Property("a:p", 0.0)).value) == 1
    assert pool.shared(Property("a:p", "")).values == [""]
    assert pool.shared(Property("a:p", "''")).values == ["''"]
    assert pool.shared(Property("a:p", str)).values == []
