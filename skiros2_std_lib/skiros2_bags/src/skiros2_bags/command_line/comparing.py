"""The command that compares two runs."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict

from skiros2_bags.core.contract_types import PROGRESS
from skiros2_bags.core.differences import Difference, Kind, differences
from skiros2_bags.core.normal import Tolerance
from skiros2_bags.core.run import Run
from skiros2_common.command_line.command import REFUSED, CommandResult, UsageError
from skiros2_common.command_line.layout import Screen, table

#: So many differences are shown, unless all are wanted.
_SHOWN = 20


def diff(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """What was otherwise in another run: where they part first, then the rest."""
    if not 0 <= arguments.tolerance < math.inf:
        raise UsageError(f"--tolerance {arguments.tolerance}: expected a number of at least 0")
    other = Run.open(arguments.other)
    found = differences(run, other, Tolerance(arguments.tolerance, arguments.tolerance))
    if not found:
        return CommandResult(["the runs are alike", *_times(run, other, screen)], [])
    shown = found if arguments.all else found[:_SHOWN]
    lines = ["first divergence:", *_told(found[0], screen)]
    if len(found) > 1:
        lines += ["", "all differences:"]
        lines += [f"  {line}" for line in table(screen, map(_row, shown), ("at s", "what", "where", "expected", "got"))]
        lines += [f"  {len(found) - len(shown)} more: --all"] if len(shown) < len(found) else []
    lines += _times(run, other, screen)
    return CommandResult(lines, [asdict(difference) for difference in found], REFUSED)


def _told(difference: Difference, screen: Screen) -> list[str]:
    lines = [f"at {difference.time:.2f} s, {difference.kind}: {difference.where}"]
    lines += [f"expected: {difference.expected}"] if difference.expected else []
    return [screen.fitted(f"  {line}") for line in [*lines, f"got:      {difference.got}"]]


def _row(difference: Difference) -> tuple[str, ...]:
    time = "" if difference.kind == Kind.SCENE else f"{difference.time:.2f}"
    return time, difference.kind, difference.where, difference.expected, difference.got


def _times(run: Run, other: Run, screen: Screen) -> list[str]:
    """How long both took, by skill."""
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
