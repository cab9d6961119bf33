"""The pictures of a study, for its report and the window."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import matplotlib

matplotlib.use("Agg")

import numpy as np
import optuna
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox
from threadpoolctl import threadpool_limits

from skiros2_learning.core.evaluation import Evaluation
from skiros2_learning.core.ranking import is_feasible, objective_costs, ranked
from skiros2_learning.core.samplers import conditions_of, distribution_of, prior_of
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.search_space import Array, SearchSpace
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.surrogate import fit_surrogate
from skiros2_learning.core.validation import Sample, Validation, stored_validation
from skiros2_learning.core.variables import Variable

#: Evaluations from which on the importance of the parameters is estimated.
LEAST_FOR_IMPORTANCE = 10
#: Configurations of the spread, and the part of the best evaluations that counts as good beside the priors.
_SHOWN, _GOOD, _LEAST_GOOD = 8, 0.15, 3
#: Points of a partial dependence, and evaluations over which it is averaged.
_GRID, _AVERAGED = 40, 100
#: Offsets of labels (points), tried in this order.
_PLACES = [
    (round(r * math.cos(angle)), round(r * math.sin(angle)))
    for r in (9, 17, 28, 42)
    for angle in np.radians((45, 135, 315, 225, 0, 90, 180, 270))
]


def draw_pictures(study: LearningStudy, others: Mapping[str, LearningStudy] | None = None) -> dict[str, Figure]:
    """Draws all pictures of a study for which it has enough results, by title.

    :param others: studies of the same scenario, to compare with, by title.
    """
    scenario, found = study.scenario, stored_validation(study)
    results = _complete(study)
    if not results:
        return {}
    studies = {"this study": results, **{title: _complete(each) for title, each in (others or {}).items()}}
    pictures = {"Progress": progress(scenario, studies)}
    best = study.best(results)
    if len(scenario.objectives) == 2:
        pictures["Pareto front"] = pareto_front(scenario, results, best, found)
    pictures["Spread over repetitions"] = spread(scenario, results, found)
    pictures["Parameters and results"] = dependence(scenario, results)
    pictures["Priors and good values"] = priors(scenario, results, found)
    if len(results) >= LEAST_FOR_IMPORTANCE:
        pictures["Importance of the parameters"] = importance(study)
    return pictures


def progress(scenario: Scenario, studies: Mapping[str, Mapping[int, Evaluation]]) -> Figure:
    """Draws success rate, objectives and hypervolume over the evaluations: each evaluation, and the best feasible
    one so far."""
    names = ["success rate", *(each.name for each in scenario.objectives)]
    rows = [*names, "hypervolume"] if len(names) > 2 else names
    figure, axes = _grid(len(rows), 2, 2.3)
    volumes = hypervolumes(scenario, list(studies.values())) if len(names) > 2 else []
    for index, (title, results) in enumerate(studies.items()):
        ended = [results[number] for number in sorted(results)]
        count, colour = np.arange(1, len(ended) + 1), f"C{index}"
        feasible = np.array([is_feasible(each) and not each.is_truncated for each in ended], dtype=bool)
        for row, name in enumerate(names):
            values = np.array([each.objectives[name] if row else each.success_rate for each in ended])
            sign = -1.0 if row and scenario.objectives[row - 1].sense == "minimise" else 1.0
            counted = np.where(feasible | (row == 0), sign * values, -np.inf)
            best = np.maximum.accumulate(counted) if len(counted) else counted
            axes[row].scatter(count, values, s=7, alpha=0.35, color=colour, linewidths=0)
            shown = np.isfinite(best)
            axes[row].step(count[shown], sign * best[shown], where="post", label=title, color=colour)
        if volumes:
            axes[-1].step(count, volumes[index], where="post", label=title, color=colour)
    for place, name in zip(axes, rows, strict=True):
        place.set(xlabel="evaluations", ylabel=name)
    for row, objective in enumerate(scenario.objectives, 1):
        values = np.array([r.objectives[objective.name] for each in studies.values() for r in each.values()])
        axes[row].set(ylim=robust_limits(values), ylabel=f"{objective.name} ({objective.sense})")
    axes[0].set_ylim(-0.04, 1.04)
    axes[0].legend(fontsize=8)
    return figure


def hypervolumes(scenario: Scenario, studies: Sequence[Mapping[int, Evaluation]]) -> list[list[float]]:
    """Returns, for each study, the hypervolume of the feasible evaluations so far, after each evaluation: as a part of
    the box between the best and the worst values of all."""
    good = [r for each in studies for r in each.values() if is_feasible(r) and not r.is_truncated]
    if not good:
        return [[0.0] * len(each) for each in studies]
    costs = np.array([objective_costs(scenario, each) for each in good])
    low = costs.min(axis=0)
    width = np.maximum(costs.max(axis=0) - low, 1e-12) * 1.05
    found = []
    for results in studies:
        front: list[Array] = []
        volumes: list[float] = []
        for number in sorted(results):
            result = results[number]
            if is_feasible(result) and not result.is_truncated:
                point = (np.array(objective_costs(scenario, result)) - low) / width
                if not any((other <= point).all() for other in front):
                    front = [each for each in front if not (point <= each).all()] + [point]
            volumes.append(_volume(np.array(front), np.ones(len(low))) if front else 0.0)
        found.append(volumes)
    return found


def pareto_front(
    scenario: Scenario, results: Mapping[int, Evaluation], best: Sequence[int], validation: Validation | None = None
) -> Figure:
    """Draws the evaluations by their two objectives, and the front. Axes cover the feasible ones without outliers;
    others are at the edge."""
    figure = Figure(figsize=(8.4, 4.4), layout="constrained")
    axes = figure.add_subplot()
    names = [objective.name for objective in scenario.objectives]
    points = np.array([[each.objectives[name] for name in names] for each in results.values()])
    feasible = np.array([is_feasible(each) for each in results.values()], dtype=bool)
    front = np.array(sorted([results[number].objectives[name] for name in names] for number in best))
    shown = points[feasible] if feasible.any() else points
    limits = [robust_limits(shown[:, i], front[:, i] if best else ()) for i in (0, 1)]
    inside = np.column_stack([np.clip(points[:, i], *limits[i]) for i in (0, 1)])
    is_outside = (inside != points).any(axis=1)
    rates = np.array([each.success_rate for each in results.values()])
    style: dict[str, Any] = {"vmin": 0, "vmax": 1, "cmap": "viridis", "clip_on": False, "zorder": 3}
    dots = axes.scatter(inside[feasible, 0], inside[feasible, 1], c=rates[feasible], s=24, label="evaluation", **style)
    if not feasible.all():
        bad = inside[~feasible]
        axes.scatter(bad[:, 0], bad[:, 1], c=rates[~feasible], s=22, marker="x", lw=1, label="not feasible", **style)
    if best:
        same = len({objective.sense for objective in scenario.objectives}) == 1
        axes.step(front[:, 0], front[:, 1], where="post" if same else "pre", color="tab:red", lw=1, label="front")
    number = validation.learned.number if validation is not None else None
    if number is not None and number in results:
        chosen = list(results).index(number)
        style = {"facecolors": "none", "edgecolors": "tab:red", "clip_on": False}
        axes.scatter(inside[chosen, 0], inside[chosen, 1], s=130, marker="o", label="validated", **style)
        best = [number, *(each for each in best if each != number)]
    axes.set(xlim=limits[0], ylim=limits[1])
    axes.set(**{f"{key}label": f"{o.name} ({o.sense})" for key, o in zip("xy", scenario.objectives, strict=True)})
    if is_outside.any():
        axes.set_title(f"{is_outside.sum()} evaluations are outside of the picture, drawn at its edge", fontsize=8)
    axes.legend(fontsize=8, loc="best")
    figure.colorbar(dots, label="success rate")
    order = list(results)
    place_labels(axes, {str(number): tuple(inside[order.index(number)]) for number in best})
    return figure


def place_labels(axes: Axes, labels: Mapping[str, tuple[float, float]]) -> None:
    """Writes labels beside points, the first ones first: a label that would overlap another one everywhere is left
    out."""
    figure = axes.figure
    assert isinstance(figure, Figure)
    figure.draw_without_rendering()
    legend, frame = axes.get_legend(), axes.get_window_extent()
    taken = [legend.get_window_extent()] if legend is not None else []
    dots = [
        Bbox.from_bounds(x - 3, y - 3, 6, 6) for x, y in axes.transData.transform(list(labels.values()) or [(0, 0)])
    ]
    for text, point in labels.items():
        for offset in _PLACES:
            note = axes.annotate(
                text, point, xytext=offset, textcoords="offset points", fontsize=8, ha="center", va="center",
                arrowprops={"arrowstyle": "-", "lw": 0.4, "color": "gray"} if max(map(abs, offset)) > 10 else None,
            )  # fmt: skip
            note.get_window_extent()  # places it
            box = Text.get_window_extent(note)  # without the line to its point
            if frame.contains(*box.min) and frame.contains(*box.max) and not box.count_overlaps([*taken, *dots]):
                taken.append(box)
                break
            note.remove()


def robust_limits(values: Array, needed: Iterable[float] = ()) -> tuple[float, float]:
    """Returns limits of an axis without outliers: the quartiles, and up to 1.5 times their distance beyond; with values
    that are needed."""
    first, third = np.percentile(values, (25, 75))
    reach = 1.5 * (third - first)
    inside = values[(values >= first - reach) & (values <= third + reach)]
    ends = np.array([*inside, *needed])
    low, high = float(ends.min()), float(ends.max())
    margin = 0.06 * (high - low) or 0.05 * abs(high) or 0.05
    return low - margin, high + margin


def spread(scenario: Scenario, results: Mapping[int, Evaluation], validation: Validation | None = None) -> Figure:
    """Draws the objectives of each repetition of the best configurations, and of the validation: how much randomisation
    changes them."""
    columns: dict[str, Sequence[Any]] = {}
    for sample in _proof(validation):
        columns["defaults" if sample.number is None else f"{sample.number}\nvalidated"] = sample.repetitions
    for number in ranked(scenario, results, results)[:_SHOWN]:
        columns[str(number)] = results[number].repetitions
    figure, axes = _grid(len(scenario.objectives), 1, 2.4)
    random = np.random.default_rng(0)
    for place, objective in zip(axes, scenario.objectives, strict=True):
        for index, repetitions in enumerate(columns.values()):
            values = [each.objectives[objective.name] for each in repetitions]
            colours = ["tab:green" if each.is_success else "tab:red" for each in repetitions]
            place.scatter(index + random.uniform(-0.18, 0.18, len(values)), values, c=colours, s=14, alpha=0.7, lw=0)
        place.set(ylabel=objective.name, xticks=range(len(columns)))
        place.set_xticklabels(columns, fontsize=8)
    axes[-1].set_xlabel("evaluation; each dot is a repetition (green: success)")
    return figure


def dependence(scenario: Scenario, results: Mapping[int, Evaluation]) -> Figure:
    """Draws success rate and objectives over each variable: the evaluations, and the partial dependence of a Gaussian
    process with its deviation: the mean over the evaluations if only this variable were another one."""
    names = ["success rate", *(each.name for each in scenario.objectives)]
    variables = scenario.variables
    figure, axes = _grid(len(names) * len(variables), len(variables), 1.9)
    space = SearchSpace({each.name: distribution_of(each) for each in variables}, {}, conditions_of(scenario))
    points = space.points([SimpleNamespace(params=each.configuration) for each in results.values()])
    random = np.random.default_rng(scenario.seed)
    order = {name: index for index, name in enumerate(sorted(each.name for each in variables))}
    for row, name in enumerate(names):
        values = np.array([each.objectives[name] if row else each.success_rate for each in results.values()])
        limits = robust_limits(values) if row else (-0.06, 1.06)
        values = np.clip(values, *limits)
        with threadpool_limits(1):
            model = fit_surrogate(points, values, random, nominal=space.nominal) if len(points) > 2 else None
            for column, variable in enumerate(variables):
                place = axes[row * len(variables) + column]
                exists = np.array([variable.name in each.configuration for each in results.values()], dtype=bool)
                at = _places(variable, results.values())
                place.scatter(at, values[exists], s=7, alpha=0.4, lw=0, clip_on=False)
                if model is not None and exists.any():
                    base = random.permutation(points[exists])[:_AVERAGED]
                    grid, units = _units(variable, space.nominal[order[variable.name]])
                    mean, deviation = _partial(model.predict, space, base, order[variable.name], units)
                    place.plot(grid, mean, color="tab:red", lw=1.2, marker="" if len(grid) == _GRID else "o", ms=3)
                    place.fill_between(grid, mean - deviation, mean + deviation, color="tab:red", alpha=0.15, lw=0)
                place.set(ylim=limits)
                _scale(place, variable)
                if column:
                    place.set_yticklabels([])
                else:
                    place.set_ylabel(name, fontsize=9)
                if row == len(names) - 1:
                    place.set_xlabel(_title(variable), fontsize=8)
    return figure


def priors(scenario: Scenario, results: Mapping[int, Evaluation], validation: Validation | None = None) -> Figure:
    """Draws the prior of each variable, the values of the best evaluations, the validated one and the default."""
    variables = scenario.variables
    figure, axes = _grid(len(variables), min(4, len(variables)), 1.9)
    count = max(_LEAST_GOOD, round(_GOOD * len(results)))
    good = [results[number] for number in ranked(scenario, results, results)[:count]]
    for place, variable in zip(axes, variables, strict=True):
        grid, _ = _units(variable, False)
        values = variable.values or grid
        prior = prior_of(variable)
        heights = np.exp([prior.log_density(value) for value in values]) if prior else np.ones(len(values))
        if variable.values:
            place.bar(grid, heights / heights.max(), color="lightgray", label="prior")
        else:
            place.fill_between(grid, heights / heights.max(), color="lightgray", lw=0, label="prior")
        at = _places(variable, good)
        label = f"best {len(good)} of the search"
        place.plot(at, np.linspace(0.06, 0.3, len(at)), ".", color="tab:blue", ms=6, label=label)
        for sample in _proof(validation):
            style, label = ("--", "default") if sample.number is None else ("-", "validated")
            for value in _places(variable, [sample]):
                place.axvline(value, color="tab:red", lw=1.3, ls=style, label=label)
        place.set(yticks=[], ylim=(0, 1.1))
        _scale(place, variable)
        place.set_xlabel(_title(variable), fontsize=8)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=8)
    return figure


def importance(study: LearningStudy) -> Figure:
    """Draws the importance of the variables that always exist for each objective (fANOVA, by Optuna)."""
    names = [variable.name for variable in study.scenario.variables if not variable.only_if]
    figure = Figure(figsize=(8.4, 0.8 + 0.4 * len(names)), layout="constrained")
    axes = figure.add_subplot()
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
    axes.set(xlabel="importance: part of the variance that a parameter explains")
    axes.legend(fontsize=8)
    return figure


# -- internal ----------------------------------------------------------------------------------------------------------


def _complete(study: LearningStudy) -> dict[int, Evaluation]:
    return {number: result for number, result in study.results().items() if not result.error}


def _proof(validation: Validation | None) -> list[Sample]:
    found = (validation.learned, validation.defaults) if validation is not None else ()
    return [each for each in found if each is not None]


def _value_of(trial: optuna.trial.FrozenTrial, index: int) -> float:
    return float(trial.values[index])


def _grid(count: int, columns: int, height: float) -> tuple[Figure, list[Axes]]:
    """Returns a figure with plots in rows.

    :param height: of a row (inches).
    """
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(8.4, height * rows), layout="constrained")
    axes = [figure.add_subplot(rows, columns, index + 1) for index in range(count)]
    for each in axes:
        each.grid(alpha=0.25, lw=0.5)
        each.tick_params(labelsize=7)
        each.ticklabel_format(useOffset=False)
    return figure, axes


def _volume(costs: Array, corner: Array) -> float:
    """Returns the volume that costs dominate, up to a corner: slice by slice of the last one."""
    if len(corner) == 1:
        return float(corner[0] - costs.min())
    ordered = costs[costs[:, -1].argsort()]
    ends = [*ordered[1:, -1], corner[-1]]
    slices = enumerate(zip(ordered, ends, strict=True), 1)
    return math.fsum((end - row[-1]) * _volume(ordered[:i, :-1], corner[:-1]) for i, (row, end) in slices)


def _units(variable: Variable, nominal: bool) -> tuple[Array, Array]:
    """Returns places on the axis of a variable, and the same as inputs of the search space."""
    if variable.values:
        places = np.arange(len(variable.values), dtype=float)
        return places, places if nominal else places / max(1, len(places) - 1)
    units = np.linspace(0.0, 1.0, _GRID)
    if variable.scale == "log":
        return variable.low * (variable.high / variable.low) ** units, units
    return variable.low + units * (variable.high - variable.low), units


def _partial(
    predict: Callable[[Array], tuple[Array, Array]], space: SearchSpace, base: Array, column: int, units: Array
) -> tuple[Array, Array]:
    moved = np.repeat(base[None], len(units), axis=0)
    moved[:, :, column] = units[:, None]
    mean, deviation = predict(space.rounded(moved.reshape(-1, base.shape[1])))
    shape = len(units), len(base)
    return mean.reshape(shape).mean(axis=1), deviation.reshape(shape).mean(axis=1)


def _places(variable: Variable, found: Iterable[Evaluation | Sample]) -> list[float]:
    """Returns where the values of a variable are on its axis, as far as it exists."""
    values = [each.configuration[variable.name] for each in found if variable.name in each.configuration]
    return [float(variable.values.index(value) if variable.values else value) for value in values]


def _scale(axes: Axes, variable: Variable) -> None:
    if variable.values:
        axes.set_xticks(range(len(variable.values)), [str(value) for value in variable.values])
        axes.set_xlim(-0.5, len(variable.values) - 0.5)
    else:
        axes.set_xscale(variable.scale)
        axes.set_xlim(variable.low, variable.high)
        if variable.scale == "linear":
            axes.xaxis.set_major_locator(MaxNLocator(4))


def _title(variable: Variable) -> str:
    return f"{variable.name} ({variable.unit})" if variable.unit else variable.name
