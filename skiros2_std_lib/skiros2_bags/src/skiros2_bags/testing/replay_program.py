"""`rosrun skiros2_bags replay BAG KIND`: replays a recorded run and prints the first divergence.

Exit status: 0 without divergence, 1 after a divergence, 2 if the replay fails, 128 + n after signal n.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from pathlib import Path

from skiros2_bags.testing.replay import KINDS, replay
from skiros2_bags.testing.replay_settings import MAX_ORDERS, Settings
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.processes import exit_status
from skiros2_runs.core.tolerance import NARROW, Tolerance

#: Option for a calling program: the replay exits when the caller, the other end of the pipe, exits.
WHILE_STDIN = "--while-stdin"


def main(arguments: list[str] | None = None) -> int:
    """Runs the program.

    :returns: the exit status.
    """
    parser = argparse.ArgumentParser(prog="replay", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("bag", type=Path)
    parser.add_argument("kind", choices=KINDS, help="\n".join(f"{name}: {what}" for name, what in KINDS.items()))
    parser.add_argument("--workspace", type=Path, help="folder of the ontologies of the scene (default: as recorded)")
    parser.add_argument("--played", default="", help="labels of primitives to replace by their recorded progress: a,b")
    parser.add_argument("--launch", default="", help="trace: what else to start: 'PACKAGE FILE ARGUMENTS'")
    parser.add_argument("--relative", type=float, default=NARROW.relative, help="relative tolerance of numbers")
    parser.add_argument("--absolute", type=float, default=NARROW.absolute, help="absolute tolerance of numbers")
    parser.add_argument("--orders", type=int, default=MAX_ORDERS, help="rerun: the most event orders to try")
    parser.add_argument(WHILE_STDIN, action="store_true", help="exit when the standard input ends")
    given = parser.parse_args(arguments)
    if given.while_stdin:
        threading.Thread(target=_end_with_stdin, name="end of stdin", daemon=True).start()
    settings = Settings(
        given.workspace,
        frozenset(filter(None, given.played.split(","))),
        Tolerance(given.relative, given.absolute),
        tuple(given.launch.split()),
        given.orders,
    )
    try:
        found = replay(given.bag, given.kind, settings)
    except SkirosError as error:
        print(f"replay: {error}", file=sys.stderr)  # noqa: T201 - a program
        return 2
    except KeyboardInterrupt as interrupt:
        print("replay: stopped; everything that it started has ended", file=sys.stderr)  # noqa: T201
        return exit_status(interrupt)
    print(found)  # noqa: T201
    return 0 if found.divergence is None else 1


def _end_with_stdin() -> None:
    # Not through sys.stdin: a thread that waits there makes Python exit with an error.
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    sys.exit(main())
