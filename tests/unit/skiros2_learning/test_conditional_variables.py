"""Variables that exist only with values of others: scenario, samplers, study, report and the applied set."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skiros2_common.core.errors import ConfigurationError, Refused, WrongValue
from skiros2_learning.core.evaluation import evaluate
from skiros2_learning.core.parameter_sets import apply_result
from skiros2_learning.core.policy import learn_variations
from skiros2_learning.core.report import status_lines, write_report
from skiros2_learning.core.samplers import conditions_of, distribution_of
from skiros2_learning.core.scenario import Scenario, ScenarioError, load_scenario, parse_scenario
from skiros2_learning.core.search_space import SearchSpace
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import repeat_here, validate
from skiros2_learning.core.variables import configuration_problems
from skiros2_learning.core.workers import OneByOne
from skiros2_learning.local.episode import check_scenario
from skiros2_skill.core.engine.learned_parameters import learned_values
from skiros2_skill.testing import SkillBench
from support.learning_scenarios import scenario_text
from support.learning_tasks import branches

PUSH = Path(__file__).parents[3] / "skiros2_std_lib/demos/learning/scenarios/push.yaml"
TEXT = scenario_text("branches", "branches", evaluations=30, initial=8).replace(
    "variables:\n  x: {type: real, range: [0, 1]}\n",
    """variables:
  gait: {type: categorical, values: [walk, trot]}
  x: {type: real, range: [0, 1]}
  y: {type: real, range: [0, 1], only_if: {gait: trot}}
  turns: {type: ordinal, values: [1, 2, 3], only_if: {gait: [trot]}}
  z: {type: integer, range: [1, 9], only_if: {turns: [2, 3]}}
""",
)


def scenario(text: str = TEXT) -> Scenario:
    return parse_scenario(text, Path())


def fits(configuration: dict[str, object]) -> bool:
    expected = {"gait", "x"}
    if configuration["gait"] == "trot":
        expected |= {"y", "turns"} | ({"z"} if configuration["turns"] != 1 else set())
    return configuration.keys() == expected


@pytest.mark.parametrize(
    "optimiser",
    [
        "prior",
        "tpe",
        "nsga2",
        "random",
        "qmc",
        *(pytest.param(each, marks=[pytest.mark.long, pytest.mark.timeout(900)]) for each in ("botorch", "smac")),
    ],
)
def test_a_sampler_proposes_the_variables_that_exist_and_finds_the_better_branch(
    tmp_path: Path, optimiser: str
) -> None:
    study = LearningStudy.create(scenario(TEXT + f"optimiser: {optimiser}\n"), tmp_path / "study")
    OneByOne(study, branches, lambda number, result: None).run()
    results = study.results()
    assert len(results) == 30
    assert all(fits(each.configuration) for each in results.values())
    assert {each.configuration["gait"] for each in results.values()} == {"walk", "trot"}
    best = results[study.ranked()[0]]
    assert best.configuration["gait"] == "trot"
    if optimiser == "prior":
        assert best.objectives["cost"] < 0.02


def test_points_are_alike_where_a_variable_does_not_exist() -> None:
    plan = scenario()
    distributions = {each.name: distribution_of(each) for each in plan.variables}
    space = SearchSpace(distributions, {}, conditions_of(plan))
    points = space.uniform(500, np.random.default_rng(1))
    drawn = [(space.values(point), point) for point in points]
    walks = [point for values, point in drawn if values["gait"] == "walk"]
    once = [point for values, point in drawn if values["gait"] == "trot" and values["turns"] == 1]
    order = sorted(distributions)
    for name in ("y", "turns", "z"):
        assert len({point[order.index(name)] for point in walks}) == 1
    assert len({point[order.index("z")] for point in once}) == 1
    assert len({point[order.index("y")] for point in once}) == len(once) > 20


def test_an_interrupted_evaluation_keeps_its_variables(tmp_path: Path) -> None:
    study = LearningStudy.create(scenario(), tmp_path / "study")
    asked = [study.ask() for _ in range(4)]
    again = LearningStudy.open(study.folder)
    assert again.requeue_interrupted() == 4
    assert [again.ask() for _ in range(4)] == asked
    assert again.ask()[0] == 4


def test_configurations_that_do_not_fit_are_reported() -> None:
    variables = scenario().variables
    assert configuration_problems(variables, {"gait": "walk", "x": 0.1}) == []
    assert configuration_problems(variables, {"gait": "walk", "x": 0.1, "y": 0.2}) == ["y: only if gait is trot"]
    assert configuration_problems(variables, {"gait": "trot", "x": 0.1, "y": 0.2}) == ["turns: no value"]
    with pytest.raises(WrongValue, match=r"^z: only if turns is 2 or 3$"):
        evaluate(scenario(), {"gait": "walk", "x": 0.1, "z": 2}, 1)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("only_if: {gait: trot}", "only_if: {gate: trot}"),
         "variables.y.only_if.gate: expected a variable above this one that has values; near: gait"),
        (("only_if: {gait: trot}", "only_if: {z: 3}"),
         "variables.y.only_if.z: expected a variable above this one that has values; there are: gait"),
        (("only_if: {gait: trot}", "only_if: {gait: run}"),
         "variables.y.only_if.gait: gait: expected one of walk, trot, got 'run'"),
        (("only_if: {gait: trot}", "only_if: {x: 0.5}"), "variables.y.only_if.x: expected a variable above"),
        (("seed:", "restrictions: [{sum: {x: 1, y: 1}, at_most: 1}]\nseed:"),
         "restrictions[0].sum.y: expected a variable that is a number, and always there"),
    ],
)  # fmt: skip
def test_conditions_that_cannot_hold_are_refused(change: tuple[str, str], problem: str) -> None:
    with pytest.raises(ScenarioError) as found:
        scenario(TEXT.replace(*change))
    assert problem in str(found.value)


def test_report_status_and_validation_have_what_exists(tmp_path: Path) -> None:
    study = LearningStudy.create(scenario().derived(evaluations=16), tmp_path / "study")
    OneByOne(study, branches, lambda number, result: None).run()
    found = validate(study, repeat_here())
    assert fits(found.learned.configuration)
    text = write_report(study).read_text()
    assert "Parameters and results" in text
    assert "gait=trot" in "\n".join(status_lines(study))


def test_a_skill_that_requires_a_value_is_refused_a_conditional_variable() -> None:
    text = PUSH.read_text().replace(
        "  Push.GoalX:\n    {type: real,", "  Push.Slow: {type: categorical, values: [a, b]}\n"
        "  Push.GoalX:\n    {type: real, only_if: {Push.Slow: a},"
    )  # fmt: skip
    with pytest.raises(ConfigurationError, match=r"Push\.GoalX: exists not always, but the skill requires a value"):
        check_scenario(parse_scenario(text, PUSH.parent))


def test_an_applied_set_has_the_variables_that_exist() -> None:
    text = TEXT.replace("execution:", "task: [{skill: Dig}]\nexecution:")
    for name in ("gait", "x", "y", "turns", "z"):
        text = text.replace(f"  {name}: {{type", f"  Dig.{name}: {{type").replace(f"{{{name}:", f"{{Dig.{name}:")
    plan = scenario(text)
    bench = SkillBench(load_scenario(PUSH).scene)
    values = {"Dig.gait": "walk", "Dig.x": 0.5}
    result = evaluate(plan, values, 1, lambda *_: branches(plan, {"gait": "walk", "x": 0.5}, 1, 0))
    apply_result(bench.wmi, plan, 1, result, "2026-01-01")
    assert learned_values("Dig", {}, bench.wmi).values == {"gait": ["walk"], "x": [0.5]}


def test_policies_are_refused(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="policies need variables that always exist; conditional: y, turns, z"):
        learn_variations(scenario(TEXT + "variations: {f: {range: [0, 1]}}\n"), tmp_path, 2, print)
