"""`rosrun skiros2_bags replay BAG`: re-runs the tasks of a bag and prints the first divergence, and skills that declare
something else.

Exit status: 0 as recorded, 1 if something differs, 2 if the re-run fails.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

from skiros2_bags.testing.field_tolerances import FieldTolerances, field_tolerances
from skiros2_bags.testing.rerun import MAX_ORDERS, Settings, replay
from skiros2_bags.testing.stored import Stored
from skiros2_common.command_line.command import OK, REFUSED, USAGE, CommandResult, Parser, run_command
from skiros2_runs.core.tolerance import NARROW, Tolerance


def main(arguments: list[str] | None = None) -> int:
    """Runs the program.

    :returns: the exit status.
    """
    parser = Parser(prog="replay", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("bag", type=Path)
    parser.add_argument("--workspace", type=Path, help="folder of the ontologies of the scene (default: as recorded)")
    parser.add_argument("--played", default="", help="labels of primitives to replace by their recorded progress: a,b")
    parser.add_argument("--relative", type=float, default=NARROW.relative, help="relative tolerance of numbers")
    parser.add_argument("--absolute", type=float, default=NARROW.absolute, help="absolute tolerance of numbers")
    parser.add_argument(
        "--tolerance", action="append", default=[], metavar="FIELD=ABSOLUTE[,RELATIVE]",
        help="tolerance of one field: pose, message:SKILL, value:PARAMETER, a property, ACTION:FIELD; repeatable",
    )  # fmt: skip
    parser.add_argument("--orders", type=int, default=MAX_ORDERS, help="the most event orders to try")
    parser.add_argument("--plans", action="store_true", help="make the plans again, and compare them (some seconds)")
    parser.add_argument(
        "--store", action="store_true", help="store tolerance and number of orders of a re-run without divergence"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    given = parser.parse_args(arguments)
    played = frozenset(filter(None, given.played.split(",")))

    def work() -> CommandResult:
        fields = field_tolerances(given.tolerance)
        tolerances = FieldTolerances(Tolerance(given.relative, given.absolute), fields)
        found = replay(given.bag, Settings(given.workspace, played, tolerances, given.orders, given.plans))
        if given.store and found.is_as_recorded:
            Stored(found.orders, tolerances).write(given.bag)
        first = found.divergence
        data = {**asdict(found), "divergence": None if first is None else asdict(first)}
        return CommandResult(str(found).splitlines(), data, OK if found.is_as_recorded else REFUSED)

    return run_command("replay", work, given.json, refused=USAGE)
