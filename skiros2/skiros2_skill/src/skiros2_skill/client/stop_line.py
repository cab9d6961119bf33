"""Stops, pauses and resumes tasks of a skill manager, on connections that carry nothing else."""

from __future__ import annotations

import logging
import queue
import threading
import time
from typing import Any

import rosgraph
import rospy
from rospy.core import parse_rosrpc_uri
from rospy.impl.tcpros_base import TCPROSTransport

from skiros2_common.core.errors import TimedOut, UnknownName
from skiros2_common.ros.connections import was_closed
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.wm_errors import refusal

log = logging.getLogger(__name__)

#: How long a command may take (s).
TIME_LIMIT = 3.0
#: How old the reading of a manager's clock may be when a deadline is computed from it (s).
_CLOCK_AGE = 10.0
#: The connections that `keep_open` keeps, so that one is free while another is tried, and how often it tries them (s).
_KEPT, _PERIOD = 2, 1.0
#: Errors of a connection that ends; the last two where it is closed during a call.
_BROKEN = (rospy.ServiceException, rospy.exceptions.TransportException, OSError, AttributeError, IndexError)


class NoStopService(UnknownName):
    """The manager has no service `stop`: it does not run, or is of an earlier version."""


class StopLine:
    """Any thread; needs no node. Each command is carried out within its time, or never.

    :param manager: the node name.
    """

    def __init__(self, manager: str) -> None:
        self._manager = manager
        self._service = str(rospy.resolve_name(f"{manager}/stop"))
        self._lock = threading.Lock()
        self._idle: list[_Connection] = []
        self._closed = threading.Event()

    def send(self, author: str, action: str, task_id: int, timeout: float = TIME_LIMIT) -> list[int]:
        """Sends a command; see `SkillStop`. Returns the ids of the tasks concerned.

        :param timeout: how long it may take (s).
        :raises NoStopService: there is no such service.
        :raises TimedOut: there was no answer in time; the manager does not carry out the command later.
        :raises WmException: the manager refuses.
        """
        deadline = time.monotonic() + timeout
        while True:
            connection = self._take()
            is_kept = connection.is_open
            request = srvs.SkillStopRequest(author, action, task_id, 0.0)
            try:
                answer = connection.call(request, deadline)
            except (TimedOut, NoStopService):
                connection.close()
                raise
            except _BROKEN as error:
                connection.close()
                is_repeatable = is_kept and action != request.RESUME
                if is_repeatable and time.monotonic() < deadline:
                    continue  # the connection was of a manager that has ended
                raise TimedOut(f"{self._manager} does not answer: {error}") from error
            self._put_back(connection)
            if not answer.ok:
                raise refusal(answer.text, answer.code)
            return list(answer.tasks)

    def keep_open(self) -> None:
        """Keeps connections open from now on, so that a command need not wait for one."""
        threading.Thread(target=self._keep, name=f"stop line of {self._manager}", daemon=True).start()

    @property
    def is_open(self) -> bool:
        """Whether a connection is open."""
        with self._lock:
            return any(connection.is_open for connection in self._idle)

    def close(self) -> None:
        self._closed.set()
        with self._lock:
            idle, self._idle = self._idle, []
        for connection in idle:
            connection.close()

    def _keep(self) -> None:
        while not self._closed.is_set():
            for _ in range(_KEPT):  # the one tried last is at the end of the list, so each has its turn
                with self._lock:
                    connection = self._idle.pop(0) if len(self._idle) >= _KEPT else _Connection(self._service)
                try:
                    connection.open()  # in this thread: one attempt at a time, however long it takes
                    connection.call(srvs.SkillStopRequest(), time.monotonic() + _PERIOD)
                except Exception as error:  # the next attempt follows; commands report it
                    connection.close()
                    log.debug("no stop line to %s: %s", self._manager, error)
                else:
                    self._put_back(connection)
            self._closed.wait(_PERIOD)

    def _take(self) -> _Connection:
        while True:
            with self._lock:
                connection = self._idle.pop() if self._idle else _Connection(self._service)
            if not connection.was_closed:
                return connection
            connection.close()

    def _put_back(self, connection: _Connection) -> None:
        with self._lock:
            if not self._closed.is_set():
                self._idle.append(connection)
                return
        connection.close()


class _Connection:
    """A connection to the service, opened by the first call. For one thread at a time."""

    def __init__(self, service: str) -> None:
        self._service = service
        self._proxy = rospy.ServiceProxy(service, srvs.SkillStop, persistent=True)
        self._transport: Any = None  # also while it is being opened
        self._offset = 0.0  # of the manager's clock to this process's, at least (s)
        self._read_at = float("-inf")

    @property
    def is_open(self) -> bool:
        return self._proxy.transport is not None

    @property
    def was_closed(self) -> bool:
        """Whether the manager has closed the connection: then its end can be read."""
        return self.is_open and was_closed(self._transport)

    def open(self) -> None:
        """Opens the connection, unless it is open; blocks.

        :raises NoStopService: there is no such service.
        """
        if self.is_open:
            return
        try:
            uri = rosgraph.Master(rospy.get_name()).lookupService(self._service)
        except rosgraph.MasterError:
            raise NoStopService(f"there is no service {self._service}") from None
        self._transport = TCPROSTransport(self._proxy.protocol, self._service)
        self._transport.buff_size = self._proxy.buff_size
        self._transport.connect(*parse_rosrpc_uri(uri), uri)
        self._proxy.transport = self._transport

    def call(self, request: Any, deadline: float) -> Any:
        """Sends a request in a thread of its own, as rospy waits without limit.

        :param deadline: by this process's clock (s, monotonic).
        :raises TimedOut: there was no answer in time.
        """
        answers: queue.SimpleQueue[Any] = queue.SimpleQueue()

        def send() -> None:
            try:
                answers.put(self._send(request, deadline))
            except Exception as error:  # raised again by the caller
                answers.put(error)

        threading.Thread(target=send, name=f"stop {self._service}", daemon=True).start()
        try:
            answer = answers.get(timeout=max(0.0, deadline - time.monotonic()))
        except queue.Empty:
            raise TimedOut(f"{self._service} has not answered in time; it carries out nothing later") from None
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _send(self, request: Any, deadline: float) -> Any:
        self.open()
        if request.action and time.monotonic() - self._read_at > _CLOCK_AGE:
            self._exchange(srvs.SkillStopRequest())
        if not time.monotonic() <= deadline:
            raise TimedOut(f"{self._service}: it was too late to send the command")
        request.deadline = deadline + self._offset
        return self._exchange(request)

    def _exchange(self, request: Any) -> Any:
        answer = self._proxy.call(request)
        self._read_at = time.monotonic()
        # The manager read its clock earlier, so that the deadline is rather too early than too late.
        self._offset = answer.clock - self._read_at
        return answer

    def close(self) -> None:
        """Ends also a call that waits."""
        transport, self._proxy.transport = self._transport, None
        if transport is not None:
            transport.close()
