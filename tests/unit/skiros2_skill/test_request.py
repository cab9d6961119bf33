"""A request to run skills is checked as a whole before a skill starts."""

import pytest

from skiros2_common.core.errors import Refused, SkirosError, UnknownName, WrongType
from skiros2_common.core.explanation import DEFAULT, GIVEN, PARAMETER, START
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.runtime.request import SkillRequest, explain_refusal, make_nodes
from unit.skiros2_skill.skills import OBJECT, REQUIRED, Note, Speak, describe, primitive


@pytest.fixture
def skills(bench):
    return bench.load(primitive(Note, "note"), primitive(Speak, "speak"), primitive(describe("Hold", [OBJECT]), "hold"))


def request(stype, label="", **values):
    return SkillRequest(stype, label, {k: Param(k, "", v, ParamTypes.Required) for k, v in values.items()})


def nodes(bench, *requests):
    return make_nodes(requests, bench.library, bench.wmi)


def test_request_becomes_nodes_with_specified_values(skills):
    task = skills.run(
        *nodes(skills, request("Note", "note", Text="a"), request("skiros:Hold", "", Object=skills.product))
    )
    assert [n.label for n in task.nodes()] == ["task_0", "note", "hold"]
    assert task.root.children[1].params.getParamValue("Object").id == skills.product.id


@pytest.mark.parametrize(
    ("asked", "error", "named"),
    [
        ([], Refused, "a task needs at least one skill"),
        ([request("Nte")], UnknownName, "no skill of type skiros:Nte; near: skiros:Note"),
        ([request("Note", "nope", Text="a")], UnknownName, "has no implementation 'nope'; it has: 'note'"),
        ([request("Note")], Refused, "required parameter 'Text' \\(str\\) is not set"),
        ([request("Note", Text="a", Txt="b")], UnknownName, "has no parameter 'Txt'; it has: Text, Robot"),
        ([request("Note", Text=5)], WrongType, "parameter Text: expected a value of type str, got int 5"),
        (
            [request("Hold", Object=Element("skiros:Product", "", "skiros:Product-999"))],
            UnknownName,
            "skiros:Product-999",
        ),
    ],
)
def test_wrong_request_is_refused(skills, asked, error, named):
    with pytest.raises(error, match=named):
        nodes(skills, *asked)


def test_error_in_a_later_skill_refuses_the_request(skills):
    with pytest.raises(SkirosError):
        nodes(skills, request("Note", Text="a"), request("Nte"))


def test_required_parameter_of_an_earlier_skill_is_accepted(skills):
    skills.load(primitive(describe("Produce", [("Text", "made", REQUIRED)]), "produce"))
    assert len(nodes(skills, request("Produce"), request("Note"))) == 2


def test_unspecific_abstract_element_is_inferred(skills):
    (node,) = nodes(skills, request("Hold", Object=Element("skiros:Product")))
    skills.run(node)
    assert node.params.getParamValue("Object").id == skills.product.id


def test_abstract_element_with_a_label_selects_it(skills):
    (node,) = nodes(skills, request("Hold", Object=Element("skiros:Product", "other product")))
    skills.run(node)
    assert node.params.getParamValue("Object").id == skills.other_product.id


# -- why it is refused -------------------------------------------------------------------------------------------------


def refused(bench, *requests):
    """What `make_nodes` refuses, explained; the message is that of the error."""
    with pytest.raises(SkirosError) as error:
        nodes(bench, *requests)
    explanation = explain_refusal(requests, bench.library, bench.wmi, -1)
    assert explanation.message == str(error.value)
    return explanation


def test_refused_start_of_an_unknown_skill_has_the_given_values(skills):
    explanation = refused(skills, request("Note", Text="a"), request("Nte", Text="b"))
    assert (explanation.stage, explanation.type, explanation.code) == (START, "skiros:Nte", -1)
    assert [(o.key, o.value, o.source) for o in explanation.params] == [("Text", "'b'", GIVEN)]


def test_wrong_parameter_names_the_implementation(skills):
    explanation = refused(skills, request("Note", Text=5))
    assert (explanation.stage, explanation.label) == (PARAMETER, "note")


def test_each_rejected_implementation_is_explained(skills):
    skills.load(primitive(Note, "other_note"))
    explanation = refused(skills, request("Note"))
    assert (explanation.stage, explanation.label) == (START, "")
    assert [(tried.stage, tried.label) for tried in explanation.tried] == [
        (PARAMETER, "note"),
        (PARAMETER, "other_note"),
    ]


def test_valid_request_has_no_explanation(skills):
    assert explain_refusal([request("Note", Text="a")], skills.library, skills.wmi, -1) is None
    assert explain_refusal([], skills.library, skills.wmi, -1) is None


def test_refusal_shows_defaults_that_a_client_sends_again_as_default(bench):
    bench.load(primitive(describe("Say", [("Text", "hello", REQUIRED), ("Times", 2, REQUIRED)]), "say"))
    refused = explain_refusal([request("Say", Text="hello", Times="x")], bench.library, bench.wmi, -1)
    assert {each.key: each.source for each in refused.params} == {"Text": DEFAULT, "Times": GIVEN}
