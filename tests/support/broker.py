"""An MQTT broker for tests: Debian's mosquitto."""

from __future__ import annotations

import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from skiros2_common.core.processes import free_port

_MISSING = [name for name in ("mosquitto", "mosquitto_pub", "mosquitto_sub") if shutil.which(name) is None]
needs_broker = pytest.mark.skipif(
    bool(_MISSING), reason=f"needs {', '.join(_MISSING)}: Debian's mosquitto and mosquitto-clients"
)


@contextmanager
def broker(access: str = "allow_anonymous true\n") -> Iterator[int]:
    """Runs a broker on this machine; yields its port once it listens.

    :param access: lines of its configuration.
    """
    while True:
        port = free_port()
        with tempfile.NamedTemporaryFile("w", suffix=".conf") as file:
            file.write(f"set_tcp_nodelay true\nlistener {port} 127.0.0.1\n{access}")
            file.flush()
            command = ["mosquitto", "-c", file.name]
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            while process.poll() is None and not _listens(port):
                time.sleep(0.02)
        if process.poll() is None:
            break  # else somebody else has taken the port meanwhile
    try:
        yield port
    finally:
        process.terminate()
        process.wait()


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0
