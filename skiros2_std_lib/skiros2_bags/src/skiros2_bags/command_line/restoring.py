"""The command that makes a running world model as it was in a bag."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from skiros2_bags.core.moments import moment, relative
from skiros2_bags.core.restoring import restore as restore_scene
from skiros2_bags.core.run import Run
from skiros2_common.command_line.command import CommandResult, user
from skiros2_common.command_line.layout import Screen


def restore(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Makes the scene of a running world model as it was in the bag at a time, in one change."""
    from skiros2_world_model.command_line.connection import connect  # takes a second, and needs ROS

    at = moment(arguments.at, run) if arguments.at else run.end
    scene = run.world(at, arguments.partial)
    done = restore_scene(connect(arguments.wm, user()), scene)
    text = (
        f"the scene is as at {relative(at, run)} s: {done.added} added, {done.changed} changed, {done.removed} removed"
    )
    return CommandResult([screen.fitted(text)], asdict(done))
