"""All nodes continue with a restarted ROS master."""

from __future__ import annotations

import json
import select
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_msgs.msg import SkillProgress
from skiros2_task.ros.task_manager_interface import NOTHING_TO_DO
from support import cell_client
from support.ros import Ros, RosMaster, wait_until

pytestmark = pytest.mark.timeout(120)

ROBOT = "/test_robot"
NODES = {"/wm", "/tm", ROBOT, "/cell_client"}


def start_world_model(ros: Ros, workspace: Path) -> None:
    ros.run("skiros2_world_model", "world_model_server_node", name="wm", params={"workspace_dir": str(workspace)})


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Ros]:
    """A world model, a skill manager and a task manager on a master of their own."""
    with RosMaster(tmp_path) as master:
        ros = Ros(master)
        try:
            start_world_model(ros, tmp_path)
            libraries = {"libraries_list": ["skiros2_std_skills"], "primitive_list": ["counter"]}
            ros.run("skiros2_skill", "skill_manager_node", name="test_robot", params=libraries)
            ros.run("skiros2_task", "task_manager_node", name="tm")
            wait_until(lambda: {f"{ROBOT}/command", "/wm/history"} <= master.services(), what="the services")
            wait_until(lambda: "/tm/task_plan/status" in master.topics(), what="the task manager")
            yield ros
        finally:
            ros.stop()


@pytest.fixture
def client(cell: Ros) -> Iterator[Client]:
    client = Client(cell.master)
    yield client
    client.close()


class Client:
    """The program `cell_client.py`."""

    def __init__(self, master: RosMaster, name: str = "cell_client") -> None:
        self._process = subprocess.Popen(
            [sys.executable, cell_client.__file__, f"__name:={name}"],
            env=master.env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1,
        )  # fmt: skip
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"

    def ask(self, command: str) -> Any:
        self.send(command)
        return self.answer()

    def send(self, command: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()

    def answer(self) -> Any:
        assert self._process.stdout is not None
        return json.loads(self._process.stdout.readline())

    def has_answered(self, timeout: float) -> bool:
        return bool(select.select([self._process.stdout], [], [], timeout)[0])

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()


@pytest.mark.long
def test_nodes_and_clients_continue_with_a_new_master(cell: Ros, client: Client) -> None:
    client.ask("add before")
    wait_until(lambda: client.ask("skills") == {ROBOT: ["counter"]}, what="the manager's skills")
    registered = cell.master.registrations(NODES)
    assert {name for _, _, name in registered} == NODES
    libraries = cell.master.parameter(f"{ROBOT}/libraries_list")
    cell.master.kill()
    client.ask("add without a master")
    cell.master.start()
    wait_until(lambda: cell.master.registrations(NODES) >= registered, what=f"all of {sorted(registered)}")

    assert cell.master.parameter(f"{ROBOT}/libraries_list") == libraries

    part = client.ask("add after")
    newcomer = Client(cell.master, "newcomer")
    try:
        newcomer.ask("add from a newcomer")
        parts = ["after", "before", "from a newcomer", "without a master"]
        for program in (client, newcomer):
            wait_until(lambda program=program: program.ask("parts") == parts, what=f"the parts {parts}")
            wait_until(lambda program=program: program.ask("skills") == {ROBOT: ["counter"]}, what="the skills")
            assert program.ask("count") == SkillProgress.SUCCESS
            assert program.ask(f"plan (not (skiros:at {part} {part}))") == NOTHING_TO_DO
            told, twice = program.ask("changes")
            assert told > 0
            assert twice == 0
    finally:
        newcomer.close()


@pytest.mark.long
def test_world_model_killed_after_a_new_master_is_found_again(cell: Ros, client: Client, tmp_path: Path) -> None:
    registered = cell.master.registrations(NODES)
    cell.master.kill()
    cell.master.start()
    wait_until(lambda: cell.master.registrations(NODES) >= registered, what=f"all of {sorted(registered)}")
    client.ask("add first life")
    cell.kill_node("/wm")
    start_world_model(cell, tmp_path)
    wait_until(lambda: client.ask("add second life") and "second life" in client.ask("parts"))
    assert "first life" in client.ask("parts")
    wait_until(lambda: client.ask("skills") == {ROBOT: ["counter"]}, what="the skills")
    assert client.ask("count") == SkillProgress.SUCCESS


@pytest.mark.long
def test_a_lock_is_kept_while_the_master_is_away(cell: Ros, client: Client) -> None:
    other = Client(cell.master, "other")
    try:
        assert other.ask("lock") and other.ask("unlock")  # its connection is open from here on
        assert client.ask("lock")
        other.send("lock")
        cell.master.kill()
        assert not other.has_answered(3.0)  # the lock is looked at each second
        cell.master.start()
        assert not other.has_answered(3.0)
        client.ask("unlock")
        assert other.answer()
    finally:
        other.close()
