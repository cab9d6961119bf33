"""`rosrun skiros2_skill doctor`: checks an installation and the running system, and says what to do."""

from __future__ import annotations

import argparse
import importlib.util
import os
import socket
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import urlsplit

import rosgraph

from skiros2_common.command_line.command import (
    OK,
    REFUSED,
    CommandResult,
    Parser,
    Unavailable,
    command_arguments,
    end,
    run_command,
)
from skiros2_common.command_line.master import XMLRPC_ERRORS, ask_master, ask_node

GOOD, WARNING, ERROR = "ok", "warning", "error"

#: Modules that every installation needs, and those of a part: its name and the list of `.ci/setup` that installs it.
_REQUIRED = ("rospy", "actionlib", "tf2_py", "skiros2_msgs", "rdflib", "pyoxigraph", "unified_planning", "rosbags")
_PARTS = {
    "up_fast_downward": ("planning", "planner"),
    "pybullet": ("simulation", "sim"),
    "optuna": ("learning", "learning"),
    "python_qt_binding": ("the window", "window"),
}
#: How long tf is listened to (s), and the difference of clocks from which transforms are lost (s).
_LISTENING, _SKEW = 1.5, 0.5


@dataclass(frozen=True)
class Finding:
    """The result of one check.

    :param severity: `GOOD`, `WARNING` or `ERROR`.
    :param check: a name for programs.
    :param advice: what to do; "" if nothing.
    """

    severity: str
    check: str
    text: str
    advice: str = ""

    def __str__(self) -> str:
        return f"{self.severity:8} {self.text}" + (f"\n         -> {self.advice}" if self.advice else "")


def run(arguments: Sequence[str] | None = None) -> NoReturn:
    """Runs the command and ends the process with its status.

    :param arguments: of the command line; None: those of this process.
    """
    parser = Parser(
        prog="doctor",
        description="Checks the installation and the running system, and says what to do.",
        epilog="Exit status: 0 no errors, 1 errors, 2 wrong usage.",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    given: argparse.Namespace = parser.parse_args(command_arguments(arguments))
    end(run_command("doctor", _examine, given.json))


def _examine() -> CommandResult:
    findings = [*_modules(), *_workspace(), *_own_address()]
    try:
        state = ask_master("getSystemState")
    except Unavailable as error:
        findings.append(Finding(WARNING, "master", str(error), "the running system was not checked"))
    else:
        findings.append(Finding(GOOD, "master", f"the ROS master answers at {rosgraph.get_master_uri()}"))
        system = _System(*state)
        for check in _RUNNING:
            findings += check(system)
    status = REFUSED if any(f.severity == ERROR for f in findings) else OK
    return CommandResult([str(f) for f in findings], [asdict(f) for f in findings], status)


# -- the installation --------------------------------------------------------------------------------------------------


def _modules() -> Iterator[Finding]:
    missing = [name for name in _REQUIRED if not _is_there(name)]
    if missing:
        advice = "source install/setup.bash in this terminal; run `make setup` if there is none"
        yield Finding(ERROR, "modules", f"Python modules are missing: {', '.join(missing)}", advice)
    else:
        version = ".".join(map(str, sys.version_info[:3]))
        yield Finding(GOOD, "modules", f"Python {version} at {sys.executable} has all required modules")
    for name, (part, group) in _PARTS.items():
        if _is_there(name):
            yield Finding(GOOD, f"part-{group}", f"{part}: {name} is there")
        else:
            yield Finding(WARNING, f"part-{group}", f"{part} is not installed: no {name}", f".ci/setup {group}")


def _is_there(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


def _workspace() -> Iterator[Finding]:
    roots = [path for path in os.environ.get("CMAKE_PREFIX_PATH", "").split(":") if path]
    copies = list(dict.fromkeys(path for path in sys.path if (Path(path) / "skiros2_common").is_dir()))
    if not roots:
        advice = "source install/setup.bash in this terminal"
        yield Finding(ERROR, "workspace", "no workspace is sourced: CMAKE_PREFIX_PATH is empty", advice)
    elif len(copies) > 1:
        text = f"several copies of skiros2 are on PYTHONPATH, the first is used: {', '.join(copies)}"
        yield Finding(WARNING, "workspace", text, "source one workspace, in a new terminal")
    else:
        yield Finding(GOOD, "workspace", f"workspace {roots[0]}")


def _own_address() -> Iterator[Finding]:
    """Other hosts reach the nodes of this one by the name that they register."""
    host = rosgraph.network.get_host_name()
    source = next((name for name in ("ROS_HOSTNAME", "ROS_IP") if os.environ.get(name)), "the host name")
    advice = "set ROS_IP to an address of this host"
    try:
        address = socket.getaddrinfo(host, None)[0][4][0]
    except OSError:
        yield Finding(ERROR, "own-address", f"this host is not known as {host} ({source})", advice)
        return
    if rosgraph.network.is_local_address(str(address)):
        yield Finding(GOOD, "own-address", f"nodes of this host are {host}, {address}")
    else:
        text = f"{host} ({source}) is {address}, which is not an address of this host"
        yield Finding(ERROR, "own-address", text, advice)


# -- the running system ------------------------------------------------------------------------------------------------


class _System:
    """The registrations at the master: names of topics and services, each with its nodes."""

    def __init__(self, publishers: list[Any], subscribers: list[Any], services: list[Any]) -> None:
        self.publishers = {str(name): sorted(nodes) for name, nodes in publishers}
        self.services = {str(name): sorted(nodes) for name, nodes in services}
        registrations = (*publishers, *subscribers, *services)
        self.nodes = sorted({str(node) for _, nodes in registrations for node in nodes})

    def offering(self, *services: str) -> list[str]:
        """The nodes that offer all of these services below their own name."""
        return [node for node in self.nodes if all(f"{node}/{service}" in self.services for service in services)]


def _nodes(system: _System) -> Iterator[Finding]:
    dead = []
    for node in system.nodes:
        address = str(ask_master("lookupNode", node) or "")
        try:
            ask_node(address, "getPid")
        except XMLRPC_ERRORS:
            dead.append(f"{node} at {urlsplit(address).netloc or 'no address'}")
    if dead:
        text = f"nodes are registered that do not answer: {', '.join(dead)}"
        yield Finding(ERROR, "nodes", text, "rosnode cleanup; for a node of another host, check its ROS_IP")
    else:
        yield Finding(GOOD, "nodes", f"all {len(system.nodes)} nodes answer")


def _clock(system: _System) -> Iterator[Finding]:
    simulated = bool(ask_master("getParam", "/use_sim_time"))
    clocks = system.publishers.get("/clock", [])
    if simulated and not clocks:
        advice = "start the simulator, or `rosparam set use_sim_time false` and restart the nodes"
        yield Finding(ERROR, "clock", "use_sim_time is true, but no node publishes /clock: all nodes wait", advice)
    elif len(clocks) > 1:
        yield Finding(ERROR, "clock", f"several nodes publish /clock: {', '.join(clocks)}", "stop all but one of them")
    elif clocks and not simulated:
        advice = "`rosparam set use_sim_time true` before the nodes are started"
        yield Finding(WARNING, "clock", f"{clocks[0]} publishes /clock, but use_sim_time is false", advice)
    else:
        yield Finding(GOOD, "clock", f"simulated time of {clocks[0]}" if clocks else "wall time")


def _parts(system: _System) -> Iterator[Finding]:
    models = system.offering("get", "modify")
    managers = system.offering("get_skills", "command")
    planners = [name.removesuffix("/achieve/status") for name in system.publishers if name.endswith("/achieve/status")]
    for check, found, what, file in (
        ("world-model", models, "world model", "world_model_server.launch"),
        ("skill-managers", managers, "skill manager", "skill_mgr.launch"),
        ("task-manager", planners, "task manager", "task_mgr.launch"),
    ):
        if found:
            yield Finding(GOOD, check, f"{what}: {', '.join(found)}")
        else:
            yield Finding(WARNING, check, f"no {what} runs", f"roslaunch skiros2 {file}, or skiros.launch for all")
    spaces = {rosgraph.names.namespace(node) for node in (*models, *managers, *planners)}
    if len(spaces) > 1:
        text = f"the parts are in several namespaces: {', '.join(sorted(spaces))}"
        yield Finding(WARNING, "namespaces", text, "start those that belong together in one namespace")


def _transforms(system: _System) -> Iterator[Finding]:
    """Listens to tf: one publisher and one parent for each frame, and stamps of the present."""
    import rospy
    from tf2_msgs.msg import TFMessage

    if not system.publishers.keys() & {"/tf", "/tf_static"}:
        return
    if bool(ask_master("getParam", "/use_sim_time")) and not system.publishers.get("/clock"):
        return
    rospy.init_node("doctor", anonymous=True, disable_signals=True)
    publishers: dict[str, set[str]] = defaultdict(set)
    parents: dict[str, set[str]] = defaultdict(set)
    late: dict[str, float] = {}

    def on_tf(message: Any, is_static: bool) -> None:
        caller = message._connection_header["callerid"]
        now = rospy.Time.now()
        for transform in message.transforms:
            publishers[transform.child_frame_id].add(caller)
            parents[transform.child_frame_id].add(transform.header.frame_id)
            age = (now - transform.header.stamp).to_sec()
            if not is_static and abs(age) > _SKEW:
                late[caller] = max(late.get(caller, 0.0), age, key=abs)

    for topic, is_static in (("/tf", False), ("/tf_static", True)):
        rospy.Subscriber(topic, TFMessage, on_tf, is_static, queue_size=100)
    time.sleep(_LISTENING)
    rospy.signal_shutdown("examined")
    several = {frame: nodes for frame, nodes in publishers.items() if len(nodes) > 1}
    for frame, nodes in sorted(several.items()):
        text = f"frame {frame} is published by several nodes: {', '.join(sorted(nodes))}"
        yield Finding(ERROR, "tf-publishers", text, "let one of them publish it")
    for frame, names in sorted(parents.items()):
        if len(names) > 1 and frame not in several:
            yield Finding(ERROR, "tf-parents", f"frame {frame} has several parents: {', '.join(sorted(names))}")
    for node, age in sorted(late.items()):
        text = f"transforms of {node} are {abs(age):.1f} s {'old' if age > 0 else 'in the future'}"
        yield Finding(WARNING, "tf-stamps", text, "synchronise the clocks of the hosts (chrony), or relieve the node")
    if not several and not late:
        yield Finding(GOOD, "tf", f"{len(publishers)} frames on tf")


_RUNNING: tuple[Callable[[_System], Iterator[Finding]], ...] = (_nodes, _clock, _parts, _transforms)
