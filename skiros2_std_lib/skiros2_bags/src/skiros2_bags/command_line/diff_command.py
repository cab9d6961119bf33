"""The command `diff`."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict

from skiros2_bags.core.diff import Difference, Kind, diff_runs
from skiros2_bags.core.message import PROGRESS
from skiros2_bags.core.run import Run
from skiros2_common.command_line.command import REFUSED, CommandResult, UsageError
from skiros2_common.command_line.layout import Screen, table
from skiros2_runs.core.tolerance import Tolerance

#: Maximum number of differences to print without `--all`.
_MAX_ROWS = 20


def diff(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Compares a run with another one: the first divergence, then all differences."""
    if not 0 <= arguments.tolerance < math.inf:
        raise UsageError(f"--tolerance {arguments.tolerance}: expected a number of at least 0")
    other = Run.open(arguments.other)
    found = diff_runs(run, other, Tolerance(arguments.tolerance, arguments.tolerance))
    if not found:
        return CommandResult(["the runs are alike", *_times(run, other, screen)], [])
    shown = found if arguments.all else found[:_MAX_ROWS]
    lines = ["first divergence:", *_difference_lines(found[0], screen)]
    if len(found) > 1:
        lines += ["", "all differences:"]
        lines += [f"  {line}" for line in table(screen, map(_row, shown), ("at s", "what", "where", "expected", "got"))]
        lines += [f"  {len(found) - len(shown)} more: --all"] if len(shown) < len(found) else []
    lines += _times(run, other, screen)
    return CommandResult(lines, [asdict(difference) for difference in found], REFUSED)


def _difference_lines(difference: Difference, screen: Screen) -> list[str]:
    lines = [f"at {difference.time:.2f} s, {difference.kind}: {difference.where}"]
    lines += [f"expected: {difference.expected}"] if difference.expected else []
    return [screen.fitted(f"  {line}") for line in [*lines, f"got:      {difference.got}"]]


def _row(difference: Difference) -> tuple[str, ...]:
    time = "" if difference.kind == Kind.SCENE else f"{difference.time:.2f}"
    return time, difference.kind, difference.where, difference.expected, difference.got


def _times(run: Run, other: Run, screen: Screen) -> list[str]:
    """Returns a table of the time per skill in both runs."""
    totals = [_totals(r) for r in (run, other)]
    labels = dict.fromkeys([*totals[0], *totals[1]])
    rows = [(label, *(f"{t[label]:.2f}" if label in t else "" for t in totals)) for label in labels]
    if not rows:
        return []
    return ["", "time by skill:", *(f"  {line}" for line in table(screen, rows, ("skill", "expected s", "got s")))]


def _totals(run: Run) -> dict[str, float]:
    totals: dict[str, float] = {}
    for skill in run.skills() if PROGRESS in run.topics.values() else []:
        if skill.depth == 1:
            totals[skill.label] = totals.get(skill.label, 0.0) + skill.duration
    return totals
