"""A request to run skills is checked whole before anything starts."""

import pytest

from skiros2_common.core.errors import Refused, SkirosError, UnknownName, WrongType
from skiros2_common.core.explanation import GIVEN, PARAMETER, START
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


def test_a_request_becomes_nodes_with_its_values_fixed(skills):
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
def test_a_wrong_request_is_refused_by_name(skills, asked, error, named):
    with pytest.raises(error, match=named):
        nodes(skills, *asked)


def test_an_error_in_a_later_skill_refuses_the_whole_request(skills):
    with pytest.raises(SkirosError):
        nodes(skills, request("Note", Text="a"), request("Nte"))


def test_a_required_parameter_may_come_from_an_earlier_skill_of_the_request(skills):
    skills.load(primitive(describe("Produce", [("Text", "made", REQUIRED)]), "produce"))
    assert len(nodes(skills, request("Produce"), request("Note"))) == 2


def test_an_abstract_element_that_says_nothing_is_left_to_inference(skills):
    (node,) = nodes(skills, request("Hold", Object=Element("skiros:Product")))
    skills.run(node)
    assert node.params.getParamValue("Object").id == skills.product.id


def test_an_abstract_element_with_a_label_asks_for_such_a_one(skills):
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


def test_a_skill_that_is_not_there_is_a_refused_start_with_the_values_given(skills):
    explanation = refused(skills, request("Note", Text="a"), request("Nte", Text="b"))
    assert (explanation.stage, explanation.type, explanation.code) == (START, "skiros:Nte", -1)
    assert [(o.key, o.value, o.source) for o in explanation.params] == [("Text", "'b'", GIVEN)]


def test_a_wrong_parameter_names_the_implementation_that_it_does_not_fit(skills):
    explanation = refused(skills, request("Note", Text=5))
    assert (explanation.stage, explanation.label) == (PARAMETER, "note")


def test_each_implementation_that_the_parameters_do_not_fit_is_told(skills):
    skills.load(primitive(Note, "other_note"))
    explanation = refused(skills, request("Note"))
    assert (explanation.stage, explanation.label) == (START, "")
    assert [(tried.stage, tried.label) for tried in explanation.tried] == [
        (PARAMETER, "note"),
        (PARAMETER, "other_note"),
    ]


def test_what_is_not_wrong_by_itself_has_no_explanation(skills):
    assert explain_refusal([request("Note", Text="a")], skills.library, skills.wmi, -1) is None
    assert explain_refusal([], skills.library, skills.wmi, -1) is None
