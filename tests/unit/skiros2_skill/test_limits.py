"""Values outside the limits of parameters: refused at the start of a skill, and found by lint."""

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import OutOfLimits
from skiros2_common.core.explanation import PARAMETER
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_skill.core.lint.linter import Linter
from skiros2_skill.core.runtime.request import JsonValues, SkillRequest, explain_refusal, make_nodes
from skiros2_skill.core.skill import SkillBase, SkillDescription
from unit.skiros2_skill.skills import describe, primitive


class Drive(SkillDescription):
    def createDescription(self):
        self.addParam("Speed", 0.5, ParamTypes.Optional, unit="m/s", minimum=0.1, maximum=2)
        self.addParam("Gait", "walk", ParamTypes.Optional, choices=["walk", "trot"])


class drive(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Drive(), "drive")

    def execute(self):
        return self.success()


Rest = describe("Rest")


@pytest.fixture
def skills(bench):
    return bench.load(drive, primitive(Rest, "rest"))


def request(**values):
    return SkillRequest("Drive", "", {k: Param(k, "", v, ParamTypes.Required) for k, v in values.items()})


def test_request_with_values_inside_limits_is_accepted(skills):
    (node,) = make_nodes([request(Speed=2.0, Gait="trot")], skills.library, skills.wmi)
    assert node.type == "skiros:Drive"


def test_request_is_refused_with_all_values_outside_limits(skills):
    requests = [request(Speed=3.0, Gait="run"), SkillRequest("Drive", "", {"Speed": JsonValues([0])})]
    with pytest.raises(OutOfLimits) as refused:
        make_nodes(requests, skills.library, skills.wmi)
    for problem in ("'Speed': expected 0.1 to 2 m/s, got 3.0", "'Gait': expected one of walk, trot, got 'run'",
                    "'Speed': expected 0.1 to 2 m/s, got 0.0"):  # fmt: skip
        assert problem in str(refused.value)


def test_explanation_of_a_refused_value_has_the_code(skills):
    explanation = explain_refusal([request(Speed=3.0)], skills.library, skills.wmi, -1)
    assert (explanation.stage, explanation.code) == (PARAMETER, OutOfLimits.CODE)


def test_node_with_a_value_outside_limits_fails_with_the_code(skills):
    task = skills.run(skills.node("drive", Speed=9.0, Gait="run"))
    node = task.root.children[0]
    assert (task.root.state, node.progress_code) == (State.Failure, OutOfLimits.CODE)
    assert "'Speed': expected 0.1 to 2 m/s, got 9.0" in node.progress_msg
    assert "'Gait': expected one of walk, trot, got 'run'" in node.progress_msg


def faults(cls, *others):
    return [(fault.code, fault.text) for fault in Linter((cls, *others), None).lint(cls)]


@pytest.mark.parametrize(
    ("value", "limits", "text"),
    [
        (5.0, {"minimum": 0, "maximum": 1}, "a default that it does not allow: expected 0 to 1, got 5.0"),
        (float, {"minimum": 1, "maximum": 0}, "the minimum 1, greater than the maximum 0"),
        (str, {"choices": [1, 2]}, "the choices 1, 2, not of type str"),
        ("fast", {"maximum": 2}, "a minimum or a maximum, but its values are of type str"),
    ],
)
def test_lint_finds_mistakes_in_limits(value, limits, text):
    class Wrong(SkillDescription):
        def createDescription(self):
            self.addParam("Speed", value, ParamTypes.Optional, **limits)

    assert faults(primitive(Wrong, "wrong")) == [("limits", f"parameter 'Speed' has {text}")]


def test_lint_finds_a_specified_value_outside_limits():
    class march(SkillBase):
        def createDescription(self):
            self.setDescription(Rest(), "march")

        def expand(self, skill):
            skill(self.skill("Drive", "drive", specify={"Speed": 9.0, "Gait": "trot"}))

    found = faults(march, drive)
    assert found == [("limits", "specify of 'Speed' for skiros:Drive-drive: expected 0.1 to 2 m/s, got 9.0")]
