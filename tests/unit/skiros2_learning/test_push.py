"""The push, in physics: the same code as in production, in one process."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_learning.core.evaluation import evaluate, find_defaults, find_quantities
from skiros2_learning.core.objectives import Criterion
from skiros2_learning.core.rewards import Distance
from skiros2_learning.core.scenario import Scenario, Step, load_scenario
from skiros2_learning.core.variables import Variable
from skiros2_learning.local.episode import check_scenario

PUSH = Path(__file__).parents[3] / "skiros2_std_lib/demos/learning/scenarios/push.yaml"
GOOD = {"Push.StartX": -0.005, "Push.StartY": -0.07, "Push.GoalX": 0.01, "Push.GoalY": -0.045}


@pytest.fixture
def push() -> Scenario:
    return dataclasses.replace(load_scenario(PUSH), repetitions=1)


def test_the_randomised_quantities_are_those_of_the_scene_and_required_parameters_have_no_defaults(
    push: Scenario,
) -> None:
    found = {each.name: each.centre for each in find_quantities(push)}
    names = [f"Block: {each}" for each in ("x", "y", "yaw", "mass", "friction")]
    assert list(found) == [*names, "start posture"]
    assert found["Block: x"].endswith(" m")
    assert find_defaults(push) == {}


def test_a_good_configuration_brings_the_block_to_the_goal(push: Scenario) -> None:
    result = evaluate(push, GOOD, 1)
    assert not result.error
    assert result.success_rate == 1.0, result
    assert result.repetitions[0].rewards["goal.goal_distance"] > 0.95


def test_an_execution_is_the_same_bit_for_bit_and_differs_with_the_seed(push: Scenario) -> None:
    first = evaluate(push, GOOD, 1)
    assert first == evaluate(push, GOOD, 1)
    assert first != evaluate(push, GOOD, 2)


def test_a_push_from_the_wrong_side_leaves_the_block_and_says_why(push: Scenario) -> None:
    result = evaluate(push, {**GOOD, "Push.StartX": 0.0, "Push.StartY": 0.0}, 1)
    assert result.success_rate == 0.0
    assert "Moving the tool beside Block failed: felt" in result.repetitions[0].reason


def test_a_task_that_takes_too_long_is_ended(push: Scenario) -> None:
    short = dataclasses.replace(push, simulation=dataclasses.replace(push.simulation, time_limit=1.0))
    result = evaluate(short, GOOD, 1)
    assert result.repetitions[0].reason == "not finished after 1 s"


def test_the_scenario_fits_scene_and_skills(push: Scenario) -> None:
    check_scenario(push)


def test_all_names_and_ranges_that_do_not_fit_are_reported(push: Scenario) -> None:
    variables = (Variable("Push.StartX", "real", (-0.5, 0.5)), Variable("Push.StartZ", "real", (0.0, 1.0)))
    wrong = dataclasses.replace(push, variables=variables, task=(Step("Push", "Push", "", {"Object": "Blok"}),))
    with pytest.raises(ConfigurationError) as found:
        check_scenario(wrong)
    for text in (
        "Push.StartX: the skill allows other values: expected -0.2 to 0.2 m, got -0.5, 0.5",
        "Push has no parameter 'StartZ'; near: Start",
        "Push.Object: no element is labelled 'Blok'; near: Block",
        "Push.StartY: missing; the skill requires a value: fix it in the task, or make it a variable",
    ):
        assert text in str(found.value)


def test_a_reward_of_something_that_is_not_there_is_reported(push: Scenario) -> None:
    wrong = dataclasses.replace(push, success=(Criterion("near", Distance("Block", "Gaol"), at_most=0.1),))
    with pytest.raises(ConfigurationError, match="nothing with a pose is labelled 'Gaol'; near: Goal"):
        check_scenario(wrong)
