"""The program that records a run."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import rosgraph
import rospy

from skiros2_bags.core.bag_writer import COMPRESSIONS, BagWriter
from skiros2_bags.core.checking import check
from skiros2_bags.core.run import Run
from skiros2_bags.core.selection import Selection, pattern
from skiros2_bags.ros.recorder import Recorder
from skiros2_common.command_line.command import INTERRUPTED, OK, REFUSED, USAGE, Parser, command_arguments
from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.ros.master_watch import watch_master
from skiros2_common.ros.node import bridge_logging
from skiros2_common.ros.shutdown import shutdown_in_thread, spin

#: How often a master that is not there is looked for (s).
_MASTER_PERIOD = 0.2


def run(arguments: Sequence[str] | None = None) -> NoReturn:
    """Records until the node is told to end (Ctrl-C, SIGTERM, `rosnode kill`), and ends the process with its status.

    :param arguments: of the command line; None: of this process's.
    """
    given = _parser().parse_args(command_arguments(arguments))
    try:
        status = _record(given)
    except SkirosError as error:
        sys.stderr.write(f"record: {error}\n")
        status = USAGE if isinstance(error, WrongValue) else REFUSED
    except KeyboardInterrupt:
        status = INTERRUPTED
    sys.exit(status)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="record",
        description="Records a run: changes of the world model, progress of tasks, goals and results of actions, tf, "
        "clock, joint states, logs, parameters. May be started before anything else.",
        epilog="Exit status: 0 all is there from the start, 1 something is missing or the bag cannot be written, "
        "2 wrong usage.",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="the bag (default: run_DATE_TIME.bag)")
    parser.add_argument("--force", action="store_true", help="replace a file that is there")
    parser.add_argument(
        "--robots", nargs="*", default=[], metavar="NAME", help="skill managers to await; others are found a bit later"
    )
    parser.add_argument("--also", default="", metavar="REGEX", help="further topics, by their whole name")
    parser.add_argument("--without", default="", metavar="REGEX", help="topics to leave out")
    parser.add_argument("--compression", default="none", metavar="HOW", help=f"{', '.join(COMPRESSIONS)}")
    parser.add_argument("--no-check", action="store_true", help="do not look at the end whether something is missing")
    return parser


def _record(given: argparse.Namespace) -> int:
    output = given.output or Path(time.strftime("run_%Y-%m-%d_%H-%M-%S.bag"))
    selection = Selection(pattern(given.also), pattern(given.without))
    writer = BagWriter(output.absolute(), given.compression, given.force)
    try:
        _wait_for_master()
    except KeyboardInterrupt:
        writer.close()
        raise
    with shutdown_in_thread():
        rospy.init_node("recorder", disable_signals=True)
        bridge_logging()
        watch_master()
        recorder = Recorder(writer, selection, given.robots)
        _say(f"recording to {output}")
        spin()
        recorder.close()
    _say(f"{writer.count} messages in {output}")
    if given.no_check:
        return OK
    findings = check(Run.open(output))
    for finding in findings:
        _say(f"{'ok' if finding.holds else 'MISSING'}: {finding.text}")
    return OK if all(finding.holds for finding in findings) else REFUSED


def _wait_for_master() -> None:
    if rosgraph.is_master_online():
        return
    _say(f"waits for the master {rosgraph.get_master_uri()}")
    while not rosgraph.is_master_online():
        time.sleep(_MASTER_PERIOD)


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()
