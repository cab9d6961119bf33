"""Pictures and the report of a study."""

from __future__ import annotations

import itertools
import platform
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text

from skiros2_learning.core.evaluation import Evaluation, Repetition
from skiros2_learning.core.pictures import (
    dependence,
    draw_pictures,
    hypervolumes,
    pareto_front,
    place_labels,
    robust_limits,
)
from skiros2_learning.core.report import write_report
from skiros2_learning.core.scenario import Scenario, parse_scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import repeat_here, validate
from skiros2_learning.core.workers import OneByOne
from support.known_functions import dominated_area
from support.learning_scenarios import scenario_text
from support.learning_tasks import parabola

TEXT = scenario_text("parabola", "parabola", evaluations=12, initial=4)
TWO = TEXT.replace("budget:", "  other: {rewards: [{reward: signal, series: value}]}\nbudget:")


def result(cost: float, other: float, x: float = 0.5, violation: float = 0.0) -> Evaluation:
    repetition = Repetition({"cost": cost, "other": other}, {}, {}, True, "", 1.0)
    return Evaluation({"x": x}, 1, {"cost": cost, "other": other}, {"c": violation}, 1.0, [repetition], planned=1)


@pytest.fixture
def two() -> Scenario:
    return parse_scenario(TWO, Path())


def searched(folder: Path, text: str = TEXT, count: int = 12) -> LearningStudy:
    study = LearningStudy.create(parse_scenario(text, Path()).derived(evaluations=count), folder / "study")
    OneByOne(study, parabola, lambda number, result: None).run()
    return study


def test_labels_of_a_dense_front_do_not_overlap_and_stay_inside(two: Scenario) -> None:
    random = np.random.default_rng(1)
    costs = np.sort(0.5 + 0.02 * random.random(25))
    results = {number: result(cost, cost) for number, cost in enumerate(costs.tolist(), 100)}
    figure = pareto_front(two, results, list(results))
    figure.draw_without_rendering()
    axes = figure.axes[0]
    notes = [each for each in axes.texts if isinstance(each, Annotation)]
    boxes = [Text.get_window_extent(each) for each in notes]
    assert len(boxes) >= 8
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
    frame = axes.get_window_extent()
    assert all(frame.contains(*box.min) and frame.contains(*box.max) for box in boxes)


def test_the_first_label_has_a_place_though_points_coincide() -> None:
    axes = Figure().add_subplot()
    axes.plot([0, 1], [0, 1])
    place_labels(axes, {"7": (0.5, 0.5), "8": (0.5, 0.5)})
    assert [each.get_text() for each in axes.texts] == ["7", "8"]


def test_axes_leave_out_outliers_but_not_the_front(two: Scenario) -> None:
    results = {number: result(1.0 + 0.01 * number, 5.0 + 0.01 * number) for number in range(20)}
    results[20] = result(900.0, 5.0)
    results[21] = result(0.2, 2.0, violation=1.0)
    axes = pareto_front(two, results, [0, 19]).axes[0]
    low, high = axes.get_xlim()
    assert 0.9 < low < 1.0
    assert 1.19 < high < 1.3
    assert "2 evaluations are outside of the picture" in axes.get_title()
    assert robust_limits(np.array([1.0, 1.1, 1.2, 50.0]), [40.0])[1] > 40.0


def test_the_hypervolume_is_that_of_the_feasible_evaluations_so_far(two: Scenario) -> None:
    random = np.random.default_rng(2)
    points = random.random((15, 2))
    results = {number: result(*point, violation=number % 5 - 3.0) for number, point in enumerate(points.tolist())}
    (found,) = hypervolumes(two, [results])
    costs = points * (1.0, -1.0)
    feasible = np.array([number % 5 <= 3 for number in range(15)])
    low = costs[feasible].min(axis=0)
    units = (costs - low) / (1.05 * (costs[feasible].max(axis=0) - low))
    expected = [dominated_area(units[: n + 1][feasible[: n + 1]].tolist(), (1.0, 1.0)) for n in range(15)]
    assert found == pytest.approx(expected)
    assert found == sorted(found)


def test_partial_dependence_shows_where_results_are_good(tmp_path: Path) -> None:
    study = searched(tmp_path)
    axes = dependence(study.scenario, study.results()).axes[1]
    x, y = axes.lines[0].get_data()
    assert x[np.argmin(y)] == pytest.approx(0.3, abs=0.06)


def test_the_report_has_all_pictures_the_result_and_how_to_repeat_it(tmp_path: Path) -> None:
    study = searched(tmp_path, TWO.replace("real, range: [0, 1]", "real, range: [0, 1], prior: {mean: 0.3, std: 0.1}"))
    found = validate(study, repeat_here())
    titles = list(draw_pictures(study))
    assert titles == [
        "Progress", "Pareto front", "Spread over repetitions", "Parameters and results", "Priors and good values",
        "Importance of the parameters",
    ]  # fmt: skip
    text = write_report(study).read_text()
    for part in (*titles, found.verdict, f"learn replay {study.folder} N", "skiros2 2.", "The seed of the study is 3"):
        assert part in text
    assert f"python {platform.python_version()}" in text
    assert text.count("image/png") == len(titles)


def test_a_study_without_a_feasible_configuration_has_a_report(tmp_path: Path) -> None:
    study = searched(tmp_path, TWO + "constraints: [{reward: signal, series: value, at_least: 9.0}]\n", 6)
    assert study.best() == []
    assert "Pareto front" in write_report(study).read_text()
