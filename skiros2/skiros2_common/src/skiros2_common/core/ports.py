"""Ports of this machine for servers that a program starts."""

from __future__ import annotations

import random
import socket

from skiros2_common.core.errors import Refused

#: Below those that systems give to whoever asks for any (32768 to 60999 on Linux): a port that was found free is not
#: given to another program before the server has it.
_RANGE = range(15000, 32000)
_TRIES = 100


def free_port() -> int:
    """A port that nobody uses.

    :raises Refused: there is none.
    """
    for port in random.SystemRandom().sample(_RANGE, _TRIES):
        if is_free(port):
            return port
    raise Refused(f"none of {_TRIES} ports from {_RANGE[0]} to {_RANGE[-1]} is free")


def is_free(port: int) -> bool:
    """Whether a server could have the port."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("", port))
        except OSError:
            return False
    return True
