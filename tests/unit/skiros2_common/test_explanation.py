"""Explanations of failures, as text and as JSON."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.explanation import (
    STAGES,
    Change,
    Explanation,
    FilterStep,
    Finding,
    InferenceFailure,
    NearMatch,
    Provenance,
)

EXAMPLE = Explanation(
    stage="pre",
    type="skiros:Pick",
    label="pick_fast",
    node=3,
    code=-1,
    message="Pre-condition failed: [At] ...",
    path=["transport", "pick_fast"],
    findings=[
        Finding(
            kind="ConditionRelation",
            label="At",
            values={"Object": "skiros:Part-12-PartA"},
            expected="skiros:Part-12-PartA skiros:at skiros:Table-5",
            found="skiros:Part-12-PartA skiros:at skiros:Table-3",
            nearest=[NearMatch("skiros:Part-9", "skiros:at skiros:Table-5")],
            changes=[Change("skiros:Part-12", "skiros:at", 40, 1000.0, "/robot_2")],
            parts=[Finding("ConditionProperty", "Idle", {}, "idle", "busy")],
        )
    ],
    candidates=[
        InferenceFailure("Gripper", "skiros:Gripper", 2, [FilterStep("with skiros:State = 'Idle'", 0, "Free")])
    ],
    params=[Provenance("Object", "skiros:Part-12-PartA", "above", ["look"]), Provenance("Gripper", "", "unset")],
    tried=[Explanation("start", "skiros:Pick", "pick_slow", -1, -1, "busy")],
    stamp=1001.5,
    times=4,
    labels={"skiros:Part-12": "PartA"},
)

names = st.text(max_size=8)
numbers = st.integers(-(2**31), 2**31)
stamps = st.floats(0, 1e10)
nears = st.lists(st.builds(NearMatch, names, names), max_size=2)
changes = st.lists(st.builds(Change, names, names, numbers, stamps, names), max_size=2)
findings = st.recursive(
    st.builds(Finding, names, names, st.dictionaries(names, names, max_size=2), names, names, nears, changes),
    lambda parts: st.builds(Finding, names, names, st.just({}), names, names, parts=st.lists(parts, max_size=2)),
    max_leaves=3,
)
left = st.lists(st.builds(FilterStep, names, numbers, names), max_size=2)
explanations = st.builds(
    Explanation,
    stage=st.sampled_from(STAGES),
    type=names,
    label=names,
    node=numbers,
    code=numbers,
    message=names,
    path=st.lists(names, max_size=2),
    findings=st.lists(findings, max_size=2),
    candidates=st.lists(st.builds(InferenceFailure, names, names, numbers, left, nears), max_size=2),
    params=st.lists(st.builds(Provenance, names, names, names, st.lists(names, max_size=2)), max_size=2),
    stamp=stamps,
    times=numbers,
)


@given(explanations)
def test_explanation_round_trips_through_json(explanation):
    assert Explanation.from_json(explanation.to_json()) == explanation


def test_full_example_round_trips_through_json():
    assert Explanation.from_json(EXAMPLE.to_json()) == EXAMPLE


def test_text_has_expected_and_found_state_changes_and_provenance():
    text = str(EXAMPLE)
    for part in (
        "pick_fast (in transport) did not start: PartA is at Table-3: robot_2 changed it at ",
        "transport > pick_fast failed at ",
        "(pre, code -1, 4 times)",
        "[At] PartA is at Table-3, expected PartA is at Table-5",
        "nearest: Part-9: is at Table-5",
        "PartA is at was last changed at ",
        "by /robot_2",
        "parameter 'Gripper': 2 gripper in the scene, none with state = 'Idle' [Free]",
        "parameter Object = PartA (from look)",
        "parameter Gripper is unset",
        "skiros:Pick-pick_slow failed at ",
    ):
        assert part in text


def test_all_changes_includes_rejected_implementations():
    outer = Explanation("start", "skiros:Pick", "", -1, -1, "", tried=[EXAMPLE])
    assert [c.author for c in outer.all_changes()] == ["/robot_2"]


@pytest.mark.parametrize(
    ("text", "error", "named"),
    [
        ("{", WrongValue, "explanation: "),
        ("[" * 5000, WrongValue, "nested too deeply"),
        ("[]", WrongType, "explanation: expected a dict, got list"),
        ("{}", WrongValue, "missing"),
        ('{"stage": 5}', WrongType, "explanation.stage: expected a str, got int"),
        ('{"node": true}', WrongType, "explanation.node: expected a int, got bool"),
        ('{"spam": 5}', WrongValue, "Explanation has no field spam"),
        (json.dumps({"findings": [{"values": {"A": 1}}]}), WrongType, r"explanation.findings\[0\].values.A"),
    ],
)
def test_json_of_wrong_form_is_rejected_with_the_field_name(text, error, named):
    with pytest.raises(error, match=named):
        Explanation.from_json(text)
