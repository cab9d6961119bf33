"""Plans, parameters, properties and relations as programs send and read them. Compatibility, section 1."""

import json

import pytest

from compatibility.rules import rule
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.ros import utils
from skiros2_msgs import msg as msgs
from skiros2_skill.ros.utils import SkillHolder, decodeSkill, deserialize_skill, encodeSkill


def starter():
    element = Element("skiros:Product", "skiros:starter", "skiros:Product-3")
    element.setProperty("skiros:Weight", 1.5)
    element.addRelation("skiros:Tray-1", "skiros:contain", "-1")
    return element


def pick():
    params = {
        "Object": Param("Object", "What to pick", starter(), ParamTypes.Required),
        "Speed": Param("Speed", "", float, ParamTypes.Optional),
    }
    return SkillHolder("/robot", "skiros:Pick", "pick", params)


def plan():
    return SkillHolder("", "Processor", "Sequential", None, [pick()])


@rule(
    "wire", "A plan is one JSON text: `manager`, `type`, `name`, `ph`, `children`; `ph` is an object by parameter key"
)
def test_ph_is_an_object_by_key():
    decoded = json.loads(plan().toJson())
    assert {k: decoded[k] for k in ("manager", "type", "name", "ph")} == {
        "manager": "", "type": "Processor", "name": "Sequential", "ph": {},
    }  # fmt: skip
    (step,) = decoded["children"]
    assert list(step) == ["manager", "type", "name", "ph", "children"]
    assert list(step["ph"]) == ["Object", "Speed"]
    assert step["children"] == []


@rule(
    "wire", "A parameter is `key`, `description`, `specType` (0, 1, 2), `type`, `values`; `values` is `[]` when unset"
)
def test_the_members_of_a_parameter():
    ph = json.loads(plan().toJson())["children"][0]["ph"]
    assert ph["Speed"] == {"key": "Speed", "description": "", "specType": 1, "type": "float", "values": []}
    assert (ph["Object"]["specType"], ph["Object"]["type"]) == (0, "skiros_wm::Element")


@rule("wire", "An element in a plan has `id`, `label`, `type`, `last_update` 0.0, its properties and its relations")
def test_the_members_of_an_element():
    (element,) = json.loads(plan().toJson())["children"][0]["ph"]["Object"]["values"]
    assert element == {
        "id": "skiros:Product-3",
        "label": "skiros:starter",
        "type": "skiros:Product",
        "last_update": 0.0,
        "properties": {"skiros:Weight": {"key": "skiros:Weight", "type": "float", "values": [1.5]}},
        "relations": [
            {"src": "skiros:Tray-1", "type": "skiros:contain", "dst": "-1", "state": True, "abstract": False}
        ],
    }


def as_texts(ph):
    return {key: json.dumps(value) for key, value in ph.items()}


@rule(
    "wire", "`deserialize_skill` and `decodeSkill` read a text or an object; a value of `ph` is an object or its text"
)
@pytest.mark.parametrize("form", [dict, as_texts])
@pytest.mark.parametrize("read", [deserialize_skill, decodeSkill])
@pytest.mark.parametrize("given", [json.dumps, dict])
def test_all_forms_of_a_plan_are_read(form, read, given):
    decoded = json.loads(plan().toJson())
    decoded["children"][0]["ph"] = form(decoded["children"][0]["ph"])
    (step,) = read(given(decoded)).children
    assert (step.manager, step.type, step.name) == ("/robot", "skiros:Pick", "pick")
    assert step.ph.getParamValue("Object").id == "skiros:Product-3"
    assert step.ph.getParam("Speed").values == []


@rule("wire", "A plan without a part of a skill is an error", better="plans with `ph` as a list are read too")
def test_a_missing_part_is_an_error_and_ph_may_be_a_list():
    decoded = json.loads(plan().toJson())
    decoded["children"][0]["ph"] = list(decoded["children"][0]["ph"].values())
    assert list(deserialize_skill(json.dumps(decoded)).children[0].ph.keys()) == ["Object", "Speed"]
    for part in ("manager", "type", "name", "ph", "children"):
        with pytest.raises(ValueError, match=part):
            decodeSkill({key: value for key, value in decoded.items() if key != part})


@rule(
    "wire", "`SkillHolder` has `ph` (a `ParamHandler`), `children` (a list), `toMsg()`, and `str()` as `type:name [ph]`"
)
def test_a_skill_holder():
    holder = pick()
    assert isinstance(holder.ph, ParamHandler)
    assert holder.children == []
    assert str(holder) == f"skiros:Pick:pick [{holder.ph.printState()}]"
    message = holder.toMsg()
    assert isinstance(message, msgs.ResourceDescription)
    assert (message.type, message.name, len(message.params)) == ("skiros:Pick", "pick", 2)
    assert encodeSkill(utils.ParamsEncoder(), holder)["ph"]["Speed"]["key"] == "Speed"


@rule("wire", "`dataValue` of a property message is a JSON list; anything else is refused")
@pytest.mark.parametrize("text", ["", "no JSON", "5", '"text"', '{"a": 1}', "null"])
def test_a_data_value_is_a_list(text):
    with pytest.raises(ValueError, match="skiros:P"):
        utils.deserializePropertyMap([msgs.Property("skiros:P", text, "int")])
    assert utils.deserializePropertyMap([msgs.Property("skiros:P", "[5]", "int")])["skiros:P"].values == [5]


@rule("wire", '`ParamsEncoder` writes a value that JSON cannot hold as `"NotSerializable"`')
def test_values_that_json_cannot_hold():
    assert json.loads(json.dumps({"x": [object()]}, cls=utils.ParamsEncoder)) == {"x": ["NotSerializable"]}


@rule(
    "wire", "`registerClass(name, class)` works without encoder and decoder; registering twice is reported and ignored"
)
def test_register_class(caplog):
    class Colour:
        pass

    class Other:
        pass

    utils.registerClass("compatibility::Colour", Colour)
    utils.registerClass("compatibility::Colour", Other)
    assert "compatibility::Colour" in caplog.text
    assert isinstance(utils.getTypeFromStr("compatibility::Colour"), Colour)
    assert utils.getStrFromType(Colour()) == "compatibility::Colour"


@rule("wire", '`json_loads_byteified` of bad text is None; `getTypeFromStr("int")` is an instance (0)')
def test_reading_helpers():
    assert utils.json_loads_byteified("{") is None
    assert utils.json_loads_byteified("[1]") == [1]
    assert utils.getTypeFromStr("int") == 0
    assert utils.getTypeFromStr("str") == ""


@rule("wire", "`makeRelation` and `msg2relation` give dicts with `src`, `type`, `dst`")
def test_relation_dicts():
    for relation in (
        utils.makeRelation("a", "skiros:at", "b"),
        utils.msg2relation(msgs.Relation("a", "skiros:at", "b")),
    ):
        assert (relation["src"], relation["type"], relation["dst"]) == ("a", "skiros:at", "b")


@rule("wire", "Elements whose relations have only `src`, `type`, `dst` are written")
def test_a_relation_of_three_keys_is_written():
    element = Element("skiros:Tray", "", "skiros:Tray-1")
    element._relations = [{"src": "-1", "type": "skiros:at", "dst": "skiros:Location-1"}]
    (relation,) = utils.element2msg(element).relations
    assert (relation.subjectId, relation.predicate, relation.objectId) == ("-1", "skiros:at", "skiros:Location-1")
    (relation,) = utils.encodeElement(utils.ParamsEncoder(), element)["relations"]
    assert (relation["state"], relation["abstract"]) == (True, False)
