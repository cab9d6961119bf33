"""The HTTP server: uvicorn, with limits on connections."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.h11_impl import H11Protocol

from skiros2_common.core.errors import ConfigurationError
from skiros2_gateway.http.callers import is_known

log = logging.getLogger(__name__)
# uvicorn warns of each wrong request: clients could fill the log
logging.getLogger("uvicorn.error").setLevel(logging.ERROR)

#: Time for open requests at the end (s).
GRACE = 1.0
#: After an error of the listening socket, such as no free file handle, it rests for this long (s).
_PAUSE = 1.0


@dataclass(frozen=True)
class Limits:
    """Limits on connections. One more takes the place of an old one that carries no request of a known user.

    :param of_address: connections of one address.
    :param total: connections of all addresses.
    :param head: time from the first byte, or the begin of the connection, to the end of a request's head (s).
    :param silence: time within which a client that is gone, and has closed nothing, is noticed (s, at least 4).
    """

    of_address: int = 200
    total: int = 800
    head: float = 10.0
    silence: int = 20


class HttpServer:
    """The server. To be used in one loop.

    :param sock: bound and listening.
    :param certificate, key: files, for TLS.
    :raises ConfigurationError: the certificate or key cannot be read.
    """

    def __init__(
        self, app: FastAPI, sock: socket.socket, certificate: str = "", key: str = "", limits: Limits | None = None
    ) -> None:
        self._sock = sock
        self._limits = limits or Limits()
        self._connections: dict[str, list[_Connection]] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        tls: dict[str, Any] = {"ssl_certfile": certificate, "ssl_keyfile": key} if certificate else {}
        self._config = uvicorn.Config(
            app,
            log_config=None,
            access_log=False,
            lifespan="off",
            timeout_graceful_shutdown=int(GRACE),
            h11_max_incomplete_event_size=32 * 1024,
            ws="none",  # a WebSocket would escape the limits
            proxy_headers=False,  # any client on this machine could send them, and so appear under any address
            **tls,
        )
        try:
            self._config.load()
        except OSError as error:
            raise ConfigurationError(f"certificate {certificate}, key {key}: {error}") from error
        self._server = _Server(self._config)

    def start(self) -> None:
        """Starts to serve."""
        self._sock.setblocking(False)
        loop = asyncio.get_running_loop()
        self._uvicorn = loop.create_task(self._server.serve([]))
        self._accepting = loop.create_task(self._accept())

    async def stop(self, *, at_once: bool = False) -> None:
        """Stops serving.

        :param at_once: open requests get no time.
        """
        self._accepting.cancel()
        self._sock.close()
        self._server.should_exit, self._server.force_exit = True, at_once
        await self._uvicorn
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _accept(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                sock, address = await loop.sock_accept(self._sock)
            except OSError as error:
                log.error("no connection can be accepted: %s", error)
                await asyncio.sleep(_PAUSE)
                continue
            host = str(address[0])
            if self._has_room(host):
                sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # else each answer takes 40 ms longer
                _notice_silence(sock, self._limits.silence)
                connection = _Connection(self._config, self._server.server_state, self._limits.head)
                self._connections.setdefault(host, []).append(connection)
                connection.task = task = loop.create_task(self._serve(sock, host, connection))
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
            else:
                log.debug("connection of %s refused: too many", host)
                sock.close()

    def _has_room(self, host: str) -> bool:
        """Returns whether a connection may be added; closes one without a request of a known user to make room."""
        groups = list(self._connections.values())
        if len(self._connections.get(host, [])) >= self._limits.of_address:
            groups = [self._connections[host]]
        elif sum(map(len, groups)) < self._limits.total:
            return True
        for group in groups:
            for each in group:
                if not each.is_needed and each.task is not None:
                    group.remove(each)
                    each.task.cancel()
                    return True
        return False

    async def _serve(self, sock: socket.socket, host: str, connection: _Connection) -> None:
        tls = self._config.ssl
        timeout = self._limits.head if tls is not None else None
        try:
            await asyncio.get_running_loop().connect_accepted_socket(
                lambda: connection, sock, ssl=tls, ssl_handshake_timeout=timeout
            )
            await connection.lost.wait()
        except OSError as error:
            log.debug("connection of %s: %s", host, error)
        finally:
            connection.abort()
            sock.close()
            of_host = self._connections.get(host, [])
            if connection in of_host:
                of_host.remove(connection)
            if not of_host:
                self._connections.pop(host, None)


class _Server(uvicorn.Server):
    """Leaves the signals to the node."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class _Connection(H11Protocol):
    """A connection that is closed if the head of a request does not arrive in time."""

    def __init__(self, config: uvicorn.Config, state: Any, head: float) -> None:
        super().__init__(config, state, {})
        self._head = head
        self._timer: asyncio.TimerHandle | None = None
        self.lost = asyncio.Event()
        self.task: asyncio.Task[None] | None = None

    @property
    def is_needed(self) -> bool:
        """Whether it carries a request of a known user that is not answered yet, such as a stream."""
        return self.cycle is not None and not self.cycle.response_complete and is_known(self.scope)

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._expect_head()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if self.cycle is not None and not self.cycle.response_complete:
            self._cancel()
        elif self._timer is None:
            self._expect_head()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._cancel()
        self.lost.set()

    def abort(self) -> None:
        """Closes the connection at once, if it is open."""
        if self.transport is not None:
            self.transport.abort()

    def _expect_head(self) -> None:
        self._timer = self.loop.call_later(self._head, self.abort)

    def _cancel(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def _notice_silence(sock: socket.socket, limit: int) -> None:
    """Has the kernel end a connection whose client does not answer: a machine without power closes nothing.

    :param limit: s.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in (
        (socket.TCP_KEEPIDLE, limit // 2),
        (socket.TCP_KEEPINTVL, limit // 4),
        (socket.TCP_KEEPCNT, 2),
        (socket.TCP_USER_TIMEOUT, limit * 1000),
    ):
        sock.setsockopt(socket.IPPROTO_TCP, option, value)
