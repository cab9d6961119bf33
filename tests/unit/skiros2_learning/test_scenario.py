"""Scenario files: what they say, and what is wrong with them, all at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_learning.core.rewards import GoalDistance, ObstacleDistance
from skiros2_learning.core.scenario import ScenarioError, load_scenario, parse_scenario
from skiros2_learning.core.variables import Gaussian, Weights, configuration_problems

PUSH = Path(__file__).parents[3] / "skiros2_std_lib/demos/learning/scenarios/push.yaml"

PLAIN = """
scenario: plain
execution: support.learning_tasks:parabola
variables:
  x: {type: real, range: [0, 1], prior: {mean: 0.4, std: 0.1}}
  n: {type: integer, range: [1, 5]}
  size: {type: ordinal, values: [1, 2, 4], prior: {mean: 2, std: 1}}
  gait: {type: categorical, values: [walk, trot], prior: {weights: [3, 1]}}
objectives:
  cost: {sense: minimise, rewards: [{reward: signal, series: value}]}
"""


def problems(text: str) -> tuple[str, ...]:
    with pytest.raises(ScenarioError) as found:
        parse_scenario(text, Path("/"))
    return found.value.problems


def test_the_scenario_of_the_push_is_read() -> None:
    push = load_scenario(PUSH)
    assert [variable.name for variable in push.variables] == ["Push.StartX", "Push.StartY", "Push.GoalX", "Push.GoalY"]
    assert push.variables[0].prior == Gaussian(-0.01, 0.03)
    assert push.scene.is_file()
    goal, clear = (part.reward for part in push.objectives[0].rewards)
    assert goal == GoalDistance("Block", "Goal", 0.2)
    assert clear == ObstacleDistance("Block", ("Obstacle 1", "Obstacle 2"), 0.05)
    assert [objective.sense for objective in push.objectives] == ["maximise", "minimise"]


def test_all_types_of_variables_and_priors_are_read() -> None:
    x, n, size, gait = parse_scenario(PLAIN, Path("/")).variables
    assert (x.kind, x.low, x.high, x.prior) == ("real", 0.0, 1.0, Gaussian(0.4, 0.1))
    assert (n.kind, n.low, n.high, n.prior) == ("integer", 1.0, 5.0, None)
    assert (size.values, size.prior) == ((1, 2, 4), Gaussian(2.0, 1.0))
    assert (gait.values, gait.prior) == (("walk", "trot"), Weights((0.75, 0.25)))


def test_a_file_that_is_missing_or_no_yaml_is_reported_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"nowhere\.yaml: No such file"):
        load_scenario(tmp_path / "nowhere.yaml")
    assert "\n" not in problems("a: [")[0]
    growing = "\n".join(["a0: &a0 [x]", *(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12))])
    assert "stands for more than" in problems(growing)[0]


def test_all_mistakes_are_reported_at_once() -> None:
    found = problems(
        """
        scenario: bad
        execution: support.learning_tasks:parabola
        variabels: {}
        variables:
          x: {type: real, range: [1, 0], prior: {mean: 7, std: 0}}
          y: {type: reel, range: [0, .inf]}
          z: {type: categorical, values: [a]}
        objectives:
          cost: {sense: minimize, rewards: [{reward: goal_distanse}]}
          other: {rewards: [{reward: goal_distance, object: A, goal: B, width: -1, weigth: 2}]}
        budget: {evaluations: 0, initial: 3}
        repetitions: many
        success: [{reward: success, at_msot: 1}]
        """
    )
    text = "\n".join(found)
    for expected in (
        "line 4: variabels: unknown key; near: variables",
        "line 6: variables.x.range: expected the lower bound first, got [1, 0]",
        "line 6: variables.x.prior.mean: expected 0 to 1, the range of the variable, got 7",
        "variables.x.prior.std: expected more than 0, got 0",
        "variables.y.type: unknown: 'reel'; near: real",
        "variables.y.range: expected a finite number, got inf",
        "variables.z.values: expected at least two, got 1",
        "objectives.cost.sense: unknown: 'minimize'; near: minimise",
        "objectives.cost.rewards[0].reward: unknown: 'goal_distanse'; near: goal_distance",
        "line 11: objectives.other.rewards[0].width: expected more than 0, got -1",
        "objectives.other.rewards[0].weigth: unknown key; near: weight",
        "budget.evaluations: expected at least 1, got 0",
        "repetitions: expected an integer, got 'many'",
        "success[0]: expected at_least or at_most",
        "line 14: success[0].at_msot: unknown key; near: at_most",
    ):
        assert expected in text
    lines = [int(each.split()[1].rstrip(":")) for each in found]
    assert lines == sorted(lines)


def test_values_that_contradict_each_other_are_refused() -> None:
    criterion = "success: [{reward: signal, series: value, at_least: 2, at_most: 1}]\n"
    found = problems(f"{PLAIN}repetitions: 3\nmax_failures: 4\n{criterion}")
    assert sorted(found) == [
        "line 12: max_failures: expected at most 3, the repetitions, got 4",
        "line 13: success[0].at_least: expected at most 1, as at_most, got 2",
    ]
    few = parse_scenario(f"{PLAIN}repetitions: 4\nmax_failures: 3\n", Path("/")).derived(repetitions=2)
    assert (few.repetitions, few.max_failures) == (2, 2)
    twice = ("line 12: seed: the key occurs twice", "line 13: sede: unknown key; near: seed, scene")
    assert problems(f"{PLAIN}seed: 1\nseed: 2\nsede: 3\n") == twice
    text = PUSH.read_text().replace("../scene", str(PUSH.parent / "../scene"))
    fixed = text.replace("{Object: Block,", "{StartX: 0.1, Object: Block,")
    expected = "line 13: variables.Push.StartX: a variable, and fixed in the task: expected one of them"
    assert problems(fixed) == (expected,)


def test_scales_and_constraints_between_variables_are_read_and_checked() -> None:
    text = PLAIN.replace("n: {type: integer, range: [1, 5]}", "n: {type: integer, range: [1, 400], scale: log}")
    plan = parse_scenario(f"{text}restrictions: [{{sum: {{x: 1, size: -0.25}}, at_most: 0}}]\n", Path("/"))
    assert plan.variables[1].typical == 20
    assert plan.allows({"x": 0.5, "n": 2, "size": 2, "gait": "trot"})
    assert not plan.allows({"x": 0.6, "n": 2, "size": 2, "gait": "trot"})
    found = problems(
        PLAIN.replace("range: [0, 1]", "range: [0, 1], scale: log")
        + "restrictions: [{sum: {siez: 1}, at_most: 0}, {sum: {gait: 1}, at_most: 0}, {sum: {x: 1}}]\n"
    )
    assert sorted(found) == [
        "line 11: restrictions[2]: expected at_least or at_most",
        "line 5: variables.x.scale: expected log only for a range above 0",
    ]
    (first, second) = problems(f"{PLAIN}restrictions: [{{sum: {{siez: 1, gait: 1}}, at_most: 0}}]\n")
    expected = "expected a variable that is a number, and always there"
    assert first == f"line 11: restrictions[0].sum.siez: {expected}; near: size"
    assert second.startswith(f"line 11: restrictions[0].sum.gait: {expected}; there are: n, size, x")
    never = "restrictions: [{sum: {x: 1, size: 1}, at_most: 0.5}]\n"
    assert problems(PLAIN + never) == ("line 11: restrictions[0]: no values of the variables satisfy it",)


def test_a_variable_must_belong_to_a_step_of_the_task() -> None:
    text = PUSH.read_text().replace("  Push.StartX", "  Pull.StartX").replace("../scene", str(PUSH.parent / "../scene"))
    assert problems(text) == ("line 13: variables.Pull.StartX: expected STEP.PARAMETER with a step of the task: Push",)


def test_a_configuration_is_checked_as_a_whole() -> None:
    variables = parse_scenario(PLAIN, Path("/")).variables
    assert configuration_problems(variables, {"x": 0.5, "n": 2, "size": 4, "gait": "trot"}) == []
    found = configuration_problems(variables, {"x": 1.5, "n": 2.5, "gait": "gallop", "speed": 1})
    assert found == [
        "speed: not a variable of the scenario",
        "x: expected 0 to 1, got 1.5",
        "n: expected 1 to 5, got 2.5",
        "size: no value",
        "gait: expected one of walk, trot, got 'gallop'",
    ]
