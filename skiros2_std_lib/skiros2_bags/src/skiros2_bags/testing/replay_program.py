"""`rosrun skiros2_bags replay BAG KIND`: plays a recorded run again and tells the first difference.

Ends with 0 when all goes as recorded, with 1 after a difference, with 2 when it cannot be played, and with 128 + n
when signal n has ended it.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from pathlib import Path

from skiros2_bags.core.normal import NARROW, Tolerance
from skiros2_bags.testing.divergence import Divergence
from skiros2_bags.testing.kinds import KINDS, Settings, replay
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.termination import exit_status

#: For a program that plays a bag: when it ends, however that is, its end of the pipe closes.
WHILE_STDIN = "--while-stdin"


def main(arguments: list[str] | None = None) -> int:
    """Returns the exit status."""
    parser = argparse.ArgumentParser(prog="replay", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("bag", type=Path)
    parser.add_argument("kind", choices=KINDS, help="\n".join(f"{name}: {what}" for name, what in KINDS.items()))
    parser.add_argument("--workspace", type=Path, help="folder of the ontologies of the scene; as recorded")
    parser.add_argument("--played", default="", help="labels of primitives that do what was told of them: a,b")
    parser.add_argument("--launch", default="", help="trace: what stands beside the platform: 'PACKAGE FILE ARGUMENTS'")
    parser.add_argument("--relative", type=float, default=NARROW.relative, help="how far numbers may be apart")
    parser.add_argument("--absolute", type=float, default=NARROW.absolute, help="likewise, whatever their size")
    parser.add_argument(WHILE_STDIN, action="store_true", help="end when the standard input ends")
    given = parser.parse_args(arguments)
    if given.while_stdin:
        threading.Thread(target=_end_with_stdin, name="end of stdin", daemon=True).start()
    settings = Settings(
        given.workspace,
        frozenset(filter(None, given.played.split(","))),
        Tolerance(given.relative, given.absolute),
        tuple(given.launch.split()),
    )
    try:
        found: Divergence | None = replay(given.bag, given.kind, settings)
    except SkirosError as error:
        print(f"replay: {error}", file=sys.stderr)  # noqa: T201 - a program
        return 2
    except KeyboardInterrupt as interrupt:
        print("replay: stopped; everything that it started has ended", file=sys.stderr)  # noqa: T201
        return exit_status(interrupt)
    print(found if found is not None else "as recorded")  # noqa: T201
    return 0 if found is None else 1


def _end_with_stdin() -> None:
    # Not through sys.stdin: a thread that waits there when Python ends makes it end with an error.
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    sys.exit(main())
