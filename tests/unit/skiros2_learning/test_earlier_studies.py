"""Successive studies: earlier good configurations are priors. With executions of support.learning_tasks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skiros2_common.core.errors import Refused
from skiros2_learning.command_line.program import main
from skiros2_learning.core.earlier_studies import with_earlier
from skiros2_learning.core.evaluation import evaluate
from skiros2_learning.core.scenario import Scenario, ScenarioError, parse_scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.variables import Samples
from support.learning_scenarios import scenario_text

TEXT = scenario_text(
    "bowl", "bowl", "xyz", evaluations=40, initial=10, repetitions=1, seed=5,
    settings="{best: {x: BEST, y: 0.4, z: 0.6}}",
)  # fmt: skip


def scenario(best: float = 0.3, text: str = TEXT, seed: int = 5) -> Scenario:
    return parse_scenario(text.replace("BEST", str(best)).replace("seed: 5", f"seed: {seed}"), Path())


def run(plan: Scenario, folder: Path) -> list[float]:
    """Returns the costs in the order of the evaluations."""
    study = LearningStudy.create(plan, folder)
    while study.counted < plan.budget.evaluations:
        number, configuration, seed = study.ask()
        study.tell(number, evaluate(plan, configuration, seed))
    results = study.results()
    return [results[number].objectives["cost"] for number in sorted(results)]


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> LearningStudy:
    folder = tmp_path_factory.mktemp("studies") / "earlier"
    run(scenario(), folder)
    return LearningStudy.open(folder)


def test_a_study_of_a_similar_task_needs_fewer_evaluations_with_an_earlier_one(
    earlier: LearningStudy, tmp_path: Path
) -> None:
    """The optimum of the new task is 0.05 away."""
    plan = scenario(best=0.35, seed=7).derived(evaluations=12, initial=5)
    cold = run(plan, tmp_path / "cold")
    warm_plan, _ = with_earlier(plan, [earlier])
    warm = run(warm_plan, tmp_path / "warm")
    assert min(warm[:5]) < min(cold[:5])
    assert np.mean(warm) < 0.5 * np.mean(cold)
    assert min(warm) < 0.005


@pytest.mark.long
def test_an_earlier_study_of_another_task_does_not_keep_from_the_optimum(
    earlier: LearningStudy, tmp_path: Path
) -> None:
    plan, _ = with_earlier(scenario(best=0.95), [earlier])
    assert min(run(plan, tmp_path / "study")) < 0.02


def test_priors_are_the_densities_of_the_good_configurations(earlier: LearningStudy) -> None:
    plan, first = with_earlier(scenario(), [earlier])
    for variable, best in zip(plan.variables, (0.3, 0.4, 0.6), strict=True):
        assert isinstance(variable.prior, Samples)
        assert np.mean(variable.prior.values) == pytest.approx(best, abs=0.1)
    assert first == [earlier.result(number).configuration for number in earlier.ranked()[:2]]


def test_a_narrower_range_takes_only_the_values_that_are_in_it(earlier: LearningStudy) -> None:
    text = TEXT.replace("x: {type: real, range: [0, 1]}", "x: {type: real, range: [0.8, 1]}")
    plan, first = with_earlier(scenario(text=text), [earlier])
    assert plan.variables[0].prior is None
    assert plan.variables[1].prior is not None
    assert first == []


def test_a_study_without_results_or_with_other_variables_is_refused(earlier: LearningStudy, tmp_path: Path) -> None:
    empty = LearningStudy.create(scenario(), tmp_path / "empty")
    with pytest.raises(Refused, match="has no results; run it first"):
        with_earlier(scenario(), [empty])
    other = TEXT.replace("  x:", "  a:").replace("  y:", "  b:").replace("  z:", "  c:")
    with pytest.raises(Refused, match="has none of the variables a, b, c; it has x, y, z"):
        with_earlier(scenario(text=other), [earlier])


def test_samples_with_mistakes_are_reported() -> None:
    text = TEXT.replace("x: {type: real, range: [0, 1]}", "x: {range: [0, 1], prior: {samples: [0.5, 2], std: 0}}")
    with pytest.raises(ScenarioError) as found:
        scenario(text=text)
    assert "x.prior.samples: expected 0 to 1, the range of the variable, got [2.0]" in str(found.value)
    assert "x.prior.std: expected more than 0, got 0" in str(found.value)


@pytest.mark.parametrize("named", ["file", "option"])
def test_scenario_and_command_line_name_earlier_studies(
    earlier: LearningStudy, tmp_path: Path, capsys: pytest.CaptureFixture[str], named: str
) -> None:
    key = f"prior_from: [{earlier.folder}]\n" if named == "file" else ""
    (tmp_path / "bowl.yaml").write_text(TEXT.replace("BEST", "0.3") + key)
    option = ["--prior-study", str(earlier.folder)] if named == "option" else []
    folder = tmp_path / "study"
    command = ["run", str(tmp_path / "bowl.yaml"), "--study", str(folder), "--workers", "1", "--evaluations", "4"]
    assert main([*command, *option]) == 0, capsys.readouterr().err
    study = LearningStudy.open(folder)
    assert study.scenario.prior_from == ()  # the priors themselves are kept
    assert isinstance(study.scenario.variables[0].prior, Samples)
    assert study.result(0).configuration == earlier.result(earlier.ranked()[0]).configuration
