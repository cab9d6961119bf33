"""A result is applied: a skill takes its values when it is started for that kind of task, until they are taken back."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_learning.core.evaluation import Evaluation
from skiros2_learning.core.parameter_sets import apply_result, remove_set
from skiros2_learning.core.scenario import load_scenario
from skiros2_skill.testing import SkillBench

PUSH = load_scenario(Path(__file__).parents[3] / "skiros2_std_lib/skiros2_learning/scenarios/push.yaml")
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
