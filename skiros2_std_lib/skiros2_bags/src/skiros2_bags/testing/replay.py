"""`rosrun skiros2_bags replay BAG`: re-runs the tasks of a bag and prints the first divergence.

Exit status: 0 without divergence, 1 after a divergence, 2 if the re-run fails.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from skiros2_common.core.errors import SkirosError
from skiros2_runs.core.compare import Divergence
from skiros2_runs.core.tolerance import NARROW, Tolerance

#: The most event orders tried by default. Each takes at most as long as the first pass. The five recorded runs in
#: tests/bags need 1 each.
MAX_ORDERS = 20


@dataclass(frozen=True)
class Settings:
    """Settings of a re-run.

    :param workspace: folder of additional ontologies for the scene; None for the recorded parameter `workspace_dir` of
        the world model.
    :param played: labels of primitives that are replaced by their recorded progress. Primitives that call services are
        always replaced, since bags do not contain answers of services.
    :param tolerance: of measured numbers.
    :param max_orders: the most orders of nearly simultaneous events to try.
    """

    workspace: Path | None = None
    played: frozenset[str] = frozenset()
    tolerance: Tolerance = NARROW
    max_orders: int = MAX_ORDERS


@dataclass(frozen=True)
class ReplayResult:
    """The result of a re-run.

    :param divergence: the first one; None without one.
    :param orders: the number of event orders that were tried.
    """

    divergence: Divergence | None
    orders: int = 1

    def __str__(self) -> str:
        text = "as recorded" if self.divergence is None else str(self.divergence)
        return text if self.orders == 1 else f"{text}\n{self.orders} event orders were tried"


def replay(bag: Path, settings: Settings) -> ReplayResult:
    """Re-runs a bag.

    :raises BagError: the bag lacks required messages.
    :raises SkirosError: the re-run fails.
    """
    # Imported here, because the pytest plugin is loaded by each run of pytest, and ROS is slow to import.
    from skiros2_bags.testing.recording import Recording
    from skiros2_bags.testing.rerun import rerun

    recording = Recording(bag)
    if settings.workspace is None:
        folder = str(recording.parameters.get("/wm/workspace_dir", ""))
        settings = replace(settings, workspace=Path(folder) if folder and Path(folder).is_dir() else None)
    return rerun(recording, settings)


def main(arguments: list[str] | None = None) -> int:
    """Runs the program.

    :returns: the exit status.
    """
    parser = argparse.ArgumentParser(prog="replay", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("bag", type=Path)
    parser.add_argument("--workspace", type=Path, help="folder of the ontologies of the scene (default: as recorded)")
    parser.add_argument("--played", default="", help="labels of primitives to replace by their recorded progress: a,b")
    parser.add_argument("--relative", type=float, default=NARROW.relative, help="relative tolerance of numbers")
    parser.add_argument("--absolute", type=float, default=NARROW.absolute, help="absolute tolerance of numbers")
    parser.add_argument("--orders", type=int, default=MAX_ORDERS, help="the most event orders to try")
    given = parser.parse_args(arguments)
    tolerance = Tolerance(given.relative, given.absolute)
    played = frozenset(filter(None, given.played.split(",")))
    try:
        found = replay(given.bag, Settings(given.workspace, played, tolerance, given.orders))
    except SkirosError as error:
        print(f"replay: {error}", file=sys.stderr)  # noqa: T201 - a program
        return 2
    print(found)  # noqa: T201
    return 0 if found.divergence is None else 1
