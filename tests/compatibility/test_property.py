"""`Property`, as callers of SkiROS2 use it. Compatibility, section 5."""

import logging

import pytest

from compatibility.rules import rule
from skiros2_common.core.property import Property


@rule("property", "A list of values of several types at creation: `ValueError`")
def test_a_mixed_list_at_creation_is_a_value_error():
    with pytest.raises(ValueError, match="P"):
        Property("P", [1, "x"])


@rule("property", "A value is accepted by `isinstance(value, type)`; an int is taken for a float")
def test_values_are_tested_by_isinstance():
    whole = Property("P", 1)
    whole.value = True
    assert whole.values == [1]
    real = Property("P", 0.5)
    real.value = 2
    assert real.values == [2.0]


@rule("property", "`setValue` of a wrong type, or of None, logs and changes nothing")
def test_set_value_of_a_wrong_type_or_none_logs_and_changes_nothing(caplog):
    prop = Property("P", [1, 2])
    with caplog.at_level(logging.ERROR):
        prop.setValue("x")
        prop.setValue(None)
    assert prop.values == [1, 2]
    assert len(caplog.records) == 2


@rule(
    "property", "`setValue(v, i)` replaces in the list, counts a negative `i` from the end, and appends beyond the end"
)
def test_set_value_replaces_by_index_or_appends():
    prop = Property("P", [1, 2])
    values = prop.values
    prop.setValue(20, -1)
    prop.setValue(30, 9)
    assert values == [1, 20, 30]
    assert prop.values is values


@rule("property", "`setValues` takes a list of the right type itself, one value as a list, and None to unset")
def test_set_values_takes_the_very_list_one_value_or_none():
    prop = Property("P", int)
    given = [1, 2]
    prop.setValues(given)
    assert prop.values is given
    prop.setValues(3)
    assert prop.values == [3]
    prop.setValues(None)
    assert prop.values == []


@rule("property", "`setValues` of a mixed list or of a tuple logs and changes nothing")
@pytest.mark.parametrize("refused", [[3, "x"], (3, 4)])
def test_set_values_of_anything_else_logs_and_changes_nothing(refused, caplog):
    prop = Property("P", [1, 2])
    with caplog.at_level(logging.ERROR):
        prop.setValues(refused)
    assert prop.values == [1, 2]
    assert "P" in caplog.text


@rule("property", "`removeValue` removes the first such value; a missing one is ignored")
def test_remove_value_removes_the_first_and_ignores_a_missing_one():
    prop = Property("P", [1, 2, 1])
    values = prop.values
    prop.removeValue(1)
    prop.removeValue(7)
    assert values == [2, 1]


@rule("property", "`addValue` appends in place; a wrong type logs")
def test_add_value_appends_in_place(caplog):
    prop = Property("P", [1])
    values = prop.values
    prop.addValue(2)
    with caplog.at_level(logging.ERROR):
        prop.addValue("x")
    assert values == [1, 2]
    assert "P" in caplog.text


@rule("property", "`getValue(i)`: None without values, else `values[i]` with negative `i` allowed, or `IndexError`")
def test_get_value_by_index():
    assert Property("P", int).getValue(3) is None
    prop = Property("P", [1, 2])
    assert (prop.getValue(), prop.getValue(-1)) == (1, 2)
    with pytest.raises(IndexError):
        prop.getValue(2)


@rule("property", "`values` and `getValues()` are the live list")
def test_values_are_the_live_list():
    prop = Property("P", [1])
    prop.values.append(2)
    prop.getValues().append(3)
    assert prop.values == [1, 2, 3]


@rule("property", "`find(v)` is the index or -1")
def test_find_is_the_index_or_minus_one():
    assert (Property("P", ["a", "b"]).find("b"), Property("P", ["a"]).find("x")) == (1, -1)


@rule("property", "`setValueFromStr` reads a dict from a Python literal; a bad text raises `ValueError`")
def test_set_value_from_str():
    prop = Property("P", {"a": 1})
    prop.setValueFromStr("{'b': 2}")
    assert prop.value == {"b": 2}
    for datatype, text in ((dict, "{'b'"), (int, "x"), (float, "")):
        with pytest.raises(ValueError, match="is no"):
            Property("P", datatype).setValueFromStr(text)


@rule("property", "`setValueFromStr` of a bool property", better='"False" is False; `bool("False")` would be True')
def test_a_bool_is_read_from_its_text():
    prop = Property("P", True)
    prop.setValueFromStr("False")
    assert prop.values == [False]
    with pytest.raises(ValueError, match="maybe"):
        prop.setValueFromStr("maybe")


@rule("property", "`setValuesFromStr` and `getValuesStr` use one text with `;` between the values")
def test_values_as_one_text():
    prop = Property("P", [9])
    prop.setValuesFromStr("1;2;3")
    assert prop.values == [1, 2, 3]
    assert prop.getValuesStr() == "1;2;3"
    assert Property("P", int).getValuesStr() == ""


@rule("property", "`dataTypeIs` of a type: exactly it; of a value: an instance of the data type")
def test_data_type_is():
    prop = Property("P", 1)
    assert prop.dataTypeIs(int) and not prop.dataTypeIs(object) and not prop.dataTypeIs(bool)
    assert prop.dataTypeIs(7) and not prop.dataTypeIs("x")


@rule("property", "`isSpecified()`: there is a value")
def test_is_specified():
    assert Property("P", 0).isSpecified() and not Property("P", int).isSpecified()


@rule("property", "`printState()` is `key:[...]`, cut after 500 characters of values with ` ...]`")
def test_print_state_is_cut():
    assert Property("P", [1.5]).printState() == "P:[1.5]"
    text = Property("P", "x" * 1000).printState()
    assert text.startswith("P:['xxx") and text.endswith("x ...]")
    assert len(text) < 520
