"""`Param` and `ParamHandler`, as callers of SkiROS2 use them. Compatibility, section 4."""

import datetime
import logging

import pytest

from compatibility.rules import rule
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element


def param(value, kind=ParamTypes.Required):
    return Param("P", "about P", value, kind)


def handler(**values):
    made = ParamHandler()
    for key, value in values.items():
        made.addParam(key, value, ParamTypes.Required)
    return made


def values_of(params):
    return {key: p.values for key, p in params.items()}


def product(number=0):
    return Element("skiros:Product", "", f"skiros:Product-{number}" if number else "")


# -- one parameter -----------------------------------------------------------------------------------------------------


@rule("params", "`param_type` may be a `ParamTypes` or its code 0, 1, 2")
def test_the_type_may_be_its_code():
    assert [param(int, code).paramType for code in (0, 1, 2)] == list(ParamTypes)


@rule("params", "`isSpecified()` is True for an abstract element")
def test_an_abstract_element_is_a_value():
    assert param(product()).isSpecified() and not param(Element).isSpecified()


@rule("params", "`hasSpecifiedDefault()`: there is a default; an abstract element counts")
def test_an_abstract_element_is_a_default():
    assert param(product()).hasSpecifiedDefault() and not param(int).hasSpecifiedDefault()


@rule("params", "`hasDefaultValues()`: the values are the defaults; True when unset")
@pytest.mark.parametrize(("default", "other"), [(1, 2), (product(), product(3)), ([1, 2], 5)])
def test_has_default_values(default, other):
    made = param(default)
    assert made.hasDefaultValues()
    made.value = other
    assert not made.hasDefaultValues()
    made.setDefault()
    assert made.hasDefaultValues()
    made.unset()
    assert made.hasDefaultValues()


@rule("params", "`default`, `getDefaultValue(i)`: None without defaults, `IndexError` beyond the end")
def test_default_values_by_index():
    assert (param(int).default, param(int).getDefaultValue(3)) == (None, None)
    made = param([1, 2])
    assert (made.default, made.getDefaultValue(1)) == (1, 2)
    with pytest.raises(IndexError):
        made.getDefaultValue(2)


@rule("params", "`makeDefault` sets the values and makes them the default; a wrong type logs and changes no value")
def test_make_default(caplog):
    made = param(1)
    made.makeDefault([2, 3])
    made.values.append(4)
    assert made.getDefaultValues() == [2, 3]
    with caplog.at_level(logging.ERROR):
        made.makeDefault("x")
    assert made.values == [2, 3, 4]
    assert "P" in caplog.text


@rule("params", "`setDefault()` sets a copy of the default")
def test_set_default_sets_a_copy():
    made = param([1, 2])
    made.setDefault()
    made.values.append(3)
    assert made.getDefaultValues() == [1, 2]


@rule("params", "`last_update` is a datetime; `hasChanges(time, tolerance)` counts in microseconds")
def test_time_of_the_last_set():
    made = param(1)
    before = datetime.datetime.now() - datetime.timedelta(seconds=1)
    assert isinstance(made.last_update, datetime.datetime)
    assert made.hasChanges(before) and not made.hasChanges(made.last_update)
    assert not made.hasChanges(made.last_update - datetime.timedelta(microseconds=50), 100)
    assert made.hasChanges(made.last_update - datetime.timedelta(microseconds=50), 10)


@rule("params", "`hasChanges` takes a datetime", better="seconds since the epoch and a ROS time too")
def test_has_changes_takes_other_times():
    class RosTime:
        def to_sec(self):
            return 0.0

    assert param(1).hasChanges(0.0) and param(1).hasChanges(RosTime())


@rule("params", "`setValue`, `setValues`, `addValue` and `removeValue` set the time, also when nothing changed")
@pytest.mark.parametrize(
    ("setter", "value"), [("setValue", 1), ("setValues", [1]), ("addValue", "wrong"), ("removeValue", 9)]
)
def test_each_setter_sets_the_time(setter, value):
    made = param(1)
    before = made.last_update
    while datetime.datetime.now() <= before:
        pass
    getattr(made, setter)(value)
    assert made.last_update > before


@rule("params", "`toElement()` of a plain parameter: data type without a value, `skiros:Default`, `skiros:Value`")
def test_a_plain_parameter_as_an_element():
    made = param({"a": 1}, ParamTypes.Optional)
    element = made.toElement()
    assert (element.type, element.label) == ("skiros:Parameter", "P")
    keys = ["rdfs:comment", "skiros:ParameterType", "skiros:DataType", "skiros:Default", "skiros:Value"]
    assert list(element.available_properties) == keys
    assert element.getProperty("rdfs:comment").values == ["about P"]
    assert element.getProperty("skiros:ParameterType").values == [1]
    datatype = element.getProperty("skiros:DataType")
    assert (datatype.dataType(), datatype.values) == (dict, [])
    assert element.getProperty("skiros:Value").values == [{"a": 1}]
    assert list(param(int).toElement().available_properties) == keys[:3]


@rule("params", "`toElement()` of an element parameter: its class as declared, `skiros:hasValue` per value with an id")
def test_an_element_parameter_as_an_element():
    made = param(Element("MyType"))
    assert made.toElement().getProperty("skiros:DataType").values == ["MyType"]
    made.values = [product(1), product(2), product()]
    relations = made.toElement().getRelations("-1", "skiros:hasValue", "")
    assert [r["dst"] for r in relations] == ["skiros:Product-1", "skiros:Product-2"]


# -- the handler -------------------------------------------------------------------------------------------------------


@rule(
    "params", "`reset(d)` takes that very dict; `getParamMap()` is the live dict; `getCopy()` has copies of the values"
)
def test_the_dict_of_parameters():
    params, given = handler(A=1), handler(B=[1]).getParamMap()
    params.reset(given)
    assert params.getParamMap() is given
    copy = params.getCopy()
    copy["B"].values.append(2)
    assert params.getParamValues("B") == [1]


@rule("params", "An unknown key in `getParam`, `getParamValue`, `getParamValues`: a logged error, None",
      better="the error names the nearest keys")  # fmt: skip
@pytest.mark.parametrize("getter", ["getParam", "getParamValue", "getParamValues"])
def test_getting_an_unknown_key(getter, caplog):
    with caplog.at_level(logging.ERROR):
        assert getattr(handler(Gripper=1, Speed=2), getter)("Griper") is None
    assert "no parameter 'Griper'; near: Gripper" in caplog.text


@rule("params", "`hasParam` asks without an error")
def test_has_param(caplog):
    assert handler(A=1).hasParam("A") and not handler(A=1).hasParam("B")
    assert not caplog.records


@rule("params", '`params["X"]` of an unknown key logs and answers None',
      differs="it raises in the hooks of a running skill and names the nearest keys; "
              "`hasParam` asks without raising")  # fmt: skip
def test_an_unknown_key_raises_in_a_hook(skill_bench, caplog):
    from skiros2_common.core.abstract_skill import SkillDescription, State
    from skiros2_common.core.primitive import PrimitiveBase

    class Grip(SkillDescription):
        def createDescription(self):
            self.addParam("Gripper", "left", ParamTypes.Required)

    class grip(PrimitiveBase):
        def createDescription(self):
            self.setDescription(Grip(), "grip")

        def execute(self):
            assert not self.params.hasParam("Griper")
            return self.success(self.params["Griper"].value)

    skill_bench.load(grip)
    task = skill_bench.command("Grip").run()
    assert task.state is State.Failure
    assert "no parameter 'Griper'; near: Gripper" in task.why
    with caplog.at_level(logging.ERROR):
        assert handler(Gripper=1)["Griper"] is None
    assert "near: Gripper" in caplog.text


@rule("params", "`specify`, `specifyDefault` of an unknown key: a logged error, no effect")
@pytest.mark.parametrize("setter", ["specify", "specifyDefault"])
def test_specifying_an_unknown_key(setter, caplog):
    params = handler(A=1)
    with caplog.at_level(logging.ERROR):
        getattr(params, setter)("B", 2)
    assert values_of(params) == {"A": [1]}
    assert "no parameter 'B'" in caplog.text


@rule("params", "`SkillCore.specifyParam`, `specifyParamDefault` of an unknown key: a logged error, no effect")
@pytest.mark.parametrize("setter", ["specifyParam", "specifyParamDefault"])
def test_a_skill_specifying_an_unknown_key(setter, caplog):
    from skiros2_common.core.abstract_skill import SkillCore

    core = SkillCore()
    with caplog.at_level(logging.ERROR):
        getattr(core, setter)("B", 2)
    assert not core.params.hasParam("B")
    assert "no parameter 'B'" in caplog.text


@rule("params", "`isSpecified`, `setDefault` of an unknown key: `KeyError`")
@pytest.mark.parametrize("method", ["isSpecified", "setDefault"])
def test_other_methods_with_an_unknown_key(method):
    with pytest.raises(KeyError):
        getattr(handler(A=1), method)("B")


@rule(
    "params",
    "`remap(a, b)` moves the parameter to `b`, in the place of one that is there; unknown or equal keys: nothing",
)
def test_remap():
    params = handler(A=1, B=2, C=3)
    moved = params.getParam("A")
    params.remap("A", "B")
    params.remap("X", "Y")
    params.remap("C", "C")
    assert values_of(params) == {"B": [1], "C": [3]}
    assert params.getParam("B") is moved and moved.key == "B"


@rule("params", "`specify` sets all values; a wrong type logs; None unsets")
def test_specify(caplog):
    params = handler(A=1)
    params.specify("A", [2, 3])
    with caplog.at_level(logging.ERROR):
        params.specify("A", "x")
    assert params.getParamValues("A") == [2, 3]
    assert "A" in caplog.text
    params.specify("A", None)
    assert params.getParamValues("A") == []


@rule("params", "`setDefault()` resets all, `setDefault(key)` one, `setDefault([keys])` some")
@pytest.mark.parametrize(("keys", "expected"), [(None, (1, 1, 1)), ("B", (9, 1, 9)), (["A", "C"], (1, 9, 1))])
def test_set_default(keys, expected):
    params = handler(A=1, B=1, C=1)
    for key in "ABC":
        params.specify(key, 9)
    params.setDefault(keys)
    assert tuple(params.getParamValue(key) for key in "ABC") == expected


@rule("params", "`merge(other)` returns a new dict and changes neither side")
def test_merge_returns_a_dict():
    params, other = handler(Own=1, Both=2, Unset=3), handler(Both=20, Unset=int, New=40, Nothing=int)
    merged = params.merge(other)
    assert values_of(merged) == {"Own": [1], "Both": [20], "New": [40]}
    assert merged["New"] is other.getParam("New")
    assert merged["Both"].default == 2
    assert values_of(params) == {"Own": [1], "Both": [2], "Unset": [3]}


@rule("params", "`merge` of a wrong type logs and keeps the own value")
def test_merge_of_a_wrong_type(caplog):
    with caplog.at_level(logging.ERROR):
        merged = handler(A=1).merge(handler(A="x"))
    assert values_of(merged) == {"A": [1]}
    assert "A" in caplog.text


@rule("params", "`specifyParams(other)` takes the values of common keys, also none; a wrong type logs")
def test_specify_params(caplog):
    params = handler(A=1, B=2, C=3)
    with caplog.at_level(logging.ERROR):
        params.specifyParams(handler(A=10, B=int, C="x", D=4))
    assert values_of(params) == {"A": [10], "B": [], "C": [3]}


@rule("params", "`specifyParams(other, keep_default=True)` keeps defaults, but for abstract elements and equal ids")
def test_specify_params_keeping_defaults():
    params = handler(A=1, Any=product(), Same=product(1), Other=product(2), Free=int)
    fresh = product(1)
    params.specifyParams(handler(A=9, Any=product(3), Same=fresh, Other=product(4), Free=5), keep_default=True)
    assert params.getParamValue("A") == 1
    assert params.getParamValue("Any").id == "skiros:Product-3"
    assert params.getParamValue("Same") is fresh
    assert params.getParamValue("Other").id == "skiros:Product-2"
    assert params.getParamValue("Free") == 5


@rule("params", "`specifyParamsDefault(other)` makes the values of common keys the defaults, also none")
def test_specify_params_default():
    params = handler(A=1, B=2, C=3)
    params.specifyParamsDefault(handler(A=10, B=int))
    assert [params.getParam(key).getDefaultValues() for key in "ABC"] == [[10], [], [3]]
    assert values_of(params) == {"A": [10], "B": [], "C": [3]}


@rule("params", "`getElementParams()` is a dict of those whose present value is an element")
def test_element_params():
    params = handler(A=1, E=product(), Unset=Element)
    assert list(params.getElementParams()) == ["E"]
    assert params.getElementParams()["E"] is params.getParam("E")


@rule("params", "`getParamMapFiltered` takes a type or a list of types and gives a dict")
def test_param_map_filtered():
    params = ParamHandler()
    for kind in ParamTypes:
        params.addParam(kind.name, 1, kind)
    assert list(params.getParamMapFiltered(ParamTypes.Optional)) == ["Optional"]
    wanted = [ParamTypes.Required, ParamTypes.Inferred]
    assert list(params.getParamMapFiltered(wanted)) == ["Required", "Inferred"]


@rule("params", "`printState()` is `key:[values] ` each; of an element parameter `key: id-label `")
def test_print_state():
    assert handler(A=1, B=int).printState() == "A:[1] B:[] "
    assert handler(E=Element("skiros:Product", "starter", "skiros:Product-1")).printState() == (
        "E: skiros:Product-1-starter "
    )
