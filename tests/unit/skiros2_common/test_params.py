"""Parameters and the handler that holds them."""

import logging
import time

from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element


def handler(**values):
    made = ParamHandler()
    for key, value in values.items():
        made.addParam(key, value, ParamTypes.Required)
    return made


def test_print_state_is_key_and_values_with_a_space_after_each():
    assert handler(MyDict=dict, MyFloat=1.0).printState() == "MyDict:[] MyFloat:[1.0] "


def test_value_is_a_default_and_type_is_not():
    assert not Param("A", "", str, ParamTypes.Required).hasSpecifiedDefault()
    assert Param("A", "", "x", ParamTypes.Required).default == "x"


def test_abstract_element_is_a_default_but_not_bound():
    param = Param("Object", "", Element("skiros:Product"), ParamTypes.Inferred)
    assert not param.is_bound()
    assert not param.has_bound_default()
    assert param.element_type == "skiros:Product"


def test_changing_an_abstract_value_keeps_the_default():
    param = Param("Object", "", Element("skiros:Product"), ParamTypes.Inferred)
    param.setDefault()
    param.value.setProperty("skiros:Weight", 1.0)
    assert not param.default.hasProperty("skiros:Weight")


def test_has_changes_is_true_after_a_setter_call():
    param = Param("A", "", 1, ParamTypes.Required)
    assert not param.hasChanges(param.last_update)
    assert param.hasChanges(time.time() - 1.0)


def test_unknown_key_is_logged_and_returns_none(caplog):
    params = handler(A=1)
    with caplog.at_level(logging.ERROR):
        assert params["B"] is None
    assert "no parameter 'B'; there are: A" in caplog.text


def test_remap_renames_a_key():
    params = handler(A=1, B=2)
    params.remap("A", "X")
    assert list(params.keys()) == ["X", "B"]
    assert params["X"].key == "X"


def test_specify_params_keeps_a_concrete_default():
    params = handler(A=1, E=Element("skiros:Product"))
    other = handler(A=2, E=Element("skiros:Product", "", "skiros:Product-1"), Z=3)
    params.specifyParams(other, keep_default=True)
    assert params.getParamValue("A") == 1
    assert params.getParamValue("E").id == "skiros:Product-1"
    params.specifyParams(other, keep_default=False)
    assert params.getParamValue("A") == 2
    assert not params.hasParam("Z")


def test_get_copy_is_independent():
    params = handler(A=1)
    params.getCopy()["A"].value = 2
    assert params.getParamValue("A") == 1


def test_filter_by_type():
    params = ParamHandler()
    params.addParam("A", 1, ParamTypes.Required)
    params.addParam("B", 1, ParamTypes.Optional)
    params.addParam("C", Element("skiros:Product"), ParamTypes.Inferred)
    assert list(params.getParamMapFiltered(ParamTypes.Optional)) == ["B"]
    assert list(params.getParamMapFiltered([ParamTypes.Required, ParamTypes.Inferred])) == ["A", "C"]
    assert list(params.getElementParams()) == ["C"]


def test_to_element_of_a_plain_parameter():
    element = Param("Speed", "how fast", 0.5, ParamTypes.Optional).toElement()
    assert (element.type, element.label) == ("skiros:Parameter", "Speed")
    assert element.getProperty("rdfs:comment").value == "how fast"
    assert element.getProperty("skiros:ParameterType").value == 1
    datatype = element.getProperty("skiros:DataType")
    assert (datatype.dataType(), datatype.values) == (float, [])
    assert element.getProperty("skiros:Default").values == [0.5]
    assert element.getProperty("skiros:Value").values == [0.5]


def test_to_element_of_an_element_parameter():
    param = Param("Object", "", Element("skiros:Product"), ParamTypes.Required)
    assert param.toElement().getProperty("skiros:DataType").value == "skiros:Product"
    param.value = Element("skiros:Product", "", "skiros:Product-4")
    assert param.toElement().hasRelation("-1", "skiros:hasValue", "skiros:Product-4")


def test_iterating_parameters_gives_their_keys():
    handler = ParamHandler()
    handler.addParam("A", 1, ParamTypes.Required)
    handler.addParam("B", 2, ParamTypes.Optional)
    assert list(handler) == ["A", "B"]
