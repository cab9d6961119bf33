"""A PostgreSQL server of its own for a test, on a free port."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: The user that runs the server if the tests run as root, which it refuses.
_USER = "nobody"


def find_programs() -> Path | None:
    """Returns the folder with initdb and pg_ctl; None if PostgreSQL is not installed."""
    found = shutil.which("pg_ctl")
    folders = [Path(found).parent] if found else sorted(Path("/usr/lib/postgresql").glob("*/bin"))
    return next((folder for folder in reversed(folders) if (folder / "initdb").exists()), None)


class Postgres:
    """A server.

    :ivar url: of its database, for Optuna.
    """

    def __init__(self, folder: Path, programs: Path) -> None:
        self._folder = folder
        self._programs = programs
        self._user = {"user": _USER, "group": "nogroup"} if os.geteuid() == 0 else {}
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = free.getsockname()[1]
        self.url = f"postgresql://learner:secret@127.0.0.1:{self._port}/postgres"
        self._run("initdb", "--auth=trust", "--username=learner", "--no-sync", "-D", "data")
        self.start()

    def start(self) -> None:
        """Starts it; returns when it answers."""
        options = f"-c listen_addresses=127.0.0.1 -p {self._port} -k {self._folder} -c fsync=off"
        self._run("pg_ctl", "start", "--wait", "-D", "data", "-l", "log", "-o", options)

    def stop(self) -> None:
        """Stops it at once, as a crash does."""
        self._run("pg_ctl", "stop", "--wait", "--mode=immediate", "-D", "data")

    @property
    def is_running(self) -> bool:
        return (self._folder / "data/postmaster.pid").exists()

    def _run(self, program: str, *arguments: str) -> None:
        done = subprocess.run(
            [str(self._programs / program), *arguments], cwd=self._folder, stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, timeout=120, **self._user,  # type: ignore[call-overload]
        )  # fmt: skip
        assert done.returncode == 0, done.stderr


@contextmanager
def postgres(programs: Path) -> Iterator[Postgres]:
    """A server that is stopped at the end."""
    folder = Path(tempfile.mkdtemp(prefix="pg_", dir="/tmp"))  # short, for its socket; outside of private folders
    if os.geteuid() == 0:
        shutil.chown(folder, _USER, "nogroup")
    server = None
    try:
        server = Postgres(folder, programs)
        yield server
    finally:
        if server is not None and server.is_running:
            server.stop()
        shutil.rmtree(folder, ignore_errors=True)
