"""The command that draws a run."""

from __future__ import annotations

import argparse

from skiros2_bags.core.run import Run
from skiros2_common.command_line.command import CommandResult
from skiros2_common.command_line.layout import Screen


def plot(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Draws when each skill ran, by robot, and where the world model changed, as a PNG."""
    from skiros2_bags.core.gantt import save_gantt  # takes a second

    output = arguments.output or run.path.with_suffix(".png")
    save_gantt(run, output, arguments.depth)
    return CommandResult([str(output)], {"file": str(output)})
