"""Free TCP ports for servers that a program starts."""

from __future__ import annotations

import random
import socket

from skiros2_common.core.errors import Refused

#: Below the ephemeral ports (32768 to 60999 on Linux), so that the system does not assign a free port to another
#: program before the server binds it.
_RANGE = range(15000, 32000)
_TRIES = 100


def free_port() -> int:
    """A free port.

    :raises Refused: no free port was found.
    """
    for port in random.SystemRandom().sample(_RANGE, _TRIES):
        if is_free(port):
            return port
    raise Refused(f"none of {_TRIES} random ports from {_RANGE[0]} to {_RANGE[-1]} is free")


def is_free(port: int) -> bool:
    """Whether a server could bind the port."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("", port))
        except OSError:
            return False
    return True
