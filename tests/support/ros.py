"""A private ROS master with nodes and launch files from install/.

A test asks for the fixture `ros` (tests/conftest.py), a `Ros`:

    def test_the_world_model_has_a_root(ros):
        ros.launch("skiros2", "world_model_server.launch", gui=False)
        get = ros.service("/wm/get", WmGet)
        assert get(action="get", element=WmElement(id="skiros:Scene-0")).elements

- One master and one node in the test process serve the whole session, because rospy can be initialised once in a
  process. Each test starts the platform's nodes that it needs; they, and the parameters they set, go with the test.
- Nothing sleeps: wait for a service, a message, a line of output, an exit, or (`wait_until`) any condition.
- What the programs printed is shown with a test that fails.
- A test of roslaunch's own end, or of a missing master, takes another master: `with RosMaster(tmp_path) as master:` and
  `ros.launch(..., env=master.env)`.
"""

from __future__ import annotations

import functools
import os
import signal
import subprocess
import tempfile
import threading
import time
import xmlrpc.client
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from skiros2_common.core.processes import free_port
from support.forks import ROSLAUNCH, ForkServer
from support.programs import PATIENCE, ProcessId, Program, descendants

ROOT = Path(__file__).resolve().parents[2]
INSTALL = ROOT / "install"

#: The nodes that belong to the master and to the test process.
_TEST_NODES = ("/rosout", "/tests")

#: Of these, a test's programs get no other values than the harness gives them.
_ROS_VARIABLES = ("CMAKE_PREFIX_PATH", "PYTHONPATH", "ROS_PACKAGE_PATH", "ROS_NAMESPACE", "ROS_IP", "ROS_LOG_DIR")


@functools.cache
def install_environment(setup: Path = INSTALL / "setup.bash") -> dict[str, str]:
    """The environment of a shell that has sourced this set-up file, and no other workspace's."""
    if not setup.is_file():
        raise FileNotFoundError(f"{setup} is not there; run: make setup")
    clean = {key: value for key, value in os.environ.items() if key not in _ROS_VARIABLES}
    dump = subprocess.run(
        ["bash", "-c", 'source "$1" && exec env -0', "bash", str(setup)],
        env=clean,
        stdout=subprocess.PIPE,
        check=True,
        text=True,
    ).stdout
    return dict(line.split("=", 1) for line in dump.split("\0") if line)


@functools.cache
def _forks() -> ForkServer:
    return ForkServer(ROOT / ".venv/bin/python3", install_environment())


def forks_cpu() -> float:
    """The CPU time of forked programs that have ended, and of what forks them (s)."""
    return _forks().cpu if _forks.cache_info().currsize else 0.0


def _forked(command: Sequence[str], env: Mapping[str, str]) -> list[str]:
    """The script and the arguments of a program that can be forked; of others nothing."""
    if command[0] == ROSLAUNCH.name:
        return [str(ROSLAUNCH), *command[1:]] if _forks().suits(ROSLAUNCH, env) else []
    package, *rest = command[1:] if command[0] == "rosrun" else (Path(command[0]).parent.name, *command)
    script = INSTALL / "lib" / package / rest[0]
    return [str(script), *rest[1:]] if _forks().suits(script, env) else []


def start_program(
    command: Sequence[str], env: Mapping[str, str], cwd: Path | None = None, *, may_fork: bool = True
) -> Program:
    """Starts a program; roslaunch, and what `rosrun` would start, is forked if it can be (see support/forks.py)."""
    if may_fork and (forked := _forked(command, env)):
        return Program(forked, env, cwd, _forks())
    return Program(command, env, cwd)


def run_command(
    command: Sequence[str], env: Mapping[str, str], cwd: Path | None = None, timeout: float = 60.0
) -> subprocess.CompletedProcess[str]:
    """Runs a program to its end, as `start_program` starts it."""
    forked = _forked(command, env)
    if not forked:
        return subprocess.run(command, env=env, cwd=cwd, capture_output=True, text=True, timeout=timeout)
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        fork = _forks().start(forked, env, cwd, out.fileno(), err.fileno())
        status = None
        try:
            status = fork.wait(timeout)
        finally:
            if status is None:  # a timeout, or the test is interrupted
                os.killpg(fork.pid, signal.SIGKILL)
        for file in (out, err):
            file.seek(0)
        return subprocess.CompletedProcess(command, status, out.read(), err.read())


def wait_until(condition: Callable[[], Any], timeout: float = PATIENCE, what: str = "") -> Any:
    """Asks up to 50 times a second until the condition is true, and returns its value.

    :raises AssertionError: it is not true within that time (s).
    """
    end, pause = time.monotonic() + timeout, 0.02
    while True:
        if value := condition():
            return value
        if time.monotonic() > end:
            raise AssertionError(f"not within {timeout:g} s: {what or condition}")
        time.sleep(pause)
        pause = min(1.2 * pause, 0.1)  # a question to the master costs as much as it gives


class RosMaster:
    """`roscore` on a free port with a `ROS_HOME` of its own; a context manager.

    :param home: its `ROS_HOME`, where logs go too.
    """

    def __init__(self, home: Path) -> None:
        self.home = home
        self.port = free_port()
        self.uri = f"http://localhost:{self.port}"
        #: For programs that are to use this master.
        self.env = {
            **install_environment(),
            "ROS_MASTER_URI": self.uri,
            "ROS_HOSTNAME": "localhost",
            "ROS_HOME": str(home),
            "HOME": str(home),
            "PYTHONUNBUFFERED": "1",
        }
        self._roscore: Program | None = None
        #: The systems that run on it.
        self.systems: list[Ros] = []
        #: The parameters that it has by itself.
        self.own_parameters: set[str] = set()

    def start(self) -> None:
        self._roscore = Program(["roscore", "-p", str(self.port)], self.env)
        self._roscore.wait_for_line(r"started core service")
        wait_until(lambda: "/rosout" in self.nodes(), what="rosout on the new master")
        self.own_parameters = self.parameters()

    def stop(self) -> None:
        if self._roscore is not None:
            self._roscore.stop()

    def kill(self) -> None:
        """Kills it, with its rosout. `start` then starts another one under the same URI."""
        assert self._roscore is not None
        for process in descendants(self._roscore.pid):
            process.kill()
        self._roscore.signal(signal.SIGKILL)
        self._roscore.wait()

    def __enter__(self) -> RosMaster:
        self.start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.stop()

    def forget(self, nodes: set[str]) -> None:
        """Takes back what these nodes have registered, whether or not something answers at their addresses."""
        publishers, subscribers, services = self._state()
        for call, known in (("unregisterPublisher", publishers), ("unregisterSubscriber", subscribers)):
            for topic, who in known:
                for node in nodes & set(who):
                    self._ask(call, topic, self._ask("lookupNode", node), caller=node)
        for service, who in services:
            for node in nodes & set(who):
                self._ask("unregisterService", service, self._ask("lookupService", service), caller=node)

    # -- what the master knows ------------------------------------------------------------------------------------

    def nodes(self) -> set[str]:
        """The names of all nodes that are registered."""
        return {node for kind in self._state() for _, nodes in kind for node in nodes}

    def registrations(self, nodes: set[str]) -> set[tuple[str, str, str]]:
        """What these nodes have registered, each a kind, a topic or service, and the node."""
        kinds = zip(("publishes", "subscribes", "serves"), self._state(), strict=True)
        found = {(kind, name, node) for kind, known in kinds for name, who in known for node in who}
        return {entry for entry in found if entry[2] in nodes}

    def services(self) -> set[str]:
        return {name for name, _ in self._state()[2]}

    def topics(self) -> set[str]:
        """The topics that somebody publishes."""
        return {name for name, _ in self._state()[0]}

    def subscribers(self, topic: str) -> set[str]:
        return {node for name, nodes in self._state()[1] if name == topic for node in nodes}

    def parameters(self) -> set[str]:
        return set(self._ask("getParamNames"))

    def parameter(self, name: str) -> Any:
        return self._ask("getParam", name)

    def set_parameter(self, name: str, value: Any) -> None:
        self._ask("setParam", name, value)

    def delete_parameter(self, name: str) -> None:
        self._ask("deleteParam", name)

    def node_pid(self, node: str) -> int:
        """The process number of a node, as it says itself."""
        uri = self._ask("lookupNode", node)
        return int(xmlrpc.client.ServerProxy(uri).getPid("/tests")[2])  # type: ignore[index, call-overload]

    def readers(self, node: str) -> set[tuple[str, str]]:
        """(node, topic) of the nodes that are connected to a publisher of a node."""
        return set(self.connections(node).values())

    def connections(self, node: str) -> dict[int, tuple[str, str]]:
        """The same by the number of the connection. A closed one may be listed for half a second more."""
        info = xmlrpc.client.ServerProxy(self._ask("lookupNode", node)).getBusInfo("/tests")[2]
        found = (entry for entry in info if entry[2] == "o" and entry[5:6] == [1])  # type: ignore[union-attr, index]
        return {number: (other, topic) for number, other, _, _, topic, *_ in found}

    def service_address(self, service: str) -> tuple[str, int]:
        """Where the node that offers a service takes connections."""
        host, _, port = self._ask("lookupService", service).removeprefix("rosrpc://").rpartition(":")
        return host, int(port)

    def _state(self) -> Any:
        return self._ask("getSystemState")

    def _ask(self, call: str, *arguments: Any, caller: str = "/tests") -> Any:
        with xmlrpc.client.ServerProxy(self.uri) as master:
            code, text, value = getattr(master, call)(caller, *arguments)
        if code != 1:
            raise LookupError(f"{call}{arguments}: {text}")
        return value


class Ros:
    """The programs of one test on a master, and what it waits for. `stop` ends them and takes their parameters away."""

    def __init__(self, master: RosMaster) -> None:
        self.master = master
        self.programs: list[Program] = []
        self._subscriptions: list[Messages] = []
        self._nodes_before = master.nodes()
        self._parameters_before = master.parameters()
        master.systems.append(self)

    # -- starting -------------------------------------------------------------------------------------------------

    def launch(
        self,
        package: str,
        file: str,
        *,
        namespace: str = "",
        env: Mapping[str, str] | None = None,
        forked: bool = True,
        **arguments: Any,
    ) -> Program:
        """`roslaunch package file name:=value ...`; does not wait for the nodes.

        :param namespace: put all of it below this name.
        :param env: another environment than this master's, `RosMaster.env` for example.
        :param forked: False for tests of the launch itself: the real roslaunch, not a fork (see support/forks.py).
        :param arguments: launch arguments; bool and list are written as YAML.
        """
        return self._start([*_ROSLAUNCH, package, file, *_launch_arguments(arguments)], namespace, env, forked)

    def launch_file(
        self, path: Path, *, namespace: str = "", env: Mapping[str, str] | None = None, **arguments: Any
    ) -> Program:
        """Starts a launch file by its path, with the real roslaunch."""
        return self._start([*_ROSLAUNCH, str(path), *_launch_arguments(arguments)], namespace, env, may_fork=False)

    def run(
        self,
        package: str,
        node: str,
        *arguments: str,
        name: str = "",
        params: Mapping[str, Any] | None = None,
        namespace: str = "",
        env: Mapping[str, str] | None = None,
    ) -> Program:
        """`rosrun package node arguments`; does not wait until it is ready.

        :param name: another name for the node.
        :param params: its private parameters, `{"verbose": True}`: set on the master first, so they need `name`.
        """
        if params and not name:
            raise ValueError("private parameters need the node's name")
        for key, value in (params or {}).items():
            self.master.set_parameter(_full_name(namespace, name, key), value)
        remap = [f"__name:={name}"] if name else []
        return self._start(["rosrun", package, node, *arguments, *remap], namespace, env)

    def program(self, *command: str, env: Mapping[str, str] | None = None) -> Program:
        """Any other program in this master's environment."""
        return self._start(list(command), "", env)

    # -- waiting --------------------------------------------------------------------------------------------------

    def service(self, name: str, kind: Any, timeout: float = PATIENCE) -> Callable[..., Any]:
        """Waits until the service is there, and returns what calls it (a `rospy.ServiceProxy`)."""
        import rospy

        try:
            rospy.wait_for_service(name, timeout)
        except rospy.ROSException:
            there = sorted(self.master.services())
            raise AssertionError(f"no service {name} in {timeout:g} s; there are {there}") from None
        return rospy.ServiceProxy(name, kind)  # type: ignore[no-any-return]

    def messages(self, topic: str, kind: Any) -> Messages:
        """Collects the messages of a topic from now on, starting with a latched one."""
        messages = Messages(topic, kind)
        self._subscriptions.append(messages)
        return messages

    def wait_for_node(self, name: str, timeout: float = PATIENCE) -> None:
        wait_until(lambda: name in self.master.nodes(), timeout, f"a node {name}")

    def wait_until_gone(self, name: str, timeout: float = PATIENCE) -> None:
        wait_until(lambda: name not in self.master.nodes(), timeout, f"no node {name} any more")

    # -- the end --------------------------------------------------------------------------------------------------

    def kill_node(self, name: str) -> None:
        """Kills the process of a node, and waits for its end."""
        process = ProcessId(self.master.node_pid(name))
        process.kill()
        wait_until(lambda: not process.running, what=f"the end of {name}")

    def stop(self) -> None:
        for messages in self._subscriptions:
            messages.close()
        for program in reversed(self.programs):
            program.stop()
        if self in self.master.systems:
            self.master.systems.remove(self)
        # Another system may have ended since: what it left under the same names goes with the last one.
        alone = not self.master.systems
        before = self.master.own_parameters if alone else self._parameters_before
        for name in self.master.parameters() - before:
            self.master.delete_parameter(name)
        remaining = {name for name in self.master.nodes() if not name.startswith(_TEST_NODES)}
        left = remaining - (set() if alone else self._nodes_before)  # killed ones have not said goodbye to the master
        if left and alone:  # another node may have the address of a killed one by now, and would answer for it
            self.master.forget(left)
        elif left:
            subprocess.run(["rosnode", "cleanup"], env=self.master.env, input=b"y\n", capture_output=True, check=True)

    def _start(
        self, command: list[str], namespace: str, env: Mapping[str, str] | None, may_fork: bool = True
    ) -> Program:
        environment = dict(env or self.master.env)
        if namespace:
            environment["ROS_NAMESPACE"] = namespace
        program = start_program(command, environment, self.master.home, may_fork=may_fork)
        self.programs.append(program)
        return program


class SharedSystem:
    """A running system that the tests of a file share; it starts with the first test that uses it.

    A fixture calls `use` before a test and `restore` after it. A test that breaks the system, or starts nodes of the
    same names, calls `stop`; the next test gets a new system. A context manager.

    :param start: starts the nodes and waits for them.
    """

    def __init__(self, master: RosMaster, start: Callable[[Ros], None]) -> None:
        self._master, self._start = master, start
        self._ros: Ros | None = None
        self._wmi: Any = None
        self._scene: dict[str, Any] = {}

    def __enter__(self) -> SharedSystem:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.stop()

    @property
    def programs(self) -> list[Program]:
        return self._ros.programs if self._ros else []

    def use(self) -> Ros:
        """Starts the system unless it runs, and remembers the scene."""
        from skiros2_world_model.ros.world_model_interface import WorldModelInterface

        if self._ros is None:
            self._ros = Ros(self._master)
            self._start(self._ros)
            self._wmi = WorldModelInterface("shared_system")
        self._scene = self._elements()
        return self._ros

    def restore(self) -> None:
        """Undoes the changes of the scene since `use`. Stops the system if an element was removed."""
        now = self._elements() if self._ros is not None else {}
        if self._ros is None or self._scene.keys() - now.keys():
            self.stop()
            return
        for eid in now.keys() - self._scene.keys():
            if self._wmi.find_element(eid) is not None:  # it may have gone with the element that contains it
                self._wmi.remove_element(eid)
        for eid, before in self._scene.items():
            if _properties(now[eid]) != _properties(before):
                self._restore_properties(now[eid], _properties(before))
            for subj, pred, obj in _relations(now[eid]) - _relations(before):
                if obj in self._scene:
                    self._wmi.set_relation(subj, pred, obj, False)
            for subj, pred, obj in _relations(before) - _relations(now[eid]):
                self._wmi.set_relation(subj, pred, obj)

    def stop(self) -> None:
        if self._ros is not None:
            self._ros.stop()
            self._ros = None
        if self._wmi is not None:
            self._wmi.remote.unfollow()
            self._wmi = None

    def _restore_properties(self, element: Any, before: dict[str, list[Any]]) -> None:
        """Writes the properties as they were; of an element that was read, only changes are written."""
        for key in _properties(element).keys() - before.keys():
            element.removeProperty(key)
        for key, values in before.items():
            element.setProperty(key, values)
        self._wmi.update_element_properties(element)

    def _elements(self) -> dict[str, Any]:
        self._wmi.catch_up()
        return {element.id: element for element in self._wmi.get_scene_elements()}


def _properties(element: Any) -> dict[str, list[Any]]:
    return {prop.key: prop.values for prop in element.properties}


def _relations(element: Any) -> set[tuple[str, str, str]]:
    """The relations of which the element is the subject."""
    return {(element.id, r["type"], r["dst"]) for r in element.getRelations() if r["src"] == "-1"}


class Messages:
    """The messages of a topic, oldest first, as they come; thread-safe."""

    def __init__(self, topic: str, kind: Any) -> None:
        import rospy

        self.topic = topic
        self._all: list[Any] = []
        self._change = threading.Condition()
        self._subscriber = rospy.Subscriber(topic, kind, self._take)

    @property
    def all(self) -> list[Any]:
        with self._change:
            return list(self._all)

    def wait_for(self, condition: Callable[[Any], Any] = lambda message: True, timeout: float = PATIENCE) -> Any:
        """The first message, of those that have come and will come, for which the condition is true.

        :raises AssertionError: there is none within that time (s).
        """
        seen = 0
        end = time.monotonic() + timeout
        with self._change:
            while True:
                for message in self._all[seen:]:
                    if condition(message):
                        return message
                seen = len(self._all)
                left = end - time.monotonic()
                if left <= 0:
                    last = str(self._all[-1])[:2000] if self._all else ""
                    raise AssertionError(
                        f"{seen} messages on {self.topic} in {timeout:g} s, none as wanted; last:\n{last}"
                    )
                self._change.wait(left)

    def connected(self) -> Messages:
        """Waits until a publisher is connected, so that the next message is not missed; returns itself."""
        wait_until(self._subscriber.get_num_connections, what=f"a publisher of {self.topic}")
        return self

    def clear(self) -> None:
        """Forgets what has come so far."""
        with self._change:
            self._all.clear()

    def close(self) -> None:
        self._subscriber.unregister()

    def _take(self, message: Any) -> None:
        with self._change:
            self._all.append(message)
            self._change.notify_all()


_ROSLAUNCH = ("roslaunch", "--skip-log-check", "--disable-title", "--no-summary")


def _launch_arguments(arguments: Mapping[str, Any]) -> list[str]:
    return [f"{name}:={_yaml(value)}" for name, value in arguments.items()]


def _full_name(*parts: str) -> str:
    return "/" + "/".join(part.strip("/") for part in parts if part)


def _yaml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_yaml(item) for item in value) + "]"
    return str(value)
