"""A result is applied: a skill takes its values when it is started for that kind of task, until it is reverted."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_learning.core.evaluation import Evaluation, Repetition
from skiros2_learning.core.parameter_sets import apply_policy, apply_result, remove_set
from skiros2_learning.core.policy_table import PolicyTable, ValidatedPolicy
from skiros2_learning.core.scenario import Scenario, load_scenario, parse_scenario
from skiros2_learning.core.validation import Sample, Validation
from skiros2_skill.core.skill import SkillBase
from skiros2_skill.core.tree.skill_node import SkillWrapper
from skiros2_skill.testing import SkillBench

SCENARIOS = Path(__file__).parents[3] / "skiros2_std_lib/demos/learning/scenarios"
PUSH, INSERTION = load_scenario(SCENARIOS / "push.yaml"), load_scenario(SCENARIOS / "insertion.yaml")
VALUES = {"Push.StartX": -0.01, "Push.StartY": -0.07, "Push.GoalX": 0.01, "Push.GoalY": -0.05}
RESULT = Evaluation(dict(VALUES), 17, {"goal": 1.05, "force": 20.0}, {}, 1.0)


@pytest.fixture
def bench() -> SkillBench:
    bench = SkillBench(PUSH.scene)
    bench.import_libraries(*PUSH.libraries)
    return bench


def test_a_start_without_values_is_refused_until_a_result_is_applied(bench: SkillBench) -> None:
    task = {"Object": bench.element("Block"), "Goal": bench.element("Goal")}
    with pytest.raises(WrongValue, match="required parameter 'StartX'"):
        bench.command("Push", **task)
    (added,) = apply_result(bench.wmi, PUSH, 5, RESULT, "2026-01-01T12:00:00", "/studies/push")
    node = bench.command("Push", **task).skill
    assert {key: node.params[key].value for key in ("StartX", "StartY", "GoalX", "GoalY")} == {
        key.partition(".")[2]: value for key, value in VALUES.items()
    }
    assert added.value_of("skiros:Study") == "/studies/push#5"
    assert added.value_of("skiros:Seed") == 17
    assert added.getProperty("skiros:Reward").values == ["goal=1.05", "force=20"]
    remove_set(bench.wmi, added.id)
    with pytest.raises(WrongValue, match="required parameter 'StartX'"):
        bench.command("Push", **task)


def test_a_set_has_its_validation_as_properties(bench: SkillBench) -> None:
    def judged(is_success: bool) -> Repetition:
        return Repetition({"goal": 0.9, "force": 30.0}, {}, {}, is_success, "", 5.0)

    sample = Sample(5, dict(VALUES), 99, tuple(judged(index < 28) for index in range(30)))
    (added,) = apply_result(bench.wmi, PUSH, 5, RESULT, "2026-01-01T12:00:00", validated=sample)
    found = {
        key: added.value_of(f"skiros:{key}")
        for key in ("Validated", "Successes", "Executions", "SuccessRate", "LowestSuccessRate", "HighestSuccessRate")
    }
    assert found == {
        "Validated": True, "Successes": 28, "Executions": 30, "SuccessRate": pytest.approx(0.933, abs=1e-3),
        "LowestSuccessRate": pytest.approx(0.787, abs=1e-3), "HighestSuccessRate": pytest.approx(0.982, abs=1e-3),
    }  # fmt: skip
    assert added.getProperty("skiros:Reward").values == ["goal=0.9", "force=30"]
    (other,) = apply_result(bench.wmi, PUSH, 6, RESULT, "2026-01-01T12:00:00")
    assert other.value_of("skiros:Validated") is False
    assert not other.hasProperty("skiros:Executions")


def pushes(bench: SkillBench, **values: float) -> SkillWrapper:
    """Starts a push. Returns its node."""
    task = bench.command("Push", Object=bench.element("Block"), Goal=bench.element("Goal"), **values)
    task.tick()
    return task.skill


def place_goal(bench: SkillBench, x: float) -> None:
    goal = bench.element("Goal")
    goal.setProperty("skiros:PositionX", x)
    bench.wmi.update_element_properties(goal)


def policy(scenario: Scenario = PUSH) -> ValidatedPolicy:
    """Three rows over the position of the goal."""
    sample = Sample(None, {}, 99, tuple(Repetition({"goal": 0.9, "force": 30.0}, {}, {}, True, "", 5.0)
                                        for _ in range(30)), "the policy")  # fmt: skip
    rows = ({"goal_x": x} for x in (0.5, 0.58, 0.66))
    values = ({**VALUES, "Push.StartX": x} for x in (-0.01, 0.0, 0.01))
    return ValidatedPolicy(PolicyTable("the policy", tuple(rows), tuple(values)), Validation(90, (), sample, None, ""))


def test_a_start_takes_the_values_of_a_policy_for_the_present_world(bench: SkillBench) -> None:
    (added,) = apply_policy(bench.wmi, PUSH, policy(), "2026-01-01")
    assert (added.value_of("skiros:Successes"), added.value_of("skiros:Executions")) == (30, 30)
    for x, start in ((0.5, -0.01), (0.55, 0.0), (0.65, 0.01)):
        place_goal(bench, x)
        node = pushes(bench)
        assert (node.params["StartX"].value, node.params["GoalY"].value) == (start, -0.05)
        assert "warning" not in node.progress_msg
    assert pushes(bench, StartX=0.04).params["StartX"].value == 0.04
    remove_set(bench.wmi, added.id)
    assert not bench.wmi.resolve_elements(Element("skiros:Feature"))
    with pytest.raises(WrongValue, match="required parameter 'StartX'"):
        pushes(bench)


def test_a_request_outside_of_the_validated_range_is_warned_of(
    bench: SkillBench, caplog: pytest.LogCaptureFixture
) -> None:
    apply_policy(bench.wmi, PUSH, policy(), "2026-01-01")
    place_goal(bench, 0.7)
    text = "Goal.skiros:PositionX is 0.7, outside of the validated range 0.5 to 0.66"
    node = pushes(bench)
    assert text in node.progress_msg
    assert text in caplog.text
    assert node.params["StartX"].value == 0.01


def test_a_policy_of_features_that_a_start_cannot_read_is_refused(bench: SkillBench) -> None:
    text = PUSH.source.replace("element: Goal", "element: Arm")
    scenario = parse_scenario(text, SCENARIOS)
    with pytest.raises(Refused, match="feature goal_x is of 'Arm', which is no parameter of Push"):
        apply_policy(bench.wmi, scenario, policy(), "2026-01-01")


def test_an_older_set_counts_if_the_elements_have_no_such_feature(bench: SkillBench) -> None:
    apply_result(bench.wmi, PUSH, 5, RESULT, "2026-01-01")
    text = PUSH.source.replace("skiros:PositionX", "skiros:MeanColour")
    apply_policy(bench.wmi, parse_scenario(text, SCENARIOS), policy(), "2026-01-01")
    assert pushes(bench).params["StartX"].value == VALUES["Push.StartX"]


def test_given_values_and_newer_sets_come_first(bench: SkillBench) -> None:
    task = {"Object": bench.element("Block"), "Goal": bench.element("Goal")}
    apply_result(bench.wmi, PUSH, 5, RESULT, "2026-01-01T12:00:00")
    newer = Evaluation({**VALUES, "Push.StartX": 0.02}, 18, {"goal": 1.0, "force": 10.0}, {}, 1.0)
    apply_result(bench.wmi, PUSH, 6, newer, "2026-01-02T12:00:00")
    assert bench.command("Push", **task).skill.params["StartX"].value == 0.02
    assert bench.command("Push", **task, StartX=0.03).skill.params["StartX"].value == 0.03


def test_another_kind_of_task_does_not_take_the_values(bench: SkillBench) -> None:
    apply_result(bench.wmi, PUSH, 5, RESULT, "2026-01-01T12:00:00")
    with pytest.raises(WrongValue, match="required parameter 'StartX'"):
        bench.command("Push", Object=bench.add("skiros:Part", "Bolt"), Goal=bench.element("Goal"))


def test_a_broken_result_and_an_unknown_set_are_refused(bench: SkillBench) -> None:
    with pytest.raises(Refused, match="evaluation 3 is broken"):
        apply_result(bench.wmi, PUSH, 3, Evaluation(dict(VALUES), 1, error="crash"), "2026-01-01")
    with pytest.raises(UnknownName, match="there is no parameter set 'skiros:Product-6'; there are: none"):
        remove_set(bench.wmi, "skiros:Product-6")


class Insert(SkillDescription):
    """A task with a search."""

    def createDescription(self) -> None:
        self.addParam("Radius", 0.5, ParamTypes.Optional)  # of something else than the search


class insert(SkillBase):
    """Searches, and searches again with its own force."""

    def createDescription(self) -> None:
        self.setDescription(Insert(), "insert")

    def expand(self, skill) -> None:
        skill(self.skill("SpiralSearch", ""), self.skill("SpiralSearch", "", specify={"Force": 2.0}))


class SpiralSearch(SkillDescription):
    """Has the parameters of the search of an insertion."""

    def createDescription(self) -> None:
        self.addParam("Surface", Element("skiros:Location"), ParamTypes.Inferred)
        for key, default in (("Force", 5.0), ("Radius", 0.005), ("PathVelocity", 0.01), ("PathDistance", 0.001)):
            self.addParam(key, default, ParamTypes.Optional, minimum=0.0, maximum=10.0)
        self.addParam("SearchTime", 15.0, ParamTypes.Optional)


LEARNED = {"Force": 6.5, "Radius": 0.007, "PathVelocity": 0.03, "PathDistance": 0.002}


def searches(bench: SkillBench) -> list[dict[str, float]]:
    """Runs the task. Returns the parameters of both searches."""
    nodes = bench.command("Insert").run().nodes()
    return [{key: node.params[key].value for key in LEARNED} for node in nodes if node.type == "skiros:SpiralSearch"]


@pytest.fixture
def inserting() -> SkillBench:
    bench = SkillBench()
    bench.add("skiros:LargeBox", "Bench")
    bench.load(insert)
    bench.stand_in(SpiralSearch)
    return bench


def learned(**changes: object) -> Evaluation:
    values = {f"SpiralSearch.{key}": value for key, value in {**LEARNED, **changes}.items()}
    return Evaluation(values, 1, {"success": 1.0, "force": 20.0}, {}, 1.0)


def test_a_skill_inside_of_a_compound_takes_learned_values_in_place_of_defaults(inserting: SkillBench) -> None:
    before = searches(inserting)
    assert before[0]["Force"] == 5.0
    (added,) = apply_result(inserting.wmi, INSERTION, 3, learned(), "2026-01-01")
    assert searches(inserting) == [LEARNED, {**LEARNED, "Force": 2.0}]  # what the tree specifies stays
    remove_set(inserting.wmi, added.id)
    assert searches(inserting) == before


def test_a_skill_inside_of_a_compound_takes_values_for_its_kind_of_task_only(inserting: SkillBench) -> None:
    (added,) = apply_result(inserting.wmi, INSERTION, 3, learned(), "2026-01-01")
    for kind, force in (("skiros:Product", 5.0), ("skiros:Container", 6.5)):
        added.setProperty("skiros:AppliesTo", [f"Surface={kind}"])
        inserting.wmi.update_element_properties(added)
        assert searches(inserting)[0]["Force"] == force, kind


def test_a_learned_value_that_the_skill_does_not_allow_fails_it_with_the_reason(inserting: SkillBench) -> None:
    apply_result(inserting.wmi, INSERTION, 3, learned(Force=50.0), "2026-01-01T12:00:00")
    task = inserting.command("Insert").run()
    assert "parameter 'Force': expected 0 to 10, got 50" in task.why
