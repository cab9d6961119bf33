"""Studies: parallel processes, broken evaluations, interruption and resumption. With executions of
support.learning_tasks."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_common.core.errors import ConfigurationError, Refused, UnknownName
from skiros2_learning.core.evaluation import Evaluation, evaluate
from skiros2_learning.core.scenario import Scenario, ScenarioError, load_scenario, parse_scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.workers import Runner
from support.learning_scenarios import scenario_text

TEXT = scenario_text(
    "parabola", "EXECUTION", evaluations=6, initial=3, settings="{folder: FOLDER}", timeout="60",
    constraints="[{name: small, reward: signal, series: value, at_most: 0.1}]",
)  # fmt: skip


def scenario(folder: Path, execution: str = "parabola", timeout: str = "60") -> Scenario:
    text = TEXT.replace("timeout: 60", f"timeout: {timeout}")
    return parse_scenario(text.replace("EXECUTION", execution).replace("FOLDER", str(folder)), folder)


def run(study: LearningStudy, count: int = 1) -> dict[int, Evaluation]:
    Runner(study, count).run()
    return study.results()


def test_an_evaluation_depends_on_configuration_and_seed_only(tmp_path: Path) -> None:
    plan = scenario(tmp_path)
    first = evaluate(plan, {"x": 0.4}, 7)
    assert first == evaluate(plan, {"x": 0.4}, 7) == Evaluation.from_json(first.to_json())
    assert first != evaluate(plan, {"x": 0.4}, 8)
    assert first.objectives["cost"] == pytest.approx(0.01, abs=0.005)
    assert first.success_rate == 1.0
    assert first.violations["small"] == pytest.approx(-0.09, abs=0.005)


def test_programs_for_optuna_find_the_objectives_by_name(tmp_path: Path) -> None:
    LearningStudy.create(scenario(tmp_path), tmp_path / "study")
    assert LearningStudy.open(tmp_path / "study").optuna.metric_names == ["cost"]


def test_an_execution_that_raises_or_gives_no_number_is_a_result_with_a_reason(tmp_path: Path) -> None:
    broken = evaluate(scenario(tmp_path, "raises"), {"x": 0.4}, 1)
    assert broken.error == "repetition 0: RuntimeError: the physics has exploded"
    broken = evaluate(scenario(tmp_path, "not_a_number"), {"x": 0.4}, 1)
    assert broken.error == "repetition 0: reward cost.signal is nan, expected a finite number"


def test_best_evaluation_has_the_lowest_objective(tmp_path: Path) -> None:
    study = LearningStudy.create(scenario(tmp_path), tmp_path / "study")
    results = run(study)
    best = study.best()[0]
    assert results[best].objectives["cost"] == min(result.objectives["cost"] for result in results.values())


def test_an_interrupted_study_goes_on_and_loses_nothing(tmp_path: Path) -> None:
    study = LearningStudy.create(scenario(tmp_path), tmp_path / "study")
    number, configuration, seed = study.ask()
    study.tell(number, evaluate(study.scenario, configuration, seed))
    lost, lost_configuration, lost_seed = study.ask()  # running when the process ends
    del study
    study = LearningStudy.open(tmp_path / "study")
    assert study.counted == 1
    assert study.requeue_interrupted() == 1
    results = run(study)
    assert len(results) == study.counted == 6
    assert (results[lost].configuration, results[lost].seed) == (lost_configuration, lost_seed)
    assert results == run(LearningStudy.create(scenario(tmp_path), tmp_path / "whole"))


def test_an_interrupted_evaluation_beyond_the_budget_is_not_repeated(tmp_path: Path) -> None:
    study = LearningStudy.create(scenario(tmp_path), tmp_path / "study")
    study.ask()  # running when its process ends, while another process uses up the budget
    for _ in range(6):
        number, configuration, seed = study.ask()
        study.tell(number, evaluate(study.scenario, configuration, seed))
    LearningStudy.open(tmp_path / "study").requeue_interrupted()
    again = LearningStudy.open(tmp_path / "study")
    assert (again.running_count, again.counted) == (0, 6)


def test_interruption_ends_the_processes_and_keeps_what_is_finished(tmp_path: Path) -> None:
    study = LearningStudy.create(scenario(tmp_path), tmp_path / "study")

    def interrupt(number: int, result: Evaluation) -> None:
        if study.counted == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Runner(study, 1, interrupt).run()
    again = LearningStudy.open(tmp_path / "study")
    assert again.counted == 2
    again.requeue_interrupted()
    assert len(run(again)) == 6


@pytest.mark.parametrize("optimiser", ["prior", "tpe"])
def test_every_configuration_satisfies_the_restrictions(tmp_path: Path, optimiser: str) -> None:
    text = scenario_text("restricted", "parabola", "xy", evaluations=12, initial=5, optimiser=optimiser,
                         restrictions="[{sum: {x: 1, y: 1}, at_most: 0.8}]")  # fmt: skip
    study = LearningStudy.create(parse_scenario(text, tmp_path), tmp_path / "study")
    for _ in range(12):
        number, configuration, seed = study.ask()
        study.tell(number, evaluate(study.scenario, configuration, seed))
    drawn = [each.configuration for each in study.results().values()]
    assert len(drawn) == 12
    assert max(float(each["x"]) + float(each["y"]) for each in drawn) <= 0.8


def test_a_stored_study_with_more_failures_than_repetitions_is_resumed_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    study = LearningStudy.create(scenario(tmp_path), tmp_path / "study")
    file = tmp_path / "study/scenario.yaml"
    file.write_text(file.read_text() + "max_failures: 9\n")
    with pytest.raises(ScenarioError, match="max_failures: expected at most 2, the repetitions, got 9"):
        load_scenario(file)
    opened = LearningStudy.open(study.folder)
    assert opened.scenario.max_failures == 2
    assert "max_failures is 9, taken as 2, the repetitions" in caplog.text
    assert len(run(opened)) == 6


def test_two_runs_of_one_study_are_refused(tmp_path: Path) -> None:
    study = LearningStudy.create(scenario(tmp_path), tmp_path / "study")
    other = LearningStudy.open(tmp_path / "study")
    with study.running(), pytest.raises(Refused, match="another process is running the study"), other.running():
        pass


def test_a_folder_has_one_study(tmp_path: Path) -> None:
    LearningStudy.create(scenario(tmp_path), tmp_path / "study")
    with pytest.raises(Refused, match="has a study already"):
        LearningStudy.create(scenario(tmp_path), tmp_path / "study")
    with pytest.raises(UnknownName, match="has no study"):
        LearningStudy.open(tmp_path / "other")
    with pytest.raises(UnknownName, match=r"has no result 5; it has none"):
        LearningStudy.open(tmp_path / "study").result(5)


def test_a_database_is_accepted(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'study.db'}"
    study = LearningStudy.create(scenario(tmp_path), tmp_path / "study", url)
    assert len(run(study)) == 6
    assert LearningStudy.open(tmp_path / "study", url).results() == study.results()


def test_an_execution_that_does_not_exist_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="expected module:function"):
        evaluate(scenario(tmp_path, "nothing"), {"x": 0.4}, 1)
