"""Validation of studies of a skill that succeeds by chance, at a known rate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skiros2_common.core.errors import Refused
from skiros2_learning.core.evaluation import Outcome, evaluate, repeat_once, seed_of
from skiros2_learning.core.report import status_lines, write_report
from skiros2_learning.core.scenario import Scenario, parse_scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import (
    Execute,
    Repeat,
    Validation,
    applicable,
    repeat_here,
    share_text,
    stored_validation,
    validate,
)
from skiros2_learning.core.workers import repeat_in_processes
from support.learning_scenarios import scenario_text
from support.learning_tasks import chance_rate, parabola


def searched(folder: Path, count: int = 15, seed: int = 3, execution: str = "chance", **sections: str) -> LearningStudy:
    """A study after a random search."""
    text = scenario_text("chance", execution, evaluations=count, initial=2, repetitions=4, seed=seed, **sections)
    study = LearningStudy.create(parse_scenario(text, folder), folder / "study")
    random = np.random.default_rng(seed)
    for _ in range(count):
        study.enqueue({"x": float(random.random())})
        number, configuration, draw = study.ask()
        study.tell(number, evaluate(study.scenario, configuration, draw))
    return study


def covered(found: Validation) -> bool:
    sample = found.decided
    return sample.success.low <= chance_rate(float(sample.configuration["x"])) <= sample.success.high


def test_validated_rate_is_of_new_draws_and_kept_with_the_study(tmp_path: Path) -> None:
    study = searched(tmp_path)
    found = validate(study, repeat_here())
    assert stored_validation(LearningStudy.open(tmp_path / "study")) == found
    searched_seeds = {result.seed for result in study.results().values()}
    assert {each.seed for each in (*found.candidates, found.learned)}.isdisjoint(searched_seeds)
    assert found.learned.seed not in {each.seed for each in found.candidates}
    assert [each.number for each in found.candidates] == study.ranked()[:4]
    assert found.learned.count == 30
    best = max(found.candidates, key=lambda each: each.good)
    assert next(e for e in found.candidates if e.number == found.learned.number).good == best.good
    assert study.result(study.ranked()[0]).success_rate == 1.0  # luck
    assert covered(found)


def test_intervals_cover_the_true_rate_of_most_studies(tmp_path: Path) -> None:
    found = [validate(searched(tmp_path / str(seed), 8, seed), repeat_here()) for seed in range(20)]
    assert sum(map(covered, found)) >= 17  # less than 1 in 60 by chance


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("settings", ["{}", "{defaults: {x: 0.5}}", "{defaults: {x: 0.3}}"])
def test_intervals_cover_the_true_rate_of_93_percent_of_200_studies(tmp_path: Path, settings: str) -> None:
    rates, decided = [], []
    for seed in range(200):
        study = searched(tmp_path / str(seed), 12, 1000 + seed, settings=settings)
        found = validate(study, repeat_here())
        rates.append(covered(found))
        decided.append(found.advantage)
    assert np.mean(rates) >= 0.93
    if settings == "{defaults: {x: 0.3}}":  # nothing is better than these
        assert np.mean([bool(each) for each in decided]) <= 0.05


def test_processes_give_the_same_validation_as_this_process(tmp_path: Path) -> None:
    study = searched(tmp_path, 4, validation="{candidates: 2, choice: 3, repetitions: 5}")
    with repeat_in_processes(study.scenario, 2) as repeat:
        assert validate(study, repeat) == validate(study, repeat_here())


def test_candidates_that_cannot_win_are_not_repeated_and_the_choice_is_the_same(tmp_path: Path) -> None:
    fewer = 0
    for seed in range(10):
        study = searched(tmp_path / str(seed), 8, seed)
        found = validate(study, repeat_here())
        whole = {
            each.number: sum(
                not isinstance(outcome, str) and outcome.is_success
                for index in range(10)
                for outcome in [repeat_once(study.scenario, each.configuration, each.seed, index)]
            )
            for each in found.candidates
        }
        assert whole[found.learned.number] == max(whole.values())
        fewer += sum(each.count < 10 for each in found.candidates)
        assert all(each.good <= whole[each.number] for each in found.candidates)
    assert fewer >= 10


def test_an_interrupted_validation_continues(tmp_path: Path) -> None:
    made: list[Execute] = []
    study = searched(tmp_path, 4, validation="{candidates: 2, choice: 3, repetitions: 5}")

    def counting(limit: int) -> Repeat:
        def repeat(scenario: Scenario, jobs: Sequence[Execute]) -> Iterator[Outcome]:
            for job in jobs:
                if len(made) == limit:
                    raise KeyboardInterrupt
                made.append(job)
                yield repeat_once(scenario, job.configuration, job.seed, job.index)

        return repeat

    with pytest.raises(KeyboardInterrupt):
        validate(study, counting(7))
    found = validate(study, counting(1000))
    assert len(made) == sum(each.count for each in (*found.candidates, found.learned))
    assert found == validate(study, repeat_here())
    assert not (study.folder / "validation.jsonl").exists()


def test_defaults_that_are_as_good_are_chosen_and_the_learned_values_not_applied(tmp_path: Path) -> None:
    study = searched(tmp_path, settings="{defaults: {x: 0.3}}")
    with pytest.raises(Refused, match=r"study 'chance' is not validated; run: learn validate .*--unvalidated"):
        applicable(study)
    found = validate(study, repeat_here())
    assert found.defaults is not None
    assert (found.advantage, found.decided, found.is_better) == ("", found.defaults, False)
    learned, usual = share_text(found.learned), share_text(found.defaults)
    number = found.learned.number
    for each in (None, number):
        with pytest.raises(Refused) as refused:
            applicable(study, each)
        assert f"({learned}) is not better with confidence than the defaults of the skill ({usual})" in str(
            refused.value
        )
    assert applicable(study, number, unvalidated=True)[2] == found.learned


def test_values_that_are_better_than_the_defaults_with_confidence_are_applied(tmp_path: Path) -> None:
    study = searched(tmp_path, settings="{defaults: {x: 1.0}}")
    found = validate(study, repeat_here())
    assert (found.advantage, found.decided) == ("success", found.learned)
    number, result, sample = applicable(study)
    assert (number, result, sample) == (found.learned.number, study.result(number), found.learned)
    other = next(each for each in study.results() if each != number)
    with pytest.raises(Refused, match=f"evaluation {other} is not validated; validated is {number}; --unvalidated"):
        applicable(study, other)
    assert applicable(study, other, unvalidated=True)[2] is None


def test_objectives_decide_where_the_success_does_not(tmp_path: Path) -> None:
    study = searched(tmp_path, execution="parabola", settings="{defaults: {x: 0.0}}")
    found = validate(study, repeat_here())
    assert found.defaults is not None
    assert found.learned.good == found.defaults.good == 30
    assert found.advantage == "cost"
    cost = found.learned.objective("cost")
    assert cost.low <= (float(found.learned.configuration["x"]) - 0.3) ** 2 <= cost.high


@pytest.mark.parametrize("settings", ["{defaults: {x: 0.0}}", "{}"])
def test_a_configuration_that_has_never_succeeded_is_not_applied(tmp_path: Path, settings: str) -> None:
    study = searched(tmp_path, 4, execution="parabola", settings=settings)
    failing = repeat_here(lambda *given: replace(parabola(*given), succeeded=False, reason="failed"))
    found = validate(study, failing)  # its cost is lower than that of the defaults
    assert (found.learned.good, found.advantage, found.is_better) == (0, "", False)
    assert found.verdict.startswith("chosen: the defaults" if found.defaults else "chosen: none; evaluation")
    with pytest.raises(Refused, match="not better with confidence" if found.defaults else "has never succeeded"):
        applicable(study)
    applicable(study, found.learned.number, unvalidated=True)


def test_a_broken_repetition_counts_as_failed_with_its_reason(tmp_path: Path) -> None:
    study = searched(tmp_path, 3)
    found = validate(study, repeat_here(lambda *given: (_ for _ in ()).throw(RuntimeError("the arm fell off"))))
    assert (found.learned.good, found.learned.count) == (0, 30)
    assert "0 of 30, 95 % interval 0 to 11 % (30 broken, such as: RuntimeError: the arm fell" in share_text(
        found.learned
    )


def test_status_and_report_name_counts_and_intervals(tmp_path: Path) -> None:
    study = searched(tmp_path, settings="{defaults: {x: 1.0}}")
    assert any(line.startswith("not validated: the rates below are optimistic") for line in status_lines(study))
    found = validate(study, repeat_here())
    text = share_text(found.learned)
    assert f"evaluation {found.learned.number}: success {text}; cost" in "\n".join(status_lines(study))
    assert found.verdict in "\n".join(status_lines(study))
    report = write_report(study).read_text()
    assert text in report
    assert found.verdict in report


def test_a_truncated_evaluation_keeps_its_counts_and_is_no_rate(tmp_path: Path) -> None:
    study = searched(tmp_path, 30, max_failures="1")
    results = study.results()
    truncated = [each for each in results.values() if each.is_truncated]
    lucky = [each for each in truncated if each.good]
    assert lucky, "no evaluation began with a success"
    for each in truncated:
        assert each.success_rate == each.good / 4 < each.good / len(each.repetitions) or not each.good
    lines = "\n".join(status_lines(study))
    assert "stopped early" not in lines
    assert study.best()
    assert not any(results[number].is_truncated for number in study.best())
    again = evaluate(study.scenario, lucky[0].configuration, lucky[0].seed)
    assert again == lucky[0]


def test_a_study_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="has no results to validate"):
        validate(searched(tmp_path, 2, execution="raises"), repeat_here())


def test_seeds_of_the_search_stay_below_those_of_the_validation(tmp_path: Path) -> None:
    study = searched(tmp_path, 2)
    found = validate(study, repeat_here())
    assert found.learned.seed > seed_of(study.scenario, 400_000)
