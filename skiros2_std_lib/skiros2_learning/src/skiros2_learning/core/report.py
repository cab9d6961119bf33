"""The report of a study: one HTML file with pictures, and a summary for the terminal."""

from __future__ import annotations

import base64
import functools
import html
import io
import math
import warnings
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import numpy as np
import optuna
from matplotlib.figure import Figure

from skiros2_common.core.errors import SkirosError
from skiros2_learning.core.evaluation import Evaluation, find_quantities
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import share_text, stored_validation, validation_lines
from skiros2_learning.core.variables import Value

#: Configurations in the table of the report.
_ROWS = 15
#: Evaluations from which on the importance of the parameters is estimated.
LEAST_FOR_IMPORTANCE = 10


def write_report(
    study: LearningStudy,
    others: dict[str, LearningStudy] | None = None,
    pictures: dict[str, Figure] | None = None,
) -> Path:
    """Writes `report.html` into the folder of the study. Returns its name.

    :param others: studies of the same scenario, to compare with, by title.
    :param pictures: more pictures, by title.
    """
    results = study.results()
    sections = [_overview(study, results), _validation(study), _table(study, results)]
    complete = {number: result for number, result in results.items() if not result.error}
    if complete:
        titled = {"this study": study, **(others or {})}
        sections.append(_picture("Convergence", convergence({title: each.results() for title, each in titled.items()})))
        best = study.best(complete)
        if len(study.scenario.objectives) == 2:
            sections.append(_picture("Pareto front", pareto_front(study.scenario, complete, best)))
        sections.append(_picture("Spread of the best configurations", spread(study.scenario, complete, best)))
        sections.append(_picture("Configurations", configurations(study.scenario, complete)))
        if len(complete) >= LEAST_FOR_IMPORTANCE:
            sections.append(_picture("Importance of the parameters", importance(study)))
    sections += [_picture(title, figure) for title, figure in (pictures or {}).items()]
    sections.append(_randomisation(study.scenario))
    sections.append(f"<h2>Scenario</h2><pre>{html.escape(study.scenario.source)}</pre>")
    target = study.folder / "report.html"
    title = html.escape(f"Study {study.scenario.name}")
    target.write_text(
        f"<!DOCTYPE html><html><head><meta charset='utf-8'><title>{title}</title><style>{_STYLE}</style></head>"
        f"<body><h1>{title}</h1>{''.join(sections)}</body></html>\n",
        encoding="utf-8",
    )
    return target


def status_lines(study: LearningStudy) -> list[str]:
    """Returns the state of a study for a terminal: progress and the best configurations."""
    results = study.results()
    broken = sum(bool(result.error) for result in results.values())
    lines = [
        f"study {study.scenario.name}: {study.counted} of {study.scenario.budget.evaluations} evaluations, "
        f"{broken} broken, {study.running_count} running or interrupted"
    ]
    validation = stored_validation(study)
    if validation is not None:
        lines += validation_lines(study.scenario, validation)
        if study.counted > validation.counted:
            lines.append(f"  {study.counted - validation.counted} evaluations since then are not validated")
    elif results:
        lines.append(f"not validated: the rates below are optimistic; run: learn validate {study.folder}")
    for number in study.best(results)[:_ROWS]:
        lines.append(f"  {number:4d}  {describe(results[number])}")
    return lines


def describe(result: Evaluation) -> str:
    """Describes a result in one line: success rate, objectives, configuration."""
    if result.error:
        return f"broken: {result.error}"
    values = ", ".join(f"{name} {value:.3g}" for name, value in result.objectives.items())
    settings = " ".join(f"{name}={format_value(value)}" for name, value in result.configuration.items())
    return f"success {search_share(result)}, {values}; {settings}"


def search_share(result: Evaluation) -> str:
    """Describes the successes of an evaluation of the search; of a truncated one by numbers only, as it has no rate."""
    made = len(result.repetitions)
    if result.is_truncated:
        return f"{result.good} of {made}, stopped early (of {result.planned})"
    return f"{result.success_rate:.0%}"


def format_value(value: Value) -> str:
    """Returns a value with four significant digits."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


# -- pictures ----------------------------------------------------------------------------------------------------------


def convergence(studies: dict[str, dict[int, Evaluation]]) -> Figure:
    """Draws the best success rate so far over the number of evaluations, one line per study."""
    figure = Figure(figsize=(7, 3.2), layout="constrained")
    axes = figure.add_subplot()
    for title, results in studies.items():
        rates = [results[number].success_rate for number in sorted(results)]
        axes.step(range(1, len(rates) + 1), np.maximum.accumulate(rates) if rates else [], where="post", label=title)
    axes.set(xlabel="evaluations", ylabel="best success rate so far", ylim=(-0.03, 1.03))
    axes.legend()
    return figure


def pareto_front(scenario: Scenario, results: dict[int, Evaluation], best: list[int]) -> Figure:
    """Draws all evaluations by their two objectives, coloured by success rate, and the front."""
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.add_subplot()
    one, two = (objective.name for objective in scenario.objectives)
    points = np.array([[r.objectives[one], r.objectives[two]] for r in results.values()])
    shown = axes.scatter(points[:, 0], points[:, 1], c=[r.success_rate for r in results.values()], vmin=0, vmax=1, s=18)
    front = np.array(sorted([results[number].objectives[one], results[number].objectives[two]] for number in best))
    if best:  # else none is feasible
        axes.step(front[:, 0], front[:, 1], where="post" if _same_sense(scenario) else "pre", color="tab:red", lw=1)
    for number in best:
        values = results[number].objectives
        axes.annotate(str(number), (values[one], values[two]), fontsize=8, textcoords="offset points", xytext=(3, 3))
    senses = [f"{objective.name} ({objective.sense})" for objective in scenario.objectives]
    axes.set(xlabel=senses[0], ylabel=senses[1])
    figure.colorbar(shown, label="success rate")
    return figure


def spread(scenario: Scenario, results: dict[int, Evaluation], best: list[int]) -> Figure:
    """Draws the objectives of each repetition of the best configurations: how much randomisation changes them."""
    figure = Figure(figsize=(7, 2.6 * len(scenario.objectives)), layout="constrained")
    chosen = best[:_ROWS]
    for row, objective in enumerate(scenario.objectives):
        axes = figure.add_subplot(len(scenario.objectives), 1, row + 1)
        for place, number in enumerate(chosen):
            repetitions = results[number].repetitions
            colours = ["tab:green" if each.is_success else "tab:red" for each in repetitions]
            values = [each.objectives[objective.name] for each in repetitions]
            axes.scatter([place] * len(values), values, c=colours, s=16)
        axes.set(ylabel=objective.name, xlabel="evaluation (green: success)")
        axes.set_xticks(range(len(chosen)), [str(number) for number in chosen])
    return figure


def configurations(scenario: Scenario, results: dict[int, Evaluation]) -> Figure:
    """Draws the success rate over each variable."""
    variables = scenario.variables
    columns = min(4, len(variables))
    rows = math.ceil(len(variables) / columns)
    figure = Figure(figsize=(2.4 * columns, 2.4 * rows), layout="constrained")
    for index, variable in enumerate(variables):
        axes = figure.add_subplot(rows, columns, index + 1)
        values = [result.configuration[variable.name] for result in results.values()]
        shown = [str(value) for value in values] if variable.kind == "categorical" else values
        axes.scatter(shown, [result.success_rate for result in results.values()], s=10, alpha=0.6)
        unit = f" ({variable.unit})" if variable.unit else ""
        axes.set(xlabel=f"{variable.name}{unit}", ylim=(-0.05, 1.05))
    return figure


def importance(study: LearningStudy) -> Figure:
    """Draws the importance of the variables for each objective (fANOVA, by Optuna)."""
    figure = Figure(figsize=(7, 2.6), layout="constrained")
    axes = figure.add_subplot()
    names = [variable.name for variable in study.scenario.variables]
    height = 0.8 / len(study.scenario.objectives)
    evaluator = optuna.importance.FanovaImportanceEvaluator(seed=0)
    for index, objective in enumerate(study.scenario.objectives):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            try:
                target = functools.partial(_value_of, index=index)
                found = optuna.importance.get_param_importances(study.optuna, evaluator=evaluator, target=target)
            except (ValueError, RuntimeError):  # all values of the objective are equal
                found = {}
        places = np.arange(len(names)) + index * height
        axes.barh(places, [found.get(name, 0.0) for name in names], height, label=objective.name)
    axes.set_yticks(np.arange(len(names)) + 0.4 - height / 2, names)
    axes.set(xlabel="importance")
    axes.legend()
    return figure


# -- text --------------------------------------------------------------------------------------------------------------

_STYLE = (
    "body{font-family:sans-serif;max-width:60em;margin:2em auto}table{border-collapse:collapse}"
    "td,th{padding:.2em .7em;border-bottom:1px solid #ccc;text-align:right}pre{background:#f4f4f4;padding:1em}"
    "img{max-width:100%}"
)


def _value_of(trial: optuna.trial.FrozenTrial, index: int) -> float:
    return float(trial.values[index])


def _overview(study: LearningStudy, results: dict[int, Evaluation]) -> str:
    broken = [(number, result.error) for number, result in results.items() if result.error]
    scenario = study.scenario
    text = (
        f"<p>{len(results)} of {scenario.budget.evaluations} evaluations, {scenario.repetitions} executions each; "
        f"optimiser {scenario.optimiser}; seed {scenario.seed}; {len(broken)} evaluations are broken.</p>"
    )
    if broken:
        items = "".join(f"<li>{number}: {html.escape(error)}</li>" for number, error in broken[:_ROWS])
        text += f"<ul>{items}</ul>"
    return text


def _validation(study: LearningStudy) -> str:
    found = stored_validation(study)
    if found is None:
        return "<h2>Validation</h2><p>This study is not validated: the rates below are optimistic.</p>"
    objectives = study.scenario.objectives
    names = [variable.name for variable in study.scenario.variables]
    rows = [["configuration", "draws", "success", *(objective.name for objective in objectives), *names]]
    proof = [("proof", each) for each in (found.learned, found.defaults) if each is not None]
    for draws, sample in [*proof, *(("choice", each) for each in found.candidates)]:
        intervals = [sample.objective(objective.name) for objective in objectives]
        cells = [f"{each.estimate:.4g} ({each.low:.4g} to {each.high:.4g})" for each in intervals]
        values = [format_value(sample.configuration[name]) for name in names]
        rows.append([sample.name, draws, share_text(sample), *cells, *values])
    head, *body = ("".join(f"<td>{html.escape(cell)}</td>" for cell in row) for row in rows)
    text = "Draws that the search has not seen; one set of them chooses a configuration, another one proves it."
    table = f"<table><tr>{head.replace('td>', 'th>')}</tr>{''.join(f'<tr>{row}</tr>' for row in body)}</table>"
    return f"<h2>Validation</h2><p>{text} {html.escape(found.verdict)}.</p>{table}"


def _randomisation(scenario: Scenario) -> str:
    """Lists the randomised quantities. A report is also written where the scene is not, as on another machine."""
    try:
        found = find_quantities(scenario)
    except SkirosError as error:
        return f"<h2>Randomisation</h2><p>It cannot be listed: {html.escape(str(error))}</p>"
    if not found:
        return "<h2>Randomisation</h2><p>The execution reports no randomised quantities.</p>"
    rows = "".join(
        f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in (each.name, each.centre, each.spread))}</tr>"
        for each in found
    )
    head = "<tr><th>quantity</th><th>drawn around</th><th>spread</th></tr>"
    return f"<h2>Randomisation</h2><table>{head}{rows}</table>"


def _table(study: LearningStudy, results: dict[int, Evaluation]) -> str:
    best = study.best(results)
    if not best:
        return "<p>There is no result yet.</p>"
    objectives = [objective.name for objective in study.scenario.objectives]
    names = [variable.name for variable in study.scenario.variables]
    heads = ["evaluation", "success", *objectives, *names]
    rows = ""
    for number in best[:_ROWS]:
        result = results[number]
        cells: list[Any] = [number, search_share(result)]
        cells += [f"{result.objectives[name]:.4g}" for name in objectives]
        cells += [format_value(result.configuration[name]) for name in names]
        rows += "<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in cells) + "</tr>"
    head = "".join(f"<th>{html.escape(name)}</th>" for name in heads)
    return f"<h2>Pareto-optimal configurations</h2><table><tr>{head}</tr>{rows}</table>"


def _picture(title: str, figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    data = base64.b64encode(buffer.getvalue()).decode()
    return f"<h2>{title}</h2><img alt='{title}' src='data:image/png;base64,{data}'>"


def _same_sense(scenario: Scenario) -> bool:
    return len({objective.sense for objective in scenario.objectives}) == 1
