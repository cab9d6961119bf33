"""The gateway connects to a world model that ends while it connects."""

from __future__ import annotations

import threading

from skiros2_gateway.core.connection import connect
from skiros2_world_model.core.wm_errors import WmException


def test_failed_attempts_are_repeated_until_one_succeeds() -> None:
    errors: list[Exception] = [WmException("service wm/get does not answer"), OSError("connection reset")]

    def attempt() -> str:
        if errors:
            raise errors.pop()
        return "connected"

    assert connect(attempt, threading.Event(), pause=0.001) == "connected"


def test_closing_ends_the_attempts() -> None:
    closed, attempts = threading.Event(), []

    def attempt() -> None:
        attempts.append(1)
        if len(attempts) == 3:
            closed.set()
        raise WmException("service wm/get does not answer")

    assert connect(attempt, closed, pause=0.001) is None
    assert len(attempts) == 3
