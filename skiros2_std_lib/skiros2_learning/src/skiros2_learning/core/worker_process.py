"""A process that evaluates configurations. This module imports no optimiser: a process starts in half the time."""

from __future__ import annotations

import logging
import os
import signal
from multiprocessing.connection import Connection

from threadpoolctl import threadpool_limits

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.tools.output import STDOUT, discard
from skiros2_learning.core.evaluation import Evaluation, evaluate
from skiros2_learning.core.scenario import Scenario


def work(connection: Connection, scenario: Scenario) -> None:
    """Evaluates what the connection delivers, until it is closed or the parent process has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the coordinator decides
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    logging.disable(logging.WARNING)  # of skills that fail: the result has the reason
    discard(STDOUT)  # the physics engine's
    threadpool_limits(1)  # the processes use all cores already
    parent = os.getppid()
    while True:
        try:
            configuration, seed = connection.recv()
        except (EOFError, OSError):
            return
        try:
            result = evaluate(scenario, configuration, seed)
        except FOREIGN_ERRORS as error:
            result = Evaluation(configuration, seed, error=f"{type(error).__name__}: {error}")
        if os.getppid() != parent:
            return
        connection.send(result)
