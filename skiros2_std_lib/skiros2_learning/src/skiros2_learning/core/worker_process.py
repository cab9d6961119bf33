"""A process that evaluates configurations. This module imports no optimiser: a process starts in half the time."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Mapping
from dataclasses import replace

from threadpoolctl import threadpool_limits

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.tools.output import STDOUT, discard
from skiros2_learning.core.evaluation import Evaluation, Outcome, evaluate, repeat_once
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.variables import Value

_scenarios: list[Scenario] = []


def begin(scenario: Scenario) -> None:
    """Prepares the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the coordinator decides
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    logging.disable(logging.WARNING)  # of skills that fail: the result has the reason
    discard(STDOUT)  # the physics engine's
    threadpool_limits(1)  # the processes use all cores already
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _scenarios.append(scenario)


def _end_with_parent() -> None:
    """Ends this process when the coordinator has died: nobody takes its result or enforces its timeout."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os._exit(1)


def run(configuration: dict[str, Value], seed: int) -> Evaluation:
    """Evaluates a configuration in a process that `begin` has prepared."""
    try:
        return evaluate(_scenarios[0], configuration, seed)
    except FOREIGN_ERRORS as error:
        return Evaluation(configuration, seed, error=f"{type(error).__name__}: {error}")


def run_repetition(
    configuration: dict[str, Value], seed: int, index: int, variation: Mapping[str, float] | None = None
) -> Outcome:
    """Runs one repetition in a process that `begin` has prepared.

    :param variation: values of the features; None for those of the scenario.
    """
    scenario = _scenarios[0]
    try:
        if variation is not None:
            scenario = replace(scenario, variation=variation)
        return repeat_once(scenario, configuration, seed, index)
    except FOREIGN_ERRORS as error:
        return f"{type(error).__name__}: {error}"
