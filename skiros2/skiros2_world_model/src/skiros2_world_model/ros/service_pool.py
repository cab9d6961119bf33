"""Calls of the world model's services: their errors, and persistent connections for any number of threads.

rospy transmits only a text of an error; it ends with the error's code, and its position if it has one, in brackets.
"""

from __future__ import annotations

import ast
import functools
import re
import socket
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

import rospy
from rospy.impl.tcpros_base import TCPROSTransport

from skiros2_common.core.errors import SkirosError
from skiros2_common.ros.connections import was_closed
from skiros2_world_model.core.wm_errors import WmException, refusal

_Request = TypeVar("_Request")
_Response = TypeVar("_Response")

#: The field of a connection's header with the user for whom the node calls.
ON_BEHALF_OF = "on_behalf_of"

_WITH_CODE = re.compile(r"(.*) \[(\w+)(?: (\d+):(\d+))?\]", re.DOTALL)


def service_handler(handler: Callable[[_Request], _Response]) -> Callable[[_Request], _Response]:
    """Wraps a service handler so that its `SkirosError`s are answered with text and code."""

    @functools.wraps(handler)
    def handle(request: _Request) -> _Response:
        try:
            return handler(request)
        except SkirosError as error:
            position = ":".join(map(str, error.position)) if any(error.position) else ""
            raise rospy.ServiceException(f"{error} [{f'{error.code} {position}'.strip()}]") from None

    return handle


def read_error(text: str) -> WmException:
    """The error of a service handler, from the text that was transmitted."""
    found = _WITH_CODE.fullmatch(text)
    if found is None:
        return WmException(text)
    return refusal(found[1], found[2], (int(found[3] or 0), int(found[4] or 0)))


_ANSWERED = re.compile(r"^service \[.*?\] responded with an error: (.*)$", re.DOTALL)
#: The pauses between attempts to reach a server that does not answer (s): short at first, as nodes start together.
_FIRST_PAUSE, _LAST_PAUSE = 0.02, 0.1
#: How long connecting may take at least (s).
_CONNECT = 1.0

_PREFIX = re.compile(r"^(service cannot process request|error processing request): ", re.DOTALL)


#: The longest that a server may need for an answer (s), and for one that reads files or much of the past. Servers
#: limit queries themselves, to less.
ANSWER, LONG_ANSWER = 120.0, 1800.0


class _Socket(socket.socket):
    """A socket that rospy cannot make wait for ever: a server that hangs keeps its connections open."""

    limit: float | None = None  # s

    def setblocking(self, flag: bool) -> None:
        self.settimeout(self.limit if flag else 0.0)


class _Transport(TCPROSTransport):  # type: ignore[misc]
    """A connection with a limit for each wait; rospy limits only that for the connection itself."""

    limit: float | None = None  # s

    def write_header(self) -> None:
        self.socket = _Socket(fileno=self.socket.detach())
        self.set_limit(self.limit)
        super().write_header()

    def set_limit(self, limit: float | None) -> None:
        self.limit = self.socket.limit = limit
        self.socket.setblocking(True)


class ServicePool:
    """Calls of one service. Each call uses a connection of its own; idle connections are reused. Thread-safe.

    :param name: the service; a relative name is resolved by the constructor.
    :param timeout: how long a call tries to reach a server (s).
    :param answer_timeout: how long it waits for the answer of one that was reached (s); None: for ever.
    :param user: the user for whom this node calls; "": itself.
    """

    def __init__(
        self, name: str, kind: Any, timeout: float = 5.0, answer_timeout: float | None = ANSWER, user: str = ""
    ) -> None:
        self._name = rospy.resolve_name(name)
        self._kind = kind
        self._headers = {ON_BEHALF_OF: user} if user else None
        self.timeout = timeout
        self._answer_timeout = answer_timeout
        self.server = ""  # the address of the server that answered last; a restarted server has a different one
        self._idle: list[Any] = []
        self._lock = threading.Lock()

    def call(self, request: Any, repeatable: bool = True) -> Any:
        """Calls the service; blocks until it answers.

        :param repeatable: the request is sent again when the connection breaks before the answer.
        :raises WmException: the server refuses (with its text), or does not answer.
        """
        start = time.monotonic()
        deadline, pause = start + self.timeout, _FIRST_PAUSE
        while True:
            pause = min(pause * 1.2, _LAST_PAUSE)
            proxy = self._take()
            try:
                if proxy.transport is None:
                    self._connect(proxy)
                response = proxy.call(request)
            except rospy.ServiceException as error:
                text = _refusal(str(error))
                if text is not None:
                    self._put_back(proxy)
                    raise read_error(text) from None
                was_sent = proxy.transport is not None
                proxy.close()
                if was_sent and self._answer_timeout and time.monotonic() - start >= self._answer_timeout:
                    text = f"service {self._name} has not answered for {self._answer_timeout:g} s: its server hangs"
                    raise WmException(text) from error
                if was_sent and not repeatable:
                    raise WmException(
                        f"service {self._name} broke off: {error}; whether the request was carried out is not known"
                    ) from error
                self._wait(deadline, pause, error)
            except rospy.exceptions.TransportException as error:
                proxy.close()  # the request was not sent completely
                self._wait(deadline, pause, error)
            except (rospy.ROSInterruptException, rospy.ROSSerializationException, UnicodeEncodeError) as error:
                proxy.close()
                raise WmException(f"service {self._name} was not called: {error}") from error
            else:
                self.server = proxy.uri
                self._put_back(proxy)
                return response

    def is_there(self) -> bool:
        """Whether a server answers."""
        try:
            rospy.wait_for_service(self._name, 0.5)
        except rospy.ROSException:
            return False
        return True

    def close(self) -> None:
        """Closes the idle connections."""
        with self._lock:
            idle, self._idle = self._idle, []
        for proxy in idle:
            proxy.close()

    def _take(self) -> Any:
        while True:
            with self._lock:
                proxy = self._idle.pop() if self._idle else None
            if proxy is None:
                return rospy.ServiceProxy(self._name, self._kind, persistent=True, headers=self._headers)
            if not was_closed(proxy.transport):
                return proxy
            proxy.close()

    def _connect(self, proxy: Any) -> None:
        """Connects as `ServiceProxy.call` does, but with time limits: also a server that hangs accepts connections.

        :raises rospy.ServiceException: the service does not exist or cannot be reached.
        """
        address = proxy._get_service_uri(self._kind._request_class())
        transport = _Transport(proxy.protocol, proxy.resolved_name)
        transport.buff_size = proxy.buff_size
        transport.limit = limit = max(self.timeout, _CONNECT)
        try:
            transport.connect(*rospy.core.parse_rosrpc_uri(address), address, timeout=limit)
        except rospy.exceptions.TransportInitError as error:
            raise rospy.ServiceException(f"unable to connect to service: {error}") from error
        transport.set_limit(self._answer_timeout)
        proxy.transport = transport

    def _put_back(self, proxy: Any) -> None:
        with self._lock:
            self._idle.append(proxy)

    def _wait(self, deadline: float, pause: float, error: Exception) -> None:
        """Waits for a pause (s) before the next attempt to reach the server."""
        # "requested": also true in the shutdown hooks of nodes, which must not wait for a server that ends, too.
        if time.monotonic() > deadline or rospy.core.is_shutdown_requested():
            raise WmException(f"service {self._name} does not answer: {error}") from error
        time.sleep(pause)


def _refusal(text: str) -> str | None:
    """The text of an error answer of the server; None for errors of the transport."""
    found = _ANSWERED.match(text)
    if found is None:
        return None
    answer = found.group(1)
    if answer[:2] in ("b'", 'b"'):  # rospy formats the bytes
        answer = ast.literal_eval(answer).decode("utf-8", "replace")
    return _PREFIX.sub("", answer)
