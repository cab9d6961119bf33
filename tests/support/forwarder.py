"""A TCP port that stays the same while the server behind it is started again on another port."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator
from types import TracebackType


class Forwarder:
    """Forwards connections of a free port of this machine to `target`; a context manager.

    :ivar target: the port of the server.
    """

    def __init__(self, target: int) -> None:
        self.target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(None)  # rospy sets a default of a minute
        self.port: int = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, name="forwarder", daemon=True).start()

    def __enter__(self) -> Forwarder:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)  # wakes the thread that accepts
        self._listener.close()

    def _accept(self) -> None:
        for client in _connections(self._listener):
            try:
                server = socket.create_connection(("127.0.0.1", self.target))
            except OSError:  # the server is away
                client.close()
                continue
            server.settimeout(None)
            for source, sink in ((client, server), (server, client)):
                threading.Thread(target=_copy, args=(source, sink), daemon=True).start()


def _connections(listener: socket.socket) -> Iterator[socket.socket]:
    with contextlib.suppress(OSError):
        while True:
            client, _ = listener.accept()
            client.settimeout(None)
            yield client


def _copy(source: socket.socket, sink: socket.socket) -> None:
    """Copies until one side ends; then both end."""
    with contextlib.suppress(OSError):
        while data := source.recv(65536):
            sink.sendall(data)
    for end in (source, sink):
        with contextlib.suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)
        end.close()
