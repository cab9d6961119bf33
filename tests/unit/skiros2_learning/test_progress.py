"""The progress of a study on the terminal."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_learning.command_line.running import Progress
from skiros2_learning.core.scenario import parse_scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.workers import OneByOne
from support.learning_scenarios import scenario_text
from support.learning_tasks import parabola

TEXT = scenario_text("parabola", "parabola", evaluations=12, initial=4)


@pytest.mark.parametrize(("every", "rest"), [(1, 12), (5, 3)])
def test_a_line_for_some_evaluations_the_last_one_and_each_improvement(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], every: int, rest: int
) -> None:
    study = LearningStudy.create(parse_scenario(TEXT, Path()), tmp_path / "study")
    OneByOne(study, parabola, Progress(study, every)).run()
    lines = capsys.readouterr().out.splitlines()
    shown = [int(line[1:].partition("/")[0]) for line in lines]
    assert shown[-1] == 12
    assert len([number for number in shown if number % every == 0 or number == 12]) == rest
    rates = [each.success_rate for each in study.results().values()]
    assert (1 + rates.index(1.0)) in shown
