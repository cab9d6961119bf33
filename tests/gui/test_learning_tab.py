"""The tab "Learning": studies, their evaluations, replay, applying and taking back."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot
from python_qt_binding.QtWidgets import QComboBox, QLabel, QPushButton, QTabWidget

from skiros2_gui.app.widgets.tables import RowsView
from skiros2_gui.app.window import Window
from skiros2_gui.learning import studies
from skiros2_gui.learning.widgets.tab import LearningTab
from skiros2_learning.core.evaluation import evaluate
from skiros2_learning.core.scenario import parse_scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import repeat_here, validate
from skiros2_skill.core.engine.learned_parameters import learned_values
from support.window.local_system import LocalSystem
from support.window.synchronous import make_window

TEXT = """
scenario: parabola
execution: support.learning_tasks:parabola
task: [{skill: Dig}]
variables:
  Dig.x: {range: [0, 1]}
  x: {range: [0, 1]}
objectives:
  cost: {sense: minimise, rewards: [{reward: signal, series: value}]}
  success: {rewards: [{reward: success}]}
repetitions: 2
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a study of three evaluations, the second one the best and validated, and something that is not a
    study."""
    folder = tmp_path_factory.mktemp("studies")
    study = LearningStudy.create(parse_scenario(TEXT, folder), folder / "digging")
    for x in (0.7, 0.31, 0.1):
        study.enqueue({"x": x, "Dig.x": 0.25})
        number, configuration, seed = study.ask()
        study.tell(number, evaluate(study.scenario, configuration, seed))
    validate(study, repeat_here())
    (folder / "broken").mkdir()
    (folder / "broken/scenario.yaml").write_text("scenario: [")
    return folder


@pytest.fixture
def window() -> Iterator[Window]:
    made = make_window(LocalSystem)
    yield made
    made.system.close()


@pytest.fixture
def tab(window: Window, folder: Path, qtbot: QtBot) -> LearningTab:
    made = LearningTab(window)
    qtbot.addWidget(made)
    made.restore({"folder": str(folder)})
    made.show()
    return made


def texts(tab: LearningTab, table: str) -> list[tuple[str, ...]]:
    return [row.cells for row in tab.findChild(RowsView, table).rows.rows]


def select(tab: LearningTab, table: str, first: str) -> None:
    view: RowsView = tab.findChild(RowsView, table)
    row = next(i for i, cells in enumerate(texts(tab, table)) if cells[0] == first)
    view.setCurrentIndex(view.model().index(row, 0))


def press(tab: LearningTab, button: str) -> None:
    found: QPushButton = tab.findChild(QPushButton, button)
    assert found.isEnabled()
    found.click()


def status(tab: LearningTab) -> str:
    label: QLabel = tab.findChild(QLabel, "learningStatus")
    return label.text()


def test_studies_of_the_folder_are_listed_with_their_progress(tab: LearningTab) -> None:
    assert texts(tab, "studyList") == [
        ("broken", "", "cannot be read", ""),
        ("digging", "3 of 100", "100%", "30 of 30, 95 % interval 89 to 100 %"),
    ]


def test_evaluations_are_listed_the_best_first_with_pictures(tab: LearningTab) -> None:
    select(tab, "studyList", "digging")
    rows = texts(tab, "configurationList")
    assert [row[:2] for row in rows] == [("1", "100%"), ("2", "100%"), ("0", "0%")]
    assert rows[0][2] == "yes"
    assert rows[0][-1] == "0.31"
    pictures: QTabWidget = tab.findChild(QTabWidget, "studyPictures")
    shown = [pictures.tabText(i) for i in range(pictures.count())]
    assert shown[:3] == ["Progress", "Pareto front", "Spread over repetitions"]


def test_a_configuration_is_applied_and_taken_back(tab: LearningTab, window: Window) -> None:
    for button in ("replayButton", "applyButton", "revertButton"):
        assert not tab.findChild(QPushButton, button).isEnabled()
    select(tab, "studyList", "digging")
    select(tab, "configurationList", "1")
    press(tab, "applyButton")
    assert status(tab).startswith("applied as skiros:ParameterSet-")
    assert learned_values("Dig", {}, window.system.world).values == {"x": [0.25]}
    applied: QComboBox = tab.findChild(QComboBox, "appliedSets")
    assert applied.itemText(0).startswith("parabola 1: Dig (skiros:ParameterSet-")
    press(tab, "revertButton")
    assert status(tab).endswith("is reverted")
    assert learned_values("Dig", {}, window.system.world).values == {}
    assert applied.count() == 0


def test_the_validation_is_shown_and_other_configurations_are_not_applied(tab: LearningTab, window: Window) -> None:
    select(tab, "studyList", "digging")
    shown: QLabel = tab.findChild(QLabel, "studyValidation")
    assert "evaluation 1: success 30 of 30, 95 % interval 89 to 100 %; cost " in shown.text()
    select(tab, "configurationList", "2")
    refused = "evaluation 2 is not validated; validated is 1; --unvalidated applies it all the same"
    with pytest.raises(studies.SkirosError, match=refused):
        studies.apply_configuration(window.system.world, Path(tab.settings()["folder"]) / "digging", 2)


def test_an_evaluation_is_replayed(tab: LearningTab, monkeypatch: pytest.MonkeyPatch) -> None:
    replayed: list[tuple[Path, int]] = []

    def replay(folder: Path, number: int) -> str:
        replayed.append((folder, number))
        return "the result is the same"

    monkeypatch.setattr(studies, "replay", replay)
    select(tab, "studyList", "digging")
    select(tab, "configurationList", "2")
    press(tab, "replayButton")
    assert replayed == [(Path(tab.settings()["folder"]) / "digging", 2)]
    assert status(tab) == "the result is the same"


@pytest.mark.long
def test_a_replay_runs_in_a_process_of_its_own(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import os
    import sys

    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    assert "the result is the same" in studies.replay(folder / "digging", 1)
    with pytest.raises(studies.SkirosError, match="has no result 9"):
        studies.replay(folder / "digging", 9)
