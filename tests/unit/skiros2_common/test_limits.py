"""Units, limits and choices of parameters."""

import json
import math

import pytest

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.limits import NO_LIMITS, Limits
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.skill_description import SkillDescription
from skiros2_common.ros import utils


class Drive(SkillDescription):
    def createDescription(self):
        self.addParam("Speed", 0.5, ParamTypes.Optional, description="How fast", unit="m/s", minimum=0.1, maximum=2)
        self.addParam("Gait", "walk", ParamTypes.Optional, choices=["walk", "trot"])
        self.addParam("Steps", int, ParamTypes.Required, minimum=1)
        self.addParam("Name", str, ParamTypes.Required, "What to call it")


@pytest.mark.parametrize(
    ("limits", "text"),
    [
        (NO_LIMITS, ""),
        (Limits("m/s"), "in m/s"),
        (Limits("m/s", 0.1, 2), "0.1 to 2 m/s"),
        (Limits(minimum=1), "at least 1"),
        (Limits("N", maximum=-3.5), "at most -3.5 N"),
        (Limits(choices=("slow", "fast")), "one of slow, fast"),
        (Limits("mm", choices=(10, 20)), "one of 10, 20 mm"),
    ],
)
def test_limits_are_described(limits, text):
    assert limits.text == text


@pytest.mark.parametrize(
    ("limits", "allowed", "rejected"),
    [
        (NO_LIMITS, [-1e9, math.inf, math.nan, "any", True], []),
        (Limits(minimum=0, maximum=1), [0, 0.5, 1], [-0.001, 1.001, math.inf, math.nan]),
        (Limits(minimum=0), [0, math.inf], [-1, math.nan]),
        (Limits(maximum=0), [0, -math.inf], [1]),
        (Limits(choices=("slow", "fast")), ["slow"], ["Slow", ""]),
        (Limits(minimum=2, choices=(1, 2)), [2], [1, 3]),
    ],
)
def test_values_outside_limits_are_named(limits, allowed, rejected):
    assert limits.problem(allowed) == ""
    for value in rejected:
        assert limits.problem([*allowed, value]) == f"expected {limits.text}, got {value!r}"


def test_all_values_outside_limits_are_named_at_once():
    assert Limits("m", 0, 1).problem([5.0, 0.5, 7.0]) == "expected 0 to 1 m, got 5.0, 7.0"


@pytest.mark.parametrize("bound", ["1", None, True])
def test_bound_must_be_a_number(bound):
    if bound is None:
        assert Limits(minimum=bound) == NO_LIMITS
        return
    with pytest.raises(WrongType, match="float"):
        Limits(minimum=bound)


@pytest.mark.parametrize(
    ("limits", "datatype", "defaults", "fault"),
    [
        (Limits("m", 0, 1), float, [0.5], None),
        (Limits("m", 0, 1), int, [], None),
        (Limits(choices=(1, 2)), float, [1.0], None),
        (Limits("m", 0, 1), float, [0.5, 1.5], "default that it does not allow: expected 0 to 1 m, got 1.5"),
        (Limits(minimum=2, maximum=1), float, [], "minimum 2, greater than the maximum 1"),
        (Limits(minimum=2), str, [], "a minimum or a maximum, but its values are of type str"),
        (Limits(choices=(1, "a")), int, [], "choices 'a', not of type int"),
    ],
)
def test_mistakes_in_limits_are_described(limits, datatype, defaults, fault):
    faults = limits.faults(datatype, defaults)
    assert len(faults) == (fault is not None)
    assert all(fault in text for text in faults)


def test_description_keeps_unit_limits_and_choices():
    params = Drive().params
    assert params["Speed"].limits == Limits("m/s", 0.1, 2)
    assert params["Gait"].limits == Limits(choices=("walk", "trot"))
    assert params["Name"].limits == NO_LIMITS
    assert params["Speed"].description == "How fast"


def test_redefined_parameter_has_its_own_limits():
    skill = Drive()
    skill.addParam("Speed", 5.0, ParamTypes.Optional)
    assert skill.params["Speed"].limits == NO_LIMITS


def test_copies_of_a_parameter_have_its_limits():
    speed = Drive().params["Speed"]
    assert speed.clone().limits == speed.with_values([1.0]).limits == speed.limits


def test_world_model_element_has_unit_limits_and_choices():
    speed, gait = (Drive().params[key].toElement() for key in ("Speed", "Gait"))
    assert speed.getProperty("skiros:Unit").values == ["m/s"]
    assert speed.getProperty("skiros:LowerBound").values == [0.1]
    assert speed.getProperty("skiros:UpperBound").values == [2.0]
    assert gait.getProperty("skiros:hasValues").values == ["walk", "trot"]
    assert not gait.hasProperty("skiros:Unit")
    assert not gait.hasProperty("skiros:LowerBound")


def test_skill_element_has_the_parameters_with_limits():
    element = Drive().toElement()
    registered = {child.label for _, relation, child in element.local_relations if relation == "skiros:hasParam"}
    assert registered == {"Speed", "Gait", "Steps", "Robot"}
    assert element.getProperty("skiros:MissingParameter").values == ["Name"]


def test_limits_pass_through_messages():
    sent = Drive().params
    received = utils.deserializeParamMap(utils.serializeParamMap(sent))
    assert {key: param.limits for key, param in received.items()} == {key: param.limits for key, param in sent.items()}


def test_message_of_a_parameter_without_limits_has_no_more_members():
    message = utils.serializeParamMap({"Name": Drive().params["Name"]})[0]
    assert set(json.loads(message.param)) == {"key", "description", "specType", "type", "values"}


@pytest.mark.parametrize("member", ['"unit": 5', '"choices": 5', '"minimum": "1"', '"maximum": [1]'])
def test_malformed_limits_in_a_message_are_rejected(member):
    with pytest.raises(WrongValue):
        utils.decodeParam(f'{{"key": "K", "specType": 0, "type": "float", "values": [], {member}}}')
