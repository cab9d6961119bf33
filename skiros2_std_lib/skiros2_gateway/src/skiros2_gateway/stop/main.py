"""The process of the stop port. The gateway's node starts it, and writes to it what it has to know, as JSON lines:

- first {socket, certificate, key, connections}: the listening socket is a file handle that it inherits;
- then, after each change, {users: {digest: name}, robots: [name]}.

It writes a line once it serves, then entries of the audit log as JSON lines, and ends when its input ends.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import socket
import sys
from typing import Any

from skiros2_gateway.http.server import HttpServer, Limits
from skiros2_gateway.ros.robot_stops import RobotStops
from skiros2_gateway.stop.app import Users, create_stop_app


def main() -> None:
    """Serves until the input ends."""
    logging.basicConfig(level=logging.WARNING, stream=sys.stderr, format="stop port: %(message)s")
    output = os.dup(1)
    os.dup2(2, 1)  # what libraries print is not an entry
    asyncio.run(_serve(output))


async def _serve(output: int) -> None:
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(limit=16 * 1024 * 1024)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    # The transport keeps what the gateway does not read at once: a gateway that hangs delays no stop.
    writer, _ = await loop.connect_write_pipe(asyncio.Protocol, os.fdopen(output, "wb"))
    settings: dict[str, Any] = json.loads(await reader.readline())

    def audit(entry: dict[str, str]) -> None:
        writer.write(json.dumps(entry).encode() + b"\n")

    stops, users = RobotStops(), Users(audit)
    app = create_stop_app(stops, users, audit)
    limits = Limits(of_address=settings["connections"])
    sock = socket.socket(fileno=settings["socket"])
    server = HttpServer(app, sock, settings["certificate"], settings["key"], limits)
    is_first = True
    while line := await reader.readline():
        state = json.loads(line)
        users.by_digest = state["users"]
        stops.set_robots(state["robots"])
        if is_first:
            server.start()
            writer.write(b"{}\n")
            is_first = False
    users.close()
    stops.close()
    await server.stop(at_once=True)


if __name__ == "__main__":
    main()
