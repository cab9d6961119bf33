"""Installed programs that start as forks of a process which has imported what all of them import.

A node's start takes half a second of the processor, nine tenths of it for imports, and the tests start hundreds. A fork
runs the installed script as the interpreter does: as `__main__`, with its arguments, environment, folder and output, in
a session of its own. roslaunch is forked too, and its nodes and checks are forks of the same process; so no process has
roslaunch as its parent, and the reason of a failed launch is not repeated as its last line. What differs is tested with
the real roslaunch (`Ros.launch(forked=False)`) and by the tests of the installation.
"""

from __future__ import annotations

import ast
import contextlib
import gc
import importlib
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

#: Whose programs may be forked.
PACKAGES = ("skiros2_world_model", "skiros2_skill", "skiros2_task")
ROSLAUNCH = Path("/usr/bin/roslaunch")
#: The variable in which launch/node.sh names the process of roslaunch.
_LAUNCHED_BY = "SKIROS2_LAUNCHED_BY"
#: The environment in which the server imports.
_STARTED_WITH = dict(os.environ)
#: Variables that the interpreter or a library reads when it starts; with others than the server's it is not a fork.
_AT_START = ("LANG", "LC_ALL", "PYTHONHASHSEED", "PYTHONWARNINGS")


class ForkServer:
    """Forks programs.

    :param env: the environment in which modules are imported.
    :param connection: to a server that runs already.
    """

    def __init__(self, python: Path, env: Mapping[str, str], connection: socket.socket | None = None) -> None:
        self.env = {**env, "PYTHONUNBUFFERED": "1"}
        self._python = python
        self._socket = connection
        self._server: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()

    def suits(self, script: Path, env: Mapping[str, str]) -> bool:
        """Whether a program may start as a fork: one of `PACKAGES`, or roslaunch, in a like environment."""
        same = all(env.get(key) == self.env.get(key) for key in _AT_START)
        same_path = [entry for entry in _path(env) if entry in _path(self.env)] == _path(self.env)
        known = script.parent.name in PACKAGES or script == ROSLAUNCH
        return known and script.is_file() and same and same_path

    def start(self, command: Sequence[str], env: Mapping[str, str], cwd: Path | None, out: int, err: int) -> Fork:
        """Starts a program.

        :param command: the script and its arguments.
        :param out, err: the descriptors it writes to.
        """
        ended, ends = os.pipe()
        added = [entry for entry in _path(env) if entry not in _path(self.env)]
        request = {"argv": list(command), "env": dict(env), "cwd": str(cwd or Path.cwd())}
        with self._lock:
            server = self._connection()
            socket.send_fds(server, [json.dumps({**request, "path": added}).encode()], [out, err, ends])
            os.close(ends)
            return Fork(int(server.recv(32)), ended)

    @property
    def cpu(self) -> float:
        """The CPU time of the server and of its programs that have ended (s)."""
        if self._server is None:
            return 0.0
        fields = Path(f"/proc/{self._server.pid}/stat").read_text().rpartition(")")[2].split()
        return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")

    def _connection(self) -> socket.socket:
        if self._socket is None:
            self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with theirs:
                self._server = subprocess.Popen(
                    [self._python, __file__, str(theirs.fileno())],
                    env=self.env,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,  # as its programs: Python's own streams are made for a pipe or a file
                    stderr=subprocess.PIPE,
                    pass_fds=[theirs.fileno()],
                    start_new_session=True,
                )
        return self._socket


def _path(env: Mapping[str, str]) -> list[str]:
    return [entry for entry in env.get("PYTHONPATH", "").split(":") if entry]


class Fork:
    """A forked program, used as `subprocess.Popen` is.

    :param ended: the descriptor that tells its exit status.
    """

    def __init__(self, pid: int, ended: int) -> None:
        self.pid = pid
        self._ended = ended
        self._status: int | None = None

    def poll(self) -> int | None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self._status

    def wait(self, timeout: float | None = None) -> int:
        """
        :raises subprocess.TimeoutExpired: it still runs.
        """
        if self._status is None:
            if not is_readable(self._ended, timeout):
                raise subprocess.TimeoutExpired(f"fork {self.pid}", timeout or 0.0)
            if self._status is None:  # another thread may have waited too
                told, self._status = os.read(self._ended, 32), -signal.SIGKILL
                self._status = int(told or self._status)
        return self._status

    def __del__(self) -> None:
        os.close(self._ended)


def is_readable(descriptor: int, timeout: float | None) -> bool:
    """Waits until a descriptor, of any number, can be read.

    :param timeout: s at most; None: for ever.
    """
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(None if timeout is None else 1000.0 * timeout))


# -- the server --------------------------------------------------------------------------------------------------------


def _imports() -> set[str]:
    """The modules that the programs import."""
    programs = Path(__file__).parents[2] / "install/lib"
    trees = [ast.parse(script.read_text()) for package in PACKAGES for script in (programs / package).iterdir()]
    nodes = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {"roslaunch", *(node.module for node in nodes if node.module)}


def _serve(requests: socket.socket) -> tuple[dict[str, Any], socket.socket]:
    """Forks until the connection ends. Returns only in a fork: the request, and a connection for forks of its own.

    What a fork has started so is killed at its end, if it still runs.
    """
    wake, woken = os.pipe()
    os.set_blocking(woken, False)
    signal.set_wakeup_fd(woken)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    running: dict[int, int] = {}
    clients: dict[socket.socket, list[int]] = {requests: []}
    while True:
        ready, _, _ = select.select([*clients, wake], [], [])
        if wake in ready:
            os.read(wake, 1000)
            _tell_ends(running)
        for client in clients.keys() & set(ready):
            text, descriptors, _, _ = socket.recv_fds(client, 1 << 20, 3)
            if not text:
                started = clients.pop(client)
                for pid in running.keys() & set(running if client is requests else started):
                    with contextlib.suppress(ProcessLookupError):
                        os.killpg(pid, signal.SIGKILL)
                if client is requests:
                    os._exit(0)
                client.close()
                continue
            out, err, ends = descriptors
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            pid = os.fork()
            if pid == 0:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                os.setsid()
                os.dup2(out, 1)
                os.dup2(err, 2)
                connections = [connection.detach() for connection in (ours, *clients)]
                for descriptor in (wake, woken, *descriptors, *running.values(), *connections):
                    os.close(descriptor)
                return dict(json.loads(text)), theirs
            for descriptor in (theirs.detach(), out, err):
                os.close(descriptor)
            running[pid], clients[ours] = ends, []
            clients[client].append(pid)
            client.send(str(pid).encode())


def _tell_ends(running: dict[int, int]) -> None:
    """Tells the exit statuses of the programs that have ended."""
    for pid in list(running):
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            ends = running.pop(pid)
            with contextlib.suppress(BrokenPipeError):
                os.write(ends, str(os.waitstatus_to_exitcode(status)).encode())
            os.close(ends)


def _become(request: dict[str, Any], connection: socket.socket) -> str:
    """Prepares this process for a program. Returns the script."""
    import rospy.names

    os.chdir(request["cwd"])
    os.environ.clear()
    os.environ.update(request["env"])
    sys.argv[:] = request["argv"]  # in place: it is the default argument of roslaunch.main
    sys.path[0] = os.path.dirname(sys.argv[0])
    sys.path[1:1] = request["path"]
    for file in (Path(entry, "sitecustomize.py") for entry in request["path"]):
        if file.is_file():  # as Python does when it starts
            runpy.run_path(str(file))
    importlib.reload(rospy.names)  # it reads the arguments and the namespace when it is imported
    if Path(sys.argv[0]) == ROSLAUNCH:
        _fork_nodes(ForkServer(Path(sys.executable), _STARTED_WITH, connection))
    else:
        connection.close()
        if launcher := os.environ.get(_LAUNCHED_BY):
            os.getppid = lambda: int(launcher)
    return sys.argv[0]


# -- roslaunch ---------------------------------------------------------------------------------------------------------


def _fork_nodes(forks: ForkServer) -> None:
    """Lets roslaunch in this process start its nodes and checks as forks, if they can be."""
    popen = subprocess.Popen

    def start(command: Any, *args: Any, env: Any = None, cwd: Any = None, stdout: Any = None, **options: Any) -> Any:
        words, variables = [str(word) for word in command], dict(env or os.environ)
        if Path(words[0]).name == "node.sh" and (words[1] == "true" or not variables.get("DISPLAY")):
            words = words[2:]  # the script does no more
            variables |= {"PYTHONUNBUFFERED": "1", _LAUNCHED_BY: str(os.getpid())}
        if isinstance(command, str) or not forks.suits(Path(words[0]), variables):
            return popen(command, *args, env=env, cwd=cwd, stdout=stdout, **options)
        if stdout == subprocess.PIPE:
            return _Check(forks, words, variables)
        return forks.start(words, variables, cwd, 1 if stdout is None else stdout.fileno(), 2)

    subprocess.Popen = start  # type: ignore[assignment, misc]


class _Check:
    """A forked program whose output roslaunch reads."""

    def __init__(self, forks: ForkServer, command: Sequence[str], env: Mapping[str, str]) -> None:
        self._output, write = os.pipe()
        self._fork = forks.start(command, env, None, write, 2)
        os.close(write)

    def communicate(self) -> tuple[bytes, None]:
        with open(self._output, "rb") as output:
            return output.read(), None

    @property
    def returncode(self) -> int:
        return self._fork.wait()


if __name__ == "__main__":
    for module in _imports():
        importlib.import_module(module)
    gc.freeze()
    runpy.run_path(_become(*_serve(socket.socket(fileno=int(sys.argv[1])))), run_name="__main__")
