"""The samplers of other libraries, which `make test-long` installs. Fixed seeds: always the same result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import optuna
import pytest
from optuna.samplers import BaseSampler, RandomSampler
from optuna.trial import Trial

from skiros2_learning.core.evaluation import evaluate
from skiros2_learning.core.samplers import make_sampler
from skiros2_learning.core.scenario import parse_scenario
from skiros2_learning.core.study import LearningStudy
from support.known_functions import BRANIN_MINIMUM, branin, dominated_area, zdt1
from support.learning_scenarios import scenario_text

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]
WITH_PRIORS = pytest.mark.parametrize("optimiser", ["botorch", "smac"])


def sampler(optimiser: str, initial: int = 6, prior: Sequence[float] = ()) -> BaseSampler:
    """The sampler of a scenario with the variables of Branin's function.

    :param prior: means of x and y.
    """
    text = scenario_text("branin", "chance", "xy", evaluations=30, initial=initial, optimiser=optimiser)
    for i, (name, limits) in enumerate((("x", "[-5, 10]"), ("y", "[0, 15]"))):
        belief = f", prior: {{mean: {prior[i]}, std: 0.5}}" if prior else ""
        text = text.replace(f"{name}: {{type: real, range: [0, 1]", f"{name}: {{type: real, range: {limits}{belief}")
    return make_sampler(parse_scenario(text, Path()))


def minimum(made: BaseSampler, count: int) -> float:
    study = optuna.create_study(sampler=made)
    study.optimize(branin, n_trials=count)
    return study.best_value


@WITH_PRIORS
def test_branin_is_minimised(optimiser: str) -> None:
    assert minimum(sampler(optimiser), 20) == pytest.approx(BRANIN_MINIMUM, abs=0.2)


@WITH_PRIORS
def test_a_good_prior_saves_evaluations(optimiser: str) -> None:
    with_prior = minimum(sampler(optimiser, 3, (3.5, 2.6)), 8)
    assert with_prior == pytest.approx(BRANIN_MINIMUM, abs=0.4)
    assert with_prior < minimum(sampler(optimiser, 3), 8)


@WITH_PRIORS
def test_two_objectives_give_a_wide_front(optimiser: str) -> None:
    areas = []
    for made in (sampler(optimiser), RandomSampler(seed=3)):
        study = optuna.create_study(directions=["minimize", "minimize"], sampler=made)
        study.optimize(zdt1, n_trials=18)
        areas.append(dominated_area([tuple(trial.values) for trial in study.best_trials]))
    assert areas[0] > areas[1] + 0.5


@WITH_PRIORS
def test_constraints_and_choices_are_respected(optimiser: str) -> None:
    def cost(trial: Trial) -> float:
        x, y = trial.suggest_float("x", 0.0, 1.0), trial.suggest_float("y", 0.0, 1.0)
        gait = {"walk": 0.0, "trot": 1.0, "crawl": 2.0}[trial.suggest_categorical("gait", ["crawl", "walk", "trot"])]
        trial.set_constraint("sum", 0.8 - x - y)
        return x + 2.0 * y + gait

    study = optuna.create_study(sampler=sampler(optimiser))
    study.optimize(cost, n_trials=18)
    assert study.best_trial.constraints["sum"] <= 0.0
    assert study.best_value == pytest.approx(0.8, abs=0.2)


@WITH_PRIORS
def test_a_study_continues_after_all_choices_were_tried(optimiser: str) -> None:
    study = optuna.create_study(sampler=sampler(optimiser, 3))
    costs = {"walk": 1.0, "trot": 2.0, "crawl": 0.0, "jump": 4.0}
    study.optimize(lambda trial: costs[trial.suggest_categorical("gait", list(costs))], n_trials=7)
    assert {trial.params["gait"] for trial in study.trials} == set(costs)
    assert len(study.trials) == 7


@WITH_PRIORS
def test_an_interrupted_study_continues_as_it_would_have(optimiser: str, tmp_path: Path) -> None:
    text = scenario_text("chance", "chance", evaluations=6, initial=3, optimiser=optimiser)
    found = []
    for name, opened in (("whole", 1), ("parts", 2)):
        study = LearningStudy.create(parse_scenario(text, tmp_path), tmp_path / name)
        for part in range(opened):
            for _ in range(6 // opened):
                number, configuration, seed = study.ask()
                study.tell(number, evaluate(study.scenario, configuration, seed))
            if part + 1 < opened:
                study = LearningStudy.open(tmp_path / name)
        found.append({number: each.configuration for number, each in study.results().items()})
    assert found[0] == found[1]


@pytest.mark.parametrize(("optimiser", "count"), [("botorch", 20), ("smac", 20), ("optuna-gp", 20), ("cmaes", 80)])
def test_a_study_finds_the_best_value(optimiser: str, count: int, tmp_path: Path) -> None:
    text = scenario_text("bowl", "bowl", "xyz", evaluations=count, initial=8, repetitions=1, optimiser=optimiser,
                         settings="{best: {x: 0.2, y: 0.7, z: 0.5}}")  # fmt: skip
    study = LearningStudy.create(parse_scenario(text, tmp_path), tmp_path / "study")
    for _ in range(count):
        number, configuration, seed = study.ask()
        study.tell(number, evaluate(study.scenario, configuration, seed))
    assert study.result(study.ranked()[0]).objectives["cost"] < 0.02
