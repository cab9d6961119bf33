"""Starts the process of the stop port, keeps it informed, and starts it again if it ends."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
import sys
from collections.abc import Callable
from typing import Any

from skiros2_gateway.core.access import Caller, Role
from skiros2_gateway.core.service import Service
from skiros2_gateway.core.settings import Settings

log = logging.getLogger(__name__)

#: How often the process is told what has changed (s): a revoked user stops no robots after that.
_PERIOD = 0.5
#: The longest time that its first start takes (s): a second of CPU, which others may need too.
_START = 10.0
#: The pause before an ended process is started again (s).
_PAUSE = 1.0


class StopProcess:
    """To be used in the thread of the gateway's loop.

    :param sock: bound and listening.
    :param robots: returns the node names of the connected robots' managers.
    """

    def __init__(
        self, service: Service, settings: Settings, sock: socket.socket, robots: Callable[[], list[str]]
    ) -> None:
        self._service = service
        self._settings = settings
        self._sock = sock
        self._robots = robots
        self._serves, self._has_changes = asyncio.Event(), asyncio.Event()
        self._task = asyncio.get_running_loop().create_task(self._run())

    @property
    def port(self) -> int:
        return int(self._sock.getsockname()[1])

    async def close(self) -> None:
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task
        self._sock.close()

    async def serves(self) -> bool:
        """Waits until stops are carried out at once, `_START` at most. Returns whether they are."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._serves.wait(), _START)
        return self._serves.is_set()

    def inform(self) -> None:
        """Has the process informed at once, not only after `_PERIOD`."""
        self._has_changes.set()

    async def _run(self) -> None:
        while True:
            command = [sys.executable, "-m", "skiros2_gateway.stop.main"]
            handle = self._sock.fileno()
            pipe = asyncio.subprocess.PIPE
            process = await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, pass_fds=[handle])
            assert process.stdin is not None and process.stdout is not None
            settings = self._settings
            first = {"socket": handle, "certificate": settings.certificate, "key": settings.key}
            informing = asyncio.gather(
                self._inform(process.stdin, {**first, "connections": settings.connections}),
                self._audit(process.stdout),
            )
            try:
                await process.wait()
            finally:
                informing.cancel()
                (problem,) = await asyncio.gather(informing, return_exceptions=True)
                if isinstance(problem, Exception):
                    log.error("the connection to the process of the stop port has failed: %s", problem)
                process.stdin.close()
                if process.returncode is None:
                    process.terminate()
                    await process.wait()
            log.error("the process of the stop port has ended (%s); it is started again", process.returncode)
            await asyncio.sleep(_PAUSE)

    async def _inform(self, stdin: asyncio.StreamWriter, first: dict[str, Any]) -> None:
        known: dict[str, Any] = {}
        stdin.write(json.dumps(first).encode() + b"\n")
        with contextlib.suppress(ConnectionError):  # it has ended: the other task sees it
            while True:
                state = {"users": self._service.stop_digests(), "robots": self._robots()}
                if state != known:
                    stdin.write(json.dumps(state).encode() + b"\n")
                    known = state
                await stdin.drain()
                self._has_changes.clear()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._has_changes.wait(), _PERIOD)

    async def _audit(self, stdout: asyncio.StreamReader) -> None:
        if await stdout.readline():
            self._serves.set()
        while line := await stdout.readline():
            entry = json.loads(line)
            caller = Caller(entry["user"], Role.OPERATE, entry["way"])
            self._service.access.record(caller, entry["action"], entry["object"], entry["outcome"])
