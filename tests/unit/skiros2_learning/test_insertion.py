"""The insertion as an execution of a scenario, in physics."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_learning.core.evaluation import Evaluation, check_execution, evaluate, find_defaults, find_quantities
from skiros2_learning.core.objectives import Criterion
from skiros2_learning.core.platforms import Simulation
from skiros2_learning.core.randomisation import BodySpread, Randomisation
from skiros2_learning.core.rewards import Distance, Relation, Signal
from skiros2_learning.core.scenario import Scenario, Step, load_scenario
from skiros2_learning.core.variables import Value, Variable, configuration_problems
from skiros2_learning.local.insertion import default_configuration

pytestmark = pytest.mark.timeout(300)

FILE = Path(__file__).parents[3] / "skiros2_std_lib/demos/learning/scenarios/insertion.yaml"


def configuration(force: float, radius: float, velocity: float, distance: float) -> dict[str, Value]:
    keys = ("Force", "Radius", "PathVelocity", "PathDistance")
    return {f"SpiralSearch.{key}": value for key, value in zip(keys, (force, radius, velocity, distance), strict=True)}


GOOD = configuration(7.0, 0.0053, 0.026, 0.0031)


@pytest.fixture
def insertion() -> Scenario:
    return dataclasses.replace(load_scenario(FILE), repetitions=1)


@pytest.fixture(scope="module")
def good() -> Evaluation:
    return evaluate(dataclasses.replace(load_scenario(FILE), repetitions=1), GOOD, 1)


def test_defaults_and_randomised_quantities_are_found(insertion: Scenario) -> None:
    assert find_defaults(insertion).keys() == GOOD.keys()
    bore = {each.name: each.spread for each in find_quantities(insertion)}
    assert bore["position of the bore"] == "off by 0.002 to 0.004 m, in any direction"
    assert bore["sensor: force"] == "standard deviation 0.1 N"


@pytest.mark.long
def test_a_good_search_finds_the_bore_in_spite_of_the_error_of_its_pose(good: Evaluation) -> None:
    assert not good.error
    assert good.success_rate == 1.0, good.repetitions[0].reason
    assert 10.0 < good.objectives["force"] < 48.0


@pytest.mark.long
def test_an_insertion_is_the_same_bit_for_bit_and_differs_with_the_seed(insertion: Scenario) -> None:
    short = dataclasses.replace(insertion, simulation=Simulation(time_limit=1.0))
    first, second, other = (evaluate(short, GOOD, seed) for seed in (1, 1, 2))
    assert first == second
    assert first != other


@pytest.mark.long
@pytest.mark.parametrize("zero", ["Force", "Radius", "PathVelocity", "PathDistance"])
def test_a_search_without_force_or_motion_is_a_bad_result_after_one_failure(insertion: Scenario, zero: str) -> None:
    wanted = dataclasses.replace(insertion, repetitions=4, simulation=Simulation(time_limit=6.5))
    result = evaluate(wanted, {**GOOD, f"SpiralSearch.{zero}": 0.0}, 3)
    assert not result.error
    assert result.success_rate == 0.0
    assert len(result.repetitions) == wanted.max_failures == 1


def test_the_scenario_fits_the_skills_which_have_defaults_for_its_variables(insertion: Scenario) -> None:
    check_execution(insertion)
    assert not configuration_problems(insertion.variables, default_configuration(insertion))


def test_all_that_does_not_fit_is_reported(insertion: Scenario) -> None:
    wrong = dataclasses.replace(
        insertion,
        task=(Step("SpiralSearch", "SpiralSearch", "spiral_search", {"SearchTim": 5.0}),),
        variables=(Variable("SpiralSearch.Force", "real", (0.0, 50.0)), Variable("Search.Radius", "real", (0.0, 0.01))),
        success=(Criterion("deep", Signal("dept"), 0.05), Criterion("near", Distance("Piston", "Bore 2"), 0.0, 0.1)),
        constraints=(Criterion("in", Relation("Piston", "skiros:at", "Bore"), 1.0),),
        randomisation=Randomisation({"Piston": BodySpread(0.1)}),
    )
    with pytest.raises(ConfigurationError) as found:
        check_execution(wrong)
    for text in (
        "SpiralSearch has no parameter 'SearchTim'; near: SearchTime",
        "SpiralSearch.Force: the skill allows other values: expected 0 to 30 N",
        "Search.Radius: no step is called 'Search'",
        "no series 'dept' is recorded; near: depth",
        "does not record the pose of 'Piston'",
        "rewards: the insertion has no world model",
        "randomisation: the insertion has only `sensor`",
    ):
        assert text in str(found.value)


def test_settings_with_mistakes_are_reported(insertion: Scenario) -> None:
    wrong = dataclasses.replace(insertion, settings={"position_eror": 0.1, "least_angle_error": 1.0})
    with pytest.raises(ConfigurationError) as found:
        check_execution(wrong)
    assert "settings.position_eror: unknown key; near: " in str(found.value)
    assert "settings.angle_error: expected at least that of least_angle_error" in str(found.value)
