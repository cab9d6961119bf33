"""Reads the tasks of a bag."""

from __future__ import annotations

from dataclasses import dataclass

from skiros2_runs.core.runs import Runs


@dataclass(frozen=True)
class RunBag:
    """:param damage: where and why the bag ends early; "" if it is complete."""

    path: str
    runs: Runs
    damage: str


def read_bag(path: str) -> RunBag:
    """Reads the tasks of a bag. Takes about a second for 10 000 ticks of a small tree.

    :raises BagError: it cannot be read, or has no progress of tasks.
    """
    from skiros2_bags.core.bag_file import BagError  # imported here, as it takes a second
    from skiros2_bags.core.run import Run

    run = Run.open(path)
    runs = run.runs()
    if not len(runs):
        raise BagError(f"{path}: no task ran while the bag was recorded")
    return RunBag(path, runs, run.damage)
