"""Gantt chart of a run: skill runs by robot, goals, and changes of the world model."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from skiros2_bags.core.action_call import Goal
from skiros2_bags.core.errors import BagError
from skiros2_bags.core.message import MONITOR, PROGRESS
from skiros2_bags.core.run import Run
from skiros2_bags.core.world_history import TimedChange
from skiros2_runs.core.history import SkillRun
from skiros2_runs.core.states import FAILURE, IDLE, RUNNING, SUCCESS

#: Colours of the final states; distinguishable by colour-blind people (Okabe and Ito's palette).
COLOURS: dict[int, str] = {SUCCESS: "#009E73", FAILURE: "#D55E00", RUNNING: "#56B4E9", IDLE: "#999999"}
_WORDS: dict[int, str] = {SUCCESS: "succeeded", FAILURE: "failed", RUNNING: "not ended", IDLE: "stopped"}
_CHANGE, _GOAL, _TEXT, _GRID = "#333333", "#CC79A7", "#222222", "#E4E4E4"

#: Inches.
_WIDTH, _ROW, _MARGIN = 12.0, 0.24, 1.6

#: Maximum number of rows; the deepest skills are omitted until the chart fits.
_MAX_ROWS = 120

#: Minimum width of a bar, as a fraction of the chart.
_MIN_WIDTH = 0.002

#: Changes by an author with more changes than this are marked only in the author's row.
_MAX_LINES = 100

#: Number of characters that fit into the width of the chart.
_MAX_LETTERS = 170


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
    shown = _visible(skills, depth)
    start = min([s.start for s in skills] + [g.time for g in goals], default=run.start)
    end = max([s.end for s in skills] + [g.end for g in goals if g.end is not None], default=run.end)
    visible_changes = [timed for timed in changes if start <= timed.time <= end]
    chart = _Chart(start, max(end - start, 1e-3), _rows(shown), _authors(visible_changes))
    chart.draw_skills(shown)
    chart.draw_goals(goals)
    chart.draw_changes(visible_changes)
    left_out = f", {len(skills) - len(shown)} deeper skills left out" if len(shown) < len(skills) else ""
    chart.finish(f"{run.path.name}: {end - start:.1f} s, {len(visible_changes)} changes of the world model{left_out}")
    return chart.figure


#: A row: a robot and the names of a skill and its ancestors. A robot alone is the heading of its rows.
Row = tuple[str, ...]


def _visible(skills: Sequence[SkillRun], depth: int) -> list[SkillRun]:
    """Returns the skills to draw."""
    chosen = [s for s in skills if depth == 0 or s.depth <= depth]
    while len(_rows(chosen)) > _MAX_ROWS and (deepest := max(s.depth for s in chosen)) > 1:
        chosen = [s for s in chosen if s.depth < deepest]
    return chosen


def _rows(skills: Sequence[SkillRun]) -> list[Row]:
    """Returns a row for each skill of each robot, after its parent's row, ordered by first start."""
    first: dict[Row, tuple[float, int]] = {}
    for order, skill in enumerate(skills):
        for row in ((skill.robot, *skill.path[:depth]) for depth in range(skill.depth + 1)):
            first[row] = min((skill.start, order), first.get(row, (skill.start, order)))
    return sorted(first, key=lambda row: [(row[0],), *(first[row[:n]] for n in range(2, len(row) + 1))])


def _authors(changes: Iterable[TimedChange]) -> list[str]:
    """Returns the authors of changes; the most frequent author, such as a reasoner that follows poses, is the last."""
    return [author for author, _ in reversed(Counter(timed.change.author for timed in changes).most_common())]


class _Chart:
    """The figure while it is drawn.

    :param start: time at its left edge (s since the epoch).
    :param span: its length (s).
    :param authors: of changes of the world model, one row each.
    """

    def __init__(self, start: float, span: float, rows: Sequence[Row], authors: Sequence[str]) -> None:
        self._start = start
        self._span = span
        self._rows = {row: number for number, row in enumerate(rows)}
        self._authors = {author: len(rows) + 2 + number for number, author in enumerate(authors)}
        self._states: set[int] = set()
        self._height = _MARGIN + _ROW * (len(rows) + len(authors) + 2)
        self.figure = Figure(figsize=(_WIDTH, self._height), dpi=110, layout="constrained")
        self._axes: Any = self.figure.add_subplot()

    def draw_skills(self, skills: Iterable[SkillRun]) -> None:
        for skill in skills:
            self._states.add(skill.state)
            y, left = self._rows[skill.robot, *skill.path], skill.start - self._start
            self._axes.barh(
                y, max(skill.duration, _MIN_WIDTH * self._span), left=left, height=0.74 if skill.depth == 1 else 0.5,
                color=COLOURS.get(skill.state, COLOURS[IDLE]), edgecolor="white", linewidth=0.4,
            )  # fmt: skip
            if skill.depth == 1:
                self._write(left, y, f"{skill.duration:.1f} s", skill.duration)

    def draw_goals(self, goals: Iterable[Goal]) -> None:
        y = len(self._rows)
        for goal in goals:
            left = goal.time - self._start
            length = (goal.end if goal.end is not None else self._start + self._span) - goal.time
            self._axes.barh(y, max(length, 0.0), left=left, height=0.6, color=_GOAL, alpha=0.9)
            self._write(left, y, f"{goal.state or 'no answer'}: {goal.goals}", length)

    def draw_changes(self, changes: Iterable[TimedChange]) -> None:
        times = defaultdict(list)
        for timed in changes:
            times[timed.change.author].append(timed.time - self._start)
        for author, at in times.items():
            y = self._authors[author]
            self._axes.vlines(at, y - 0.38, y + 0.38, colors=_CHANGE, linewidth=0.7)
            if len(at) <= _MAX_LINES:
                self._axes.vlines(at, -0.7, y - 0.38, colors=_CHANGE, linewidth=0.4, alpha=0.2, zorder=0)

    def finish(self, title: str) -> None:
        axes = self._axes
        labels = [("    " * (len(row) - 2) + row[-1], len(row) == 1) for row in self._rows]
        labels += [("goals", True), ("changes of the world model by", True)]
        labels += [(author or "(nobody)", False) for author in self._authors]
        label_x = -0.0078 * max(len(label) for label, _ in labels)
        for y, (label, is_title) in enumerate(labels):
            axes.text(label_x, y, label, transform=axes.get_yaxis_transform(), fontsize=8, va="center", color=_TEXT,
                      fontweight="bold" if is_title else "normal")  # fmt: skip
        axes.set_yticks([])
        axes.set_ylim(len(labels) - 0.4, -0.8)
        axes.set_xlim(-0.01 * self._span, 1.01 * self._span)
        axes.set_xlabel("time (s after the first goal or skill)", fontsize=9)
        axes.grid(axis="x", color=_GRID)
        axes.set_axisbelow(True)
        axes.tick_params(length=0, labelsize=8)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.set_title(title, fontsize=10, loc="left")
        handles: list[Any] = [Patch(color=COLOURS[s], label=_WORDS[s]) for s in COLOURS if s in self._states]
        handles += [Patch(color=_GOAL, label="goal"), Line2D([], [], color=_CHANGE, label="world model changed")]
        below = -0.6 / (_ROW * len(labels))
        axes.legend(
            handles=handles, loc="upper center", bbox_to_anchor=(0.5, below), ncols=6, fontsize=8, frameon=False
        )

    def _write(self, left: float, y: float, text: str, length: float) -> None:
        """Writes a text into a bar of the given length (s), shortened to fit."""
        letters = int(length / self._span * _MAX_LETTERS)
        if letters >= min(len(text), 5):
            shown = text if len(text) <= letters else f"{text[: letters - 1]}…"
            self._axes.text(left + 0.003 * self._span, y, shown, va="center", fontsize=6.5, color="white", clip_on=True)
