"""Properties: typed lists of values."""

import logging

import numpy
import pytest

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.property import Property, same_value


def test_a_type_declares_a_property_without_a_value():
    prop = Property("MyDict", dict)
    assert prop.value is None
    assert prop.values == []
    assert not prop.isSpecified()
    assert prop.printState() == "MyDict:[]"


def test_the_first_value_fixes_the_type():
    prop = Property("MyFloat", 1.0)
    assert prop.dataType() is float
    assert prop.printState() == "MyFloat:[1.0]"


@pytest.mark.parametrize(
    ("start", "refused"),
    [(1, "one"), (1.0, "1.0"), ("a", 1), (True, 1), ([1, 2], "x"), ({}, [])],
)
def test_value_of_another_type_is_rejected_with_a_logged_error(start, refused, caplog):
    prop = Property("P", start)
    before = list(prop.values)
    with caplog.at_level(logging.ERROR):
        prop.value = refused
    assert prop.values == before
    assert "P" in caplog.text


def test_assign_raises_for_a_wrong_type():
    prop = Property("P", [1, 2])
    with pytest.raises(WrongType, match="P: expected a value of type int, got str 'x'"):
        prop.assign([3, "x"])
    assert prop.values == [1, 2]


@pytest.mark.parametrize(
    ("start", "given", "kept"),
    [(1.5, 2, 2.0), (1.5, numpy.float32(0.5), 0.5), (1, numpy.int64(3), 3), (True, numpy.bool_(False), False)],
)
def test_numpy_numbers_are_converted_to_python_numbers(start, given, kept):
    prop = Property("P", start)
    prop.value = given
    assert prop.value == kept
    assert type(prop.value) is type(start)


def test_values_are_set_by_index_added_and_removed():
    prop = Property("P", [1, 2])
    prop.setValue(5, 1)
    prop.addValue(7)
    assert prop.values == [1, 5, 7]
    prop.removeValue(5)
    assert prop.values == [1, 7]
    assert prop.find(7) == 1
    assert prop.find(5) == -1
    with pytest.raises(IndexError):
        prop.getValue(2)


def test_texts_are_parsed_as_the_property_type():
    prop = Property("P", bool)
    prop.setValuesFromStr("True;false")
    assert prop.values == [True, False]
    with pytest.raises(WrongValue):
        prop.setValueFromStr("maybe")
    assert prop.values == [True, False]


def test_a_clone_does_not_share_the_list():
    prop = Property("P", [1])
    clone = prop.clone()
    clone.addValue(2)
    assert prop.values == [1]


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [("True", True, True), ("false", False, True), ("2", 2, True), ("2.0", 2.0, True), (1, True, False),
     ("2", 3, False), ("x", 1, False), ("a", "a", True), (1, 1.0, True)],
)  # fmt: skip
def test_numbers_and_bools_equal_their_text(one, other, same):
    assert same_value(one, other) is same
    assert same_value(other, one) is same


def test_accessors_of_values_and_type_agree():
    prop = Property("skiros:P", [1.5, 2.5])
    assert (prop.getValue(), prop.getValue(1), prop.getValues()) == (1.5, 2.5, [1.5, 2.5])
    assert prop.getValuesStr() == "1.5;2.5"
    assert prop.isList() and not Property("skiros:P", 1.5).isList()
    assert prop.dataTypeIs(float) and prop.dataTypeIs(1.0) and not prop.dataTypeIs(int)
    assert prop.makeInstance() == 0.0
    with pytest.raises(IndexError, match="no value at index 2, there are 2"):
        prop.getValue(2)
    assert Property("skiros:P", float).getValue() is None


def test_set_values_sets_or_removes_all_values():
    prop = Property("skiros:P", [1, 2])
    prop.setValues([3, 4, 5])
    assert prop.values == [3, 4, 5]
    prop.setValues(6)
    assert prop.values == [6]
    prop.setValues(None)
    assert not prop.isSpecified()
