"""Gantt chart of a run: skill runs by robot, goals, and changes of the world model."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from skiros2_bags.core.bag_file import MONITOR, PROGRESS, BagError
from skiros2_bags.core.run import Run
from skiros2_runs.core.history import SkillRecord
from skiros2_runs.core.states import FAILURE, IDLE, RUNNING, SUCCESS

#: Colour and word of each final state; distinguishable by colour-blind people (Okabe and Ito's palette).
_STATES: dict[int, tuple[str, str]] = {
    SUCCESS: ("#009E73", "succeeded"),
    FAILURE: ("#D55E00", "failed"),
    RUNNING: ("#56B4E9", "not ended"),
    IDLE: ("#999999", "stopped"),
}
_CHANGE, _GOAL = "#333333", "#CC79A7"

#: Inches: width of the chart, and height of a row and of the margins.
_WIDTH, _ROW, _MARGIN = 12.0, 0.24, 1.6

#: Maximum number of rows; the deepest skills are omitted until the chart fits.
_MAX_ROWS = 120

#: Minimum width of a bar, as a fraction of the chart.
_MIN_WIDTH = 0.002

#: A row: a robot and the names of a skill and its ancestors. A robot alone is the heading of its rows.
Row = tuple[str, ...]


def save_gantt(run: Run, path: Path, depth: int = 0) -> None:
    """Draws a run as a PNG. Takes about a second.

    :param depth: maximum depth of skills in the tree (1: skills of the task request); 0: as many as fit.
    :raises BagError: the bag has neither skills nor changes of the world model, or the file cannot be written.
    """
    figure = gantt(run, depth)
    try:
        FigureCanvasAgg(figure).print_figure(str(path), format="png")
    except OSError as error:
        raise BagError(f"{path}: the picture cannot be written: {error.strerror}") from error


def gantt(run: Run, depth: int = 0) -> Figure:
    """Returns the chart that `save_gantt` saves."""
    skills = run.skills() if PROGRESS in run.topics.values() else []
    changes = run.changes() if MONITOR in run.topics.values() else []
    goals = run.goals()
    if not skills and not changes:
        raise BagError(f"{run.path}: nothing to draw: neither skills nor changes of the world model")
    start = min([s.start for s in skills] + [g.time for g in goals], default=run.start)
    end = max([s.end for s in skills] + [g.end for g in goals if g.end is not None], default=run.end)
    span = max(end - start, 1e-3)
    by_author = defaultdict(list)
    for timed in changes:
        if start <= timed.time <= end:
            by_author[timed.change.author].append(timed.time - start)
    shown = _visible(skills, depth)
    rows = _rows(shown)
    labels = [("    " * (len(row) - 2) + row[-1], len(row) == 1) for row in rows]
    labels += [("goals", True), ("changes of the world model by", True)]
    labels += [(author or "(nobody)", False) for author in by_author]

    figure = Figure(figsize=(_WIDTH, _MARGIN + _ROW * len(labels)), dpi=110, layout="constrained")
    axes: Any = figure.add_subplot()
    for skill in shown:
        axes.barh(
            rows.index((skill.robot, *skill.path)), max(skill.duration, _MIN_WIDTH * span), left=skill.start - start,
            height=0.74 if skill.depth == 1 else 0.5, color=_STATES.get(skill.state, _STATES[IDLE])[0],
        )  # fmt: skip
    for goal in goals:
        length = (goal.end if goal.end is not None else end) - goal.time
        axes.barh(len(rows), max(length, 0.0), left=goal.time - start, height=0.6, color=_GOAL)
        text = f"{goal.state or 'no answer'}: {goal.goals}"
        axes.text(goal.time - start, len(rows), text, va="center", fontsize=6.5, color="white", clip_on=True)
    for y, times in enumerate(by_author.values(), len(rows) + 2):
        axes.vlines(times, y - 0.38, y + 0.38, colors=_CHANGE, linewidth=0.7)

    axes.set_yticks(range(len(labels)), [label for label, _ in labels], ha="left", fontsize=8)
    axes.tick_params(axis="y", length=0, pad=6 * max(len(label) for label, _ in labels))
    for tick, (_, is_title) in zip(axes.get_yticklabels(), labels, strict=True):
        tick.set_fontweight("bold" if is_title else "normal")
    axes.set_ylim(len(labels) - 0.4, -0.8)
    axes.set_xlim(-0.01 * span, 1.01 * span)
    axes.set_xlabel("time (s after the first goal or skill)", fontsize=9)
    axes.grid(axis="x", alpha=0.3)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    left_out = f", {len(skills) - len(shown)} deeper skills left out" if len(shown) < len(skills) else ""
    axes.set_title(f"{run.path.name}: {span:.1f} s, {len(changes)} changes of the world model{left_out}", loc="left")
    handles = [Patch(color=colour, label=word) for colour, word in (*_STATES.values(), (_GOAL, "goal"))]
    figure.legend(handles=handles, loc="outside lower center", ncols=6, fontsize=8, frameon=False)
    return figure


def _visible(skills: Sequence[SkillRecord], depth: int) -> list[SkillRecord]:
    """Returns the skills to draw."""
    chosen = [s for s in skills if depth == 0 or s.depth <= depth]
    while len(_rows(chosen)) > _MAX_ROWS and (deepest := max(s.depth for s in chosen)) > 1:
        chosen = [s for s in chosen if s.depth < deepest]
    return chosen


def _rows(skills: Sequence[SkillRecord]) -> list[Row]:
    """Returns a row for each skill of each robot, after its parent's row, ordered by first start."""
    first: dict[Row, tuple[float, int]] = {}
    for order, skill in enumerate(skills):
        for row in ((skill.robot, *skill.path[:depth]) for depth in range(skill.depth + 1)):
            first[row] = min((skill.start, order), first.get(row, (skill.start, order)))
    return sorted(first, key=lambda row: [(row[0],), *(first[row[:n]] for n in range(2, len(row) + 1))])
