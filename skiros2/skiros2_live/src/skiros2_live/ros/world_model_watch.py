"""Watches whether the world model answers."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

import rospy

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.operations import SCENE
from skiros2_live.core.patch import WORLD_MODEL, Connection
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.ros.ros_transport import SERVER
from skiros2_world_model.ros.service_pool import ServicePool

log = logging.getLogger(__name__)

#: The period of the calls that check the world model, and their timeout (s).
PERIOD, TIMEOUT = 1.0, 5.0

#: A read of the scene that matches no element: the response has the snapshot id only.
_READ_NOTHING = srvs.WmGetRequest(
    srvs.WmGetRequest.RESOLVE, SCENE, msgs.WmElement(type="skiros:Scene", label="(none)"), "", ""
)


class WorldModelWatch:
    """Calls the world model node `wm` in this namespace each second, in a thread of its own, from `start` to `close`.

    :param report: called with each new status of the connection, in any thread; must not block.
    :param update: called in the thread after each answer; may read from the world model. An error counts as none.
    """

    def __init__(self, report: Callable[[Connection], None], update: Callable[[], None] = lambda: None) -> None:
        self._connection = Connection(WORLD_MODEL, rospy.resolve_name(SERVER), False, 0.0)
        self._report = report
        self._update = update
        report(self._connection)
        self._server = ""  # the address of the server
        self._asked_at = 0.0  # when the pending call was made (monotonic); 0.0 without one
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._wanted = threading.Event()
        self._service = ServicePool(f"{SERVER}/get", srvs.WmGet, 0.0)

    def start(self) -> None:
        """Starts the thread."""
        threading.Thread(target=self._run, name="world model watch", daemon=True).start()

    def wake(self) -> None:
        """Has the next call made now."""
        self._wanted.set()

    def check(self) -> None:
        """Detects that the world model does not answer. To be called periodically by another thread."""
        asked_at = self._asked_at
        if asked_at and time.monotonic() - asked_at > TIMEOUT:
            self._set(False, f"It has not answered for {TIMEOUT:g} s.")

    def close(self) -> None:
        """Ends the calls. Does not block."""
        self._ended.set()
        self._wanted.set()

    def _run(self) -> None:
        while not self._ended.is_set():
            self._wanted.clear()
            problem = None
            self._asked_at = time.monotonic()
            try:
                self._ask()
                self._update()
            except SkirosError as error:
                log.debug("the world model does not answer: %s", error)
                problem = ""
            except Exception as error:  # the response cannot be read: the server may have another version
                log.exception("reading the world model failed")
                problem = f"Its response cannot be read: {type(error).__name__}: {error}"
            self._asked_at = 0.0
            self._set(problem is None, problem or "")
            self._wanted.wait(PERIOD)
        self._service.close()

    def _ask(self) -> None:
        """
        :raises WmException: the world model does not answer.
        """
        self._service.call(_READ_NOTHING)
        if self._server not in ("", self._service.server):
            self._set(False, "")  # it has restarted between two calls
        self._server = self._service.server

    def _set(self, is_up: bool, problem: str) -> None:
        with self._lock:
            if (is_up, problem) != (self._connection.is_up, self._connection.text):
                self._connection = self._connection.updated(is_up, problem)
                self._report(self._connection)  # under the lock: in order
