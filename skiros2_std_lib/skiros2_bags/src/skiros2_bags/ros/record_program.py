"""The program `record`."""

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
from skiros2_common.ros.node import bridge_logging, shutdown_in_thread, spin

#: Period of checks for a missing master (s).
_MASTER_PERIOD = 0.2


def run(arguments: Sequence[str] | None = None) -> NoReturn:
    """Records until the node is shut down (Ctrl-C, SIGTERM, `rosnode kill`), then exits with its status.

    :param arguments: of the command line; None for those of this process.
    """
    options = _parser().parse_args(command_arguments(arguments))
    try:
        status = _record(options)
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
        "clock, joint states, logs, parameters. May be started before all other nodes.",
        epilog="Exit status: 0 the recording is complete, 1 it is incomplete or the bag cannot be written, "
        "2 wrong usage.",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="the bag (default: run_DATE_TIME.bag)")
    parser.add_argument("--force", action="store_true", help="replace an existing file")
    parser.add_argument(
        "--robots", nargs="*", default=[], metavar="NAME", help="skill managers to expect; others are found later"
    )
    parser.add_argument("--also", default="", metavar="REGEX", help="additional topics, by their full name")
    parser.add_argument("--without", default="", metavar="REGEX", help="topics to exclude")
    parser.add_argument("--compression", default="none", metavar="HOW", help=f"{', '.join(COMPRESSIONS)}")
    parser.add_argument("--no-check", action="store_true", help="do not check the bag for missing messages at the end")
    return parser


def _record(options: argparse.Namespace) -> int:
    output = options.output or Path(time.strftime("run_%Y-%m-%d_%H-%M-%S.bag"))
    selection = Selection(pattern(options.also), pattern(options.without))
    writer = BagWriter(output.absolute(), options.compression, options.force)
    try:
        _wait_for_master()
    except KeyboardInterrupt:
        writer.close()
        raise
    with shutdown_in_thread():
        rospy.init_node("recorder", disable_signals=True)
        bridge_logging()
        watch_master()
        recorder = Recorder(writer, selection, options.robots)
        _print(f"recording to {output}")
        spin()
        recorder.close()
    _print(f"{writer.count} messages in {output}")
    if options.no_check:
        return OK
    findings = check(Run.open(output))
    for finding in findings:
        _print(f"{'ok' if finding.holds else 'MISSING'}: {finding.text}")
    return OK if all(finding.holds for finding in findings) else REFUSED


def _wait_for_master() -> None:
    if rosgraph.is_master_online():
        return
    _print(f"waiting for the master {rosgraph.get_master_uri()}")
    while not rosgraph.is_master_online():
        time.sleep(_MASTER_PERIOD)


def _print(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()
