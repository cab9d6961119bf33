"""Wire formats: parameters, properties and elements as JSON and as messages."""

import json

import pytest

from skiros2_common.core.errors import SkirosError, UnknownName, WrongType, WrongValue
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_common.ros import utils
from skiros2_msgs import msg as msgs


def product():
    element = Element("skiros:Product", "skiros:starter", "skiros:Product-3")
    element.setProperty("skiros:Weight", 1.5)
    element.setProperty("skiros:Empty", str)
    element.addRelation("skiros:Tray-1", "skiros:contain", "-1")
    return element


def through_the_wire(param):
    return utils.deserializeParamMap(utils.serializeParamMap({param.key: param}))[param.key]


@pytest.mark.parametrize("value", ["x", 1, 1.5, True, {"a": 1}, [1, 2], str, dict])
def test_parameter_round_trips(value):
    sent = Param("P", "what it is", value, ParamTypes.Optional)
    got = through_the_wire(sent)
    assert (got.key, got.description, got.paramType) == ("P", "what it is", ParamTypes.Optional)
    assert got.values == sent.values
    assert got.dataType() is sent.dataType()


def test_json_of_a_parameter_matches_the_contract():
    sent = Param("Object", "it", product(), ParamTypes.Inferred)
    encoded = json.loads(utils.serializeParamMap({"Object": sent})[0].param)
    assert {k: encoded[k] for k in ("key", "description", "specType", "type")} == {
        "key": "Object", "description": "it", "specType": 2, "type": "skiros_wm::Element",
    }  # fmt: skip
    element = encoded["values"][0]
    assert sorted(element) == ["id", "label", "last_update", "properties", "relations", "type"]
    assert element["properties"]["skiros:Weight"] == {"key": "skiros:Weight", "type": "float", "values": [1.5]}
    assert element["relations"] == [
        {"src": "skiros:Tray-1", "type": "skiros:contain", "dst": "-1", "state": True, "abstract": False}
    ]


def test_element_round_trips():
    for got in (
        through_the_wire(Param("O", "", product(), ParamTypes.Required)).value,
        utils.msg2element(utils.element2msg(product())),
    ):
        assert (got.id, got.type, got.label) == ("skiros:Product-3", "skiros:Product", "skiros:starter")
        assert got.getProperty("skiros:Weight").values == [1.5]
        assert got.getProperty("skiros:Empty").values == []
        assert got.hasRelation("skiros:Tray-1", "skiros:contain", "-1")


def test_integer_in_json_is_accepted_for_a_float():
    param = utils.decodeParam('{"key": "D", "specType": 0, "type": "float", "values": [2]}')
    assert param.value == 2.0
    assert isinstance(param.value, float)


@pytest.mark.parametrize(
    ("text", "error", "named"),
    [
        ("{", WrongValue, "not JSON"),
        ("[]", WrongValue, "expected a JSON object"),
        ('{"specType": 0, "type": "int", "values": []}', WrongValue, "'key'"),
        ('{"key": "K", "specType": 7, "type": "int", "values": []}', WrongValue, "specType 7"),
        ('{"key": "K", "specType": true, "type": "int", "values": []}', WrongValue, "specType"),
        ('{"key": "K", "specType": 0, "type": "os.system", "values": ["x"]}', UnknownName, "os.system"),
        ('{"key": "K", "specType": 0, "type": "eval", "values": ["x"]}', UnknownName, "eval"),
        ('{"key": "K", "specType": 0, "type": "int", "values": ["x"]}', WrongType, "K: expected"),
        ('{"key": "K", "specType": 0, "type": "skiros_wm::Element", "values": [5]}', WrongValue, "element"),
        ('{"key": "K", "specType": 0, "type": "int", "values": 5}', WrongValue, "'values'"),
    ],
)
def test_broken_parameter_is_rejected_with_its_key(text, error, named):
    with pytest.raises(error, match=named):
        utils.deserializeParamMap([msgs.Param(text)])


def test_duplicate_key_is_rejected():
    param = utils.serializeParamMap({"A": Param("A", "", 1, ParamTypes.Required)})
    with pytest.raises(WrongValue, match="'A' is given twice"):
        utils.deserializeParamMap(param * 2)


@pytest.mark.parametrize(
    ("value", "datatype", "named"),
    [("[1", "int", "not a JSON list"), ("[1]", "nope", "unknown type name 'nope'"), ('["a"]', "int", "got str 'a'")],
)
def test_broken_property_is_rejected(value, datatype, named):
    with pytest.raises(SkirosError, match=named):
        utils.deserializePropertyMap([msgs.Property("skiros:P", value, datatype)])


def test_properties_round_trip():
    sent = {"skiros:P": Property("skiros:P", [1, 2]), "skiros:Q": Property("skiros:Q", bool)}
    got = utils.deserializePropertyMap(utils.serializePropertyMap(sent))
    assert got["skiros:P"].values == [1, 2]
    assert got["skiros:Q"].dataType() is bool


def test_value_of_a_registered_class_round_trips():
    class Colour:
        def __init__(self, name):
            self.name = name

    utils.registerClass("test::Colour", Colour, lambda encoder, c: c.name, Colour)
    got = through_the_wire(Param("C", "", Colour("red"), ParamTypes.Required))
    assert isinstance(got.value, Colour)
    assert got.value.name == "red"
    assert utils.getStrFromType(Colour) == "test::Colour"
    assert utils.type_named("test::Colour") is Colour


def test_class_without_a_wire_name_is_rejected():
    with pytest.raises(UnknownName, match="no wire name"):
        utils.serializeParamMap({"X": Param("X", "", object(), ParamTypes.Required)})


def test_params_properties_and_elements_round_trip_alone():
    encoder = utils.ParamsEncoder()
    param = Param("Speed", "how fast", 0.5, ParamTypes.Optional)
    assert utils.decodeParam(utils.encodeParam(encoder, param)).printState() == "Speed:[0.5]"
    prop = product().getProperty("skiros:Weight")
    assert utils.decodeProperty(json.dumps(utils.encodeProperty(encoder, prop))).values == [1.5]
    element = utils.decodeElement(json.dumps(utils.encodeElement(encoder, product()), cls=utils.ParamsEncoder))
    assert (repr(element), element.getRelations()) == (repr(product()), product().getRelations())


def test_relations_and_statements_as_messages():
    relation = utils.makeRelation("skiros:Tray-1", "skiros:contain", "skiros:Product-3")
    assert utils.msg2relation(utils.relation2msg(relation)) == relation
    parts = ("skiros:Tray-1", "skiros:contain", "skiros:Product-3")
    assert utils.makeRelationMsg(*parts) == utils.relation2msg(relation)
    statement = utils.makeStatementMsg(*parts, False)
    assert (statement.relation, statement.value) == (utils.relation2msg(relation), False)


def test_class_can_be_registered_in_three_steps():
    class Size:
        def __init__(self, metres):
            self.metres = metres

    utils.registerCtype("test::Size", Size)
    utils.registerEncoder(Size, lambda encoder, size: size.metres)
    utils.registerDecoder("test::Size", Size)
    assert through_the_wire(Param("S", "", Size(2.0), ParamTypes.Required)).value.metres == 2.0


@pytest.mark.parametrize(
    "value", [1.5, -0.0, 1e300, 1e-7, float("nan"), float("inf"), -float("inf"), 3, 10**30, True, 'a"ü\n\ud800', "", {}]
)
def test_value_of_property_is_written_as_the_json_of_its_list(value):
    (message,) = utils.serializePropertyMap({"p": Property("p", value)})
    assert message.dataValue == json.dumps([value])
