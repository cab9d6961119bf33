"""A bag whose tasks are looked at."""

from __future__ import annotations

from dataclasses import dataclass

from skiros2_gui.core.runs import Runs, runs_of


@dataclass(frozen=True)
class RunBag:
    """
    :param damage: where and why the bag ends early; "" when it is whole.
    """

    path: str
    runs: Runs
    damage: str


def read_bag(path: str) -> RunBag:
    """The tasks that a bag has recorded. Takes about a second for 10 000 ticks of a small tree.

    :raises BagError: it cannot be read, or holds no progress of tasks.
    """
    from skiros2_bags.core.errors import BagError
    from skiros2_bags.core.message import PROGRESS  # what reads bags takes a second to be loaded
    from skiros2_bags.core.run import Run

    run = Run.open(path)
    if PROGRESS not in run.topics.values():
        raise BagError(f"{path}: the bag holds no progress of tasks: expected a topic of the type {PROGRESS}")
    runs = runs_of(run.messages(PROGRESS))
    if not len(runs):
        raise BagError(f"{path}: no task ran while the bag was recorded")
    return RunBag(path, runs, run.damage)
