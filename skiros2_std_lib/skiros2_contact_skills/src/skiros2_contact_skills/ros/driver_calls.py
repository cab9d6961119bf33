"""Calls of a driver, in a thread of their own: no tick waits for a driver."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from typing import Any

import roslib.message
import rospy

from skiros2_common.core.errors import ConfigurationError, Refused, SkirosError

log = logging.getLogger(__name__)

#: Time that services and subscribers may need to appear (s of wall time).
CONNECT_TIME = 5.0


class DriverCalls:
    """A thread that calls functions in the order in which they were given. Thread-safe.

    :param name: of the driver, for the log.
    :ivar problem: reason of the first call that failed since it was last set to ""; "" if none did.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self.problem = ""
        self._pending, self._lock = 0, threading.Lock()
        self._functions: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._serve, name=f"commands to {name}", daemon=True)
        self._thread.start()

    @property
    def is_waiting(self) -> bool:
        """Whether a request is not answered yet."""
        return self._pending > 0

    def later(self, function: Callable[[], None]) -> None:
        """Calls a function after those before it."""
        self._functions.put(lambda: self._run(function))

    def request(self, function: Callable[[], None]) -> None:
        """Calls a function later, and waits for its end: see `is_waiting`."""

        def answered() -> None:
            self._run(function)
            with self._lock:
                self._pending -= 1

        with self._lock:
            self._pending += 1
        self._functions.put(answered)

    def close(self) -> None:
        """Ends the thread after the functions that were given."""
        self._functions.put(None)

    def _serve(self) -> None:
        while (function := self._functions.get()) is not None:
            function()

    def _run(self, function: Callable[[], None]) -> None:
        try:
            function()
        except SkirosError as error:
            log.warning("%s: %s", self._name, error)
            self.problem = self.problem or str(error)


def connected(condition: Callable[[], bool], timeout: float = CONNECT_TIME) -> bool:
    """Waits for a condition; returns whether it holds within a time (s)."""
    deadline, pause = time.monotonic() + timeout, threading.Event()
    while not condition():
        if time.monotonic() > deadline or rospy.is_shutdown():
            return False
        pause.wait(0.01)
    return True


def message_class(name: str) -> Any:
    """Returns the class of a message.

    :raises ConfigurationError: its package is not installed.
    """
    found = roslib.message.get_message_class(name)
    if found is None:
        raise ConfigurationError(f"message {name} is not installed: the driver needs the package {name.split('/')[0]}")
    return found


def call(name: str, kind: Any, *values: Any) -> Any:
    """Calls a service, and checks the fields `ok` and `success` of its answer.

    :raises Refused: it does not exist, or refuses; the text names it.
    """
    try:
        rospy.wait_for_service(name, CONNECT_TIME)
        answer = rospy.ServiceProxy(name, kind)(*values)
    except (rospy.ROSException, rospy.ServiceException) as error:
        raise Refused(f"service {name}: {error}") from None
    if (not getattr(answer, "ok", True) and hasattr(answer, "message")) or not getattr(answer, "success", True):
        raise Refused(f"{name}: {answer.message}")
    return answer


def reconfigure(name: str, values: dict[str, float]) -> None:
    """Sets parameters by `dynamic_reconfigure/Reconfigure`.

    :raises ConfigurationError: its package is not installed.
    :raises Refused: the service does not exist or fails.
    """
    kind = roslib.message.get_service_class("dynamic_reconfigure/Reconfigure")
    if kind is None:
        raise ConfigurationError("the stiffness cannot be set: the package dynamic_reconfigure is not installed")
    number, config = (message_class(f"dynamic_reconfigure/{part}") for part in ("DoubleParameter", "Config"))
    call(name, kind, config(doubles=[number(key, value) for key, value in values.items()]))
