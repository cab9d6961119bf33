"""The command `engines` of `rosrun skiros2_task`."""

from __future__ import annotations

import argparse
from contextlib import closing

from skiros2_common.command_line.command import CommandResult
from skiros2_common.command_line.layout import Screen
from skiros2_task.core.engine_processes import EngineProcesses
from skiros2_task.core.portfolio import Wish


def engines(_: argparse.Namespace, __: Screen) -> CommandResult:
    """Lists what can make plans: the wishes, and the engines of unified-planning that are installed."""
    with closing(EngineProcesses()) as processes:
        names = processes.engines()
    lines = [f"{wish.value:<20} {_MEANINGS[wish]}" for wish in Wish]
    lines += [f"{name:<20} {_NOTES.get(name, 'engine of unified-planning')}" for name in names]
    return CommandResult(lines, {"wishes": [wish.value for wish in Wish], "engines": list(names)})


_MEANINGS = {
    Wish.FIRST: "the first plan, or a better one that comes a little later",
    Wish.BEST: "the plan with the smallest makespan that is found in the time",
    Wish.OPTIMAL: "a plan with the fewest steps",
}
_NOTES = {"fast-downward": "the default: first plan"}
