"""The report of a study: one HTML file with pictures, and a summary for the terminal."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from skiros2_common.core.errors import SkirosError
from skiros2_learning.core.evaluation import Evaluation, find_quantities, seed_of
from skiros2_learning.core.pictures import draw_pictures
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.study import SCENARIO_FILE, LearningStudy
from skiros2_learning.core.validation import sample_text, stored_validation, validation_lines
from skiros2_learning.core.variables import Value
from skiros2_learning.core.versions import versions_of

#: Configurations in the table of the report.
_ROWS = 15


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
    sections = [_overview(study, results), _chosen(study), _validation(study), _table(study, results)]
    drawn = {**draw_pictures(study, others), **(pictures or {})}
    sections += [_picture(title, figure) for title, figure in drawn.items()]
    sections.append(_randomisation(study.scenario))
    sections.append(_repetition(study))
    source = html.escape(study.scenario.source)
    sections.append(f"<details><summary>Scenario</summary><pre>{source}</pre></details>")
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


def format_value(value: Value | None) -> str:
    """Returns a value with four significant digits; a dash for a variable that does not exist."""
    if value is None:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


# -- text --------------------------------------------------------------------------------------------------------------

_STYLE = (
    "body{font-family:sans-serif;max-width:60em;margin:2em auto;padding:0 1em;line-height:1.4}"
    "table{border-collapse:collapse;font-size:90%}div{overflow-x:auto}"
    "td,th{padding:.2em .7em;border-bottom:1px solid #ccc;text-align:right;white-space:nowrap}"
    "td:first-child,th:first-child{text-align:left;padding-left:0}pre{background:#f4f4f4;padding:1em;overflow-x:auto}"
    "img{max-width:100%}figcaption,.hint{color:#555;font-size:90%}figure{margin:0}"
)
#: What the pictures show, by title.
_CAPTIONS = {
    "Progress": "Dots: evaluations; lines: the best feasible one so far. The rates of the search are optimistic. The "
    "hypervolume is a part of the box between the best and the worst objectives of the feasible evaluations.",
    "Pareto front": "Means over the repetitions of each evaluation.",
    "Spread over repetitions": "The validated configurations with new draws, and the best evaluations of the search.",
    "Parameters and results": "Dots: evaluations. Lines: partial dependence, the mean over all evaluations if "
    "only this parameter were another one, with the deviation of the model. Outliers are at the edge.",
    "Priors and good values": "Density of each prior, and the values that were good.",
}


def _rows(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """Returns a table."""
    cells = ["".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) for row in (head, *rows)]
    body = "".join(f"<tr>{row}</tr>" for row in (cells[0].replace("td>", "th>"), *cells[1:]))
    return f"<div><table>{body}</table></div>"


def _chosen(study: LearningStudy) -> str:
    """The result: the configuration that the validation has chosen, or a hint."""
    found = stored_validation(study)
    if found is None:
        return ""
    sample, unit = found.decided, {variable.name: variable.unit for variable in study.scenario.variables}
    values = [f"{format_value(value)} {unit.get(name, '')}".strip() for name, value in sample.configuration.items()]
    compared = [each for each in (found.learned, found.defaults) if each is not None]
    items = (
        f"<li>{html.escape(f'{each.name}: {sample_text(study.scenario.objectives, each)}')}</li>" for each in compared
    )
    text = f"<p>{html.escape(found.verdict)}.</p><ul>{''.join(items)}</ul>"
    return f"<h2>Result</h2>{text}{_rows(list(sample.configuration), [values])}"


def _repetition(study: LearningStudy) -> str:
    """How to repeat the study: commands, seeds, versions."""
    scenario = study.scenario
    seeds = f"The seed of the study is {scenario.seed}; that of evaluation N is {seed_of(scenario, 0)} + N."
    commands = [
        f"learn replay {study.folder} N  # an evaluation again, and whether the result is the same",
        f"learn run {study.folder / SCENARIO_FILE} --study OTHER  # the whole study",
    ]
    versions = [", ".join(f"{name} {version}" for name, version in each.items()) for each in versions_of(study)]
    text = "".join(f"<p>Run with {html.escape(each)}.</p>" for each in versions)
    hint = "A study with one process is the same again; with several, the order in which evaluations end differs."
    return f"<h2>To repeat it</h2><p>{seeds} {hint}</p>{text}<pre>{html.escape(chr(10).join(commands))}</pre>"


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
    head = ["configuration", "draws", "success", *(objective.name for objective in objectives), *names]
    rows = []
    proof = [("proof", each) for each in (found.learned, found.defaults) if each is not None]
    for draws, sample in [*proof, *(("choice", each) for each in found.candidates)]:
        intervals = [sample.objective(objective.name) for objective in objectives]
        cells = [f"{each.estimate:.4g} ({each.low:.4g} to {each.high:.4g})" for each in intervals]
        values = [format_value(sample.configuration.get(name)) for name in names]
        share = f"{sample.good} of {sample.count} ({sample.success.low * 100:.0f} to {sample.success.high * 100:.0f} %)"
        rows.append([sample.name, draws, share, *cells, *values])
    text = "Draws that the search has not seen: one set of them chooses a configuration, another one proves it. In "
    return f"<h2>Validation</h2><p>{text}parentheses: 95 % intervals.</p>{_rows(head, rows)}"


def _randomisation(scenario: Scenario) -> str:
    """Lists the randomised quantities. A report is also written where the scene is not, as on another machine."""
    try:
        found = find_quantities(scenario)
    except SkirosError as error:
        return f"<h2>Randomisation</h2><p>It cannot be listed: {html.escape(str(error))}</p>"
    if not found:
        return "<h2>Randomisation</h2><p>The execution reports no randomised quantities.</p>"
    rows = ((each.name, each.centre, each.spread) for each in found)
    return f"<h2>Randomisation</h2>{_rows(('quantity', 'drawn around', 'spread'), rows)}"


def _table(study: LearningStudy, results: dict[int, Evaluation]) -> str:
    best = study.best(results)
    if not best:
        return "<p>There is no result yet.</p>"
    objectives = [objective.name for objective in study.scenario.objectives]
    names = [variable.name for variable in study.scenario.variables]
    heads = ["evaluation", "success", *objectives, *names]
    rows = []
    for number in best[:_ROWS]:
        result = results[number]
        cells = [f"{result.objectives[name]:.4g}" for name in objectives]
        cells += [format_value(result.configuration.get(name)) for name in names]
        rows.append([number, search_share(result), *cells])
    hint = "<p class='hint'>Of the search: means of few repetitions, of which the best had luck.</p>"
    return f"<h2>Pareto-optimal configurations</h2>{hint}{_rows(heads, rows)}"


def _picture(title: str, figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    data = base64.b64encode(buffer.getvalue()).decode()
    image = f"<img alt='{title}' width='{figure.get_figwidth() * 96:.0f}' src='data:image/png;base64,{data}'>"
    return f"<h2>{title}</h2><figure>{image}<figcaption>{_CAPTIONS.get(title, '')}</figcaption></figure>"
