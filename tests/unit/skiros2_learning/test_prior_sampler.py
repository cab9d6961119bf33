"""The sampler with priors, on functions with known optima, beside Optuna's samplers. Fixed seeds: always the same
result."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import optuna
import pytest
from optuna.samplers import BaseSampler, NSGAIISampler, RandomSampler, TPESampler
from optuna.trial import Trial

from skiros2_learning.core.prior_sampler import Choice, Normal, PriorSampler
from support.known_functions import (
    BRANIN_MINIMUM,
    HARTMANN_OPTIMUM,
    branin,
    dominated_area,
    hartmann,
    levy,
    zdt1,
)


def minimum(function: Callable[[Trial], float], sampler: BaseSampler, count: int) -> float:
    study = optuna.create_study(sampler=sampler)
    study.optimize(function, n_trials=count)
    return study.best_value


def test_branin_is_minimised_better_than_at_random_and_by_tpe() -> None:
    found = minimum(branin, PriorSampler(seed=1), 30)
    assert found == pytest.approx(BRANIN_MINIMUM, abs=0.03)
    assert found < minimum(branin, RandomSampler(seed=1), 30)
    assert found < minimum(branin, TPESampler(seed=1), 30)


def test_a_good_prior_saves_evaluations_on_hartmann() -> None:
    good = {f"x{i}": Normal(best + 0.05, 0.1) for i, best in enumerate(HARTMANN_OPTIMUM)}
    with_prior = minimum(hartmann, PriorSampler(good, seed=1, n_startup_trials=5, beta=2), 20)
    assert with_prior < -3.2
    assert with_prior < minimum(hartmann, PriorSampler(seed=1, n_startup_trials=5), 20)
    assert with_prior < minimum(hartmann, TPESampler(seed=1, n_startup_trials=5), 20)


def test_a_misleading_prior_is_overcome() -> None:
    wrong = {"x": Normal(5.5, 0.7), "y": Normal(13.0, 0.7)}  # the worst corner of the valley
    assert minimum(branin, PriorSampler(wrong, seed=1, n_startup_trials=5, beta=3), 40) < BRANIN_MINIMUM + 0.1


def test_two_objectives_give_a_wide_front() -> None:
    areas = {}
    for name, sampler in (("prior", PriorSampler(seed=1)), ("random", RandomSampler(seed=1)),
                          ("nsga2", NSGAIISampler(seed=1, population_size=10))):  # fmt: skip
        study = optuna.create_study(directions=["minimize", "minimize"], sampler=sampler)
        study.optimize(zdt1, n_trials=40)
        areas[name] = dominated_area([tuple(trial.values) for trial in study.best_trials])
    assert areas["prior"] > max(areas["random"], areas["nsga2"])
    assert areas["prior"] > 4.3  # the true front dominates 5.07


def test_of_noisy_trials_the_one_with_the_best_mean_is_recommended() -> None:
    sampler = PriorSampler(seed=1)
    study = optuna.create_study(sampler=sampler)
    space = {"x": optuna.distributions.FloatDistribution(0.0, 1.0)}
    for x in np.linspace(0.0, 1.0, 21):
        lucky = -2.0 if x == 0.9 else 0.1 * math.sin(50.0 * x)
        study.add_trial(
            optuna.trial.create_trial(params={"x": x}, distributions=space, value=4.0 * (x - 0.3) ** 2 + lucky)
        )
    assert study.best_params["x"] == pytest.approx(0.9)
    assert sampler.recommended(study).params["x"] == pytest.approx(0.3, abs=0.11)


def test_a_value_of_few_repetitions_counts_less() -> None:
    def recommended(repetitions: int) -> float:
        sampler = PriorSampler(seed=1)
        study = optuna.create_study(sampler=sampler)
        space = {"x": optuna.distributions.FloatDistribution(0.0, 1.0)}
        for i, x in enumerate(np.linspace(0.0, 1.0, 11)):
            few, value = i == 8, -0.5 if i == 8 else 2.0 * (x - 0.3) ** 2
            attributes = {"repetitions": [repetitions if few else 50, [0.5]]}
            study.add_trial(
                optuna.trial.create_trial(params={"x": x}, distributions=space, value=value, user_attrs=attributes)
            )
        return float(sampler.recommended(study).params["x"])

    assert recommended(2) == pytest.approx(0.3, abs=0.11)
    assert recommended(500) == pytest.approx(0.8)


def test_variables_of_all_types_are_searched() -> None:
    def cost(trial: Trial) -> float:
        gait = {"walk": 0.0, "trot": 1.0, "crawl": 2.0}[trial.suggest_categorical("gait", ["crawl", "walk", "trot"])]
        size = trial.suggest_categorical("size", [1, 2, 4, 8])
        count = trial.suggest_int("count", 1, 9)
        rate = trial.suggest_float("rate", 1e-3, 1.0, log=True)
        return gait + abs(size - 4) + abs(count - 7) + abs(math.log10(rate) + 2.0)

    study = optuna.create_study(sampler=PriorSampler({"gait": Choice({"walk": 1, "trot": 1, "crawl": 1})}, seed=2))
    study.optimize(cost, n_trials=45)
    assert study.best_params["gait"] == "walk"
    assert study.best_params["size"] == 4
    assert abs(study.best_params["count"] - 7) <= 1


def test_constraints_are_respected() -> None:
    def cost(trial: Trial) -> float:
        x, y = trial.suggest_float("x", 0.0, 1.0), trial.suggest_float("y", 0.0, 1.0)
        trial.set_constraint("sum", 0.8 - x - y)
        return x + 2.0 * y

    study = optuna.create_study(sampler=PriorSampler(seed=1))
    study.optimize(cost, n_trials=35)
    assert study.best_trial.constraints["sum"] <= 0.0
    assert study.best_value == pytest.approx(0.8, abs=0.05)
    later = [all(v <= 0 for v in trial.constraints.values()) for trial in study.trials[15:]]
    assert sum(later) >= len(later) / 2


def test_an_optimum_at_the_limit_of_a_constraint_with_large_values_is_found() -> None:
    def cost(trial: Trial) -> float:
        x, y = trial.suggest_float("x", 0.0, 10.0), trial.suggest_float("y", 0.0, 10.0)
        trial.set_constraint("volume", 1.0 - (x * y) ** 3)
        return x + y

    study = optuna.create_study(sampler=PriorSampler(seed=1))
    study.optimize(cost, n_trials=25)
    assert study.best_value == pytest.approx(2.0, abs=0.05)


def test_the_first_trials_are_drawn_from_the_prior_a_third_of_them_at_random() -> None:
    study = optuna.create_study(sampler=PriorSampler({"x": Normal(3.0, 0.1)}, n_startup_trials=30, seed=1))
    study.optimize(lambda trial: trial.suggest_float("x", -5.0, 10.0), n_trials=30)
    drawn = np.array([trial.params["x"] for trial in study.trials])
    guided = np.arange(30) % 3 != 2
    assert drawn[guided].mean() == pytest.approx(3.0, abs=0.1)
    assert drawn[guided].std() == pytest.approx(0.1, abs=0.05)
    assert drawn[~guided].std() == pytest.approx(15.0 / math.sqrt(12.0), abs=1.0)


def test_a_prior_that_the_data_contradict_is_not_worse_than_random() -> None:
    far = {f"x{i}": Normal(-8.0, 2.0) for i in range(4)}
    assert minimum(levy, PriorSampler(far, seed=1, beta=3), 30) < minimum(levy, RandomSampler(seed=1), 30)


def test_a_study_that_is_resumed_goes_on_as_it_would_have() -> None:
    whole = optuna.create_study(sampler=PriorSampler(seed=1, n_startup_trials=3))
    whole.optimize(branin, n_trials=6)
    storage = optuna.storages.InMemoryStorage()
    for _ in range(2):
        part = optuna.create_study(
            storage=storage, study_name="part", load_if_exists=True, sampler=PriorSampler(seed=1, n_startup_trials=3)
        )
        part.optimize(branin, n_trials=3)
    assert [trial.params for trial in part.trials] == [trial.params for trial in whole.trials]


def test_failed_trials_are_avoided_and_running_ones_differ() -> None:
    study = optuna.create_study(sampler=PriorSampler(seed=1, n_startup_trials=4))

    def cost(trial: Trial) -> float:
        x = trial.suggest_float("x", 0.0, 1.0)
        if x > 0.5:
            raise ValueError
        return -x

    study.optimize(cost, n_trials=20, catch=(ValueError,))
    assert study.best_value < -0.4
    space = {"x": optuna.distributions.FloatDistribution(0.0, 1.0)}
    assert study.ask(space).params != study.ask(space).params


def test_the_first_trials_cover_the_range_evenly() -> None:
    study = optuna.create_study(sampler=PriorSampler(n_startup_trials=20, seed=1))
    study.optimize(lambda trial: trial.suggest_float("x", 0.0, 1.0) + trial.suggest_float("y", 0.0, 1.0), n_trials=20)
    for key in "xy":  # the first trial is drawn before the variables are known
        cells = {int(20 * trial.params[key]) for trial in study.trials[1:]}
        assert len(cells) == 19
