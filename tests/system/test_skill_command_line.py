"""The commands of `rosrun skiros2_skill` on the robot of the demo."""

from __future__ import annotations

import json
import os
import pty
import re
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from skiros2_msgs import srv as srvs
from support.programs import Program
from support.ros import Ros, RosMaster, run_command, wait_until

pytestmark = pytest.mark.timeout(120)

ROBOT = "/mobile_manipulator"

Run = Callable[..., "subprocess.CompletedProcess[str]"]
Start = Callable[..., Program]


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster) -> Iterator[Ros]:
    """The system of the demo, which the tests share; each leaves its tasks ended."""
    ros = Ros(ros_master)
    ros.launch("skiros2_demo_skills", "demo.launch", gui=False)
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    yield ros
    ros.stop()


@pytest.fixture
def run(ros_master: RosMaster, cell: Ros) -> Iterator[Run]:
    """Runs a command to its end."""

    def run(name: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        command = ["rosrun", "skiros2_skill", name, *arguments]
        env = {**ros_master.env, **environment}
        return run_command(command, env)

    yield run
    run("breakpoint", "remove", "all")
    run("stop")


@pytest.fixture
def start(ros: Ros, cell: Ros) -> Start:
    """Starts a command that keeps running."""
    return lambda name, *arguments: ros.run("skiros2_skill", name, *arguments)


def task_of(started: subprocess.CompletedProcess[str]) -> str:
    """The number of the task that was started without waiting for it."""
    found = re.fullmatch(rf"task (\d+) runs on {ROBOT}\n", started.stdout)
    assert found, started
    return found[1]


def test_skills_are_listed_and_described(run: Run) -> None:
    listed = run("list").stdout.splitlines()
    pick = next(line for line in listed if line.startswith("pick "))
    assert pick.split() == ["pick", "skiros:Pick", "Object", "[Container]", "[Workstation]", "[Arm]", "[Gripper]"]
    described = run("describe", "Pick")
    assert (described.returncode, described.stderr) == (0, "")
    lines = [" ".join(line.split()) for line in described.stdout.splitlines()]
    assert lines[0] == "pick: Picks an object from a container at a workstation."
    assert "under Skiros2DemoSkills > TransportSkills" in lines
    assert "module skiros2_demo_skills.transport_skills" in lines
    assert "Object required skiros:Manipulatable The object to pick" in lines
    assert lines[lines.index("hold-conditions") + 1] == "RobotAtWorkstation Robot skiros:at Workstation"
    missing = run("describe", "pik")
    assert (missing.returncode, missing.stderr) == (1, "describe: there is no skill 'pik'; did you mean 'pick'?\n")


def test_skills_run_in_sequence_with_elements_by_label(run: Run, start: Start, ros: Ros) -> None:
    watching = start("watch")
    as_json = start("watch", "--json")
    watchers = ros.master.subscribers(f"{ROBOT}/monitor")
    wait_until(lambda: len(ros.master.subscribers(f"{ROBOT}/monitor")) >= 2, what=f"two watchers beside {watchers}")
    done = run("run", "drive", "TargetLocation=Workstation 1", "pick", "Object=Product A", "place", "Container=Tray A")
    assert (done.returncode, done.stderr) == (0, ""), done
    told = [line.split(maxsplit=3)[2:] for line in done.stdout.splitlines() if line.startswith("  ")]
    names = [" ".join(words).split()[:2] for words in told]
    for began, ended in (("drive", "drive"), ("pick", "pick"), ("place", "place")):
        assert names.index(["▶", began]) < names.index(["✓", ended])
    assert names.index(["✓", "move_base_timed"]) < names.index(["✓", "drive"])
    assert re.search(r"^task \d+ has succeeded after \d+\.\d s$", done.stdout, re.M)
    assert re.search(r'^  Workstation = demo:Workstation-6 "Workstation 1"$', done.stdout, re.M)
    for line in (r"▶ drive ->\*", r"✓ move_base_timed", r"✓ place ->\*", r"^task \d+ on .*: succeeded$"):
        watching.wait_for_line(line)
    as_json.wait_for_line(r'"ended": true')
    last = json.loads(as_json.output.splitlines()[-1])
    assert (last["state"], last["nodes"][0]["label"], last["nodes"][0]["state"]) == ("success", "drive", "success")
    for program in (watching, as_json):
        program.interrupt()
        assert program.wait() == 0


def test_failure_is_explained_at_once_and_later(run: Run) -> None:
    failed = run("run", "place", "Object=Product A", "Container=Tray B")
    assert failed.returncode == 1
    task = re.search(r"^task (\d+) has failed after", failed.stdout, re.M)
    assert task, failed
    why = run("why", task[1])
    assert why.returncode == 0
    assert why.stdout.startswith("place did not start: for Workstation, no workstation ")
    said = re.match(r"task \d+ by \w+ has failed", why.stdout.splitlines()[1])
    reasons = [line.strip() for line in why.stdout.splitlines()[2:]]
    assert said and reasons
    assert set(reasons) <= {line.strip() for line in failed.stdout.splitlines()}
    (explained,) = json.loads(run("why", task[1], "--json").stdout)
    assert (explained["type"], explained["label"], explained["code"]) == ("skiros:Place", "place", -1)


def test_invalid_arguments_are_rejected_before_the_start(run: Run) -> None:
    for arguments, told in (
        (["wm_set_properties"], "wm_set_properties needs Properties (dict"),
        (["wait", "Duration=soon"], "wait, parameter Duration: 'soon' is not a valid float"),
        (["wait", "duration=1"], "wait has no parameter 'duration'; did you mean 'Duration'?"),
        (
            ["pick", "Object=Produkt A"],
            "there is no skiros:Manipulatable with the id or label 'Produkt A'",
        ),
    ):
        refused = run("run", *arguments)
        assert (refused.returncode, refused.stdout, refused.stderr.count("\n")) == (1, "", 1), refused
        assert told in refused.stderr
    assert run("watch", "--once").stdout == "no task runs\n"


def test_a_task_is_paused_ticked_once_resumed_and_stopped(run: Run, start: Start) -> None:
    task = task_of(run("run", "wait", "Duration=60", "--detach"))
    watching = start("watch", task)
    watching.wait_for_line("▶ wait")
    assert run("pause", task).stdout == f"task {task} is paused\n"
    shown = run("watch", "--once").stdout.splitlines()
    assert shown[0] == f"task {task} on {ROBOT}: paused"
    assert shown[1].startswith("▶ wait  running")
    assert run("step").stdout == f"task {task} was ticked once\n"
    assert run("resume").stdout == f"task {task} is resumed\n"
    again = run("resume", task)
    assert (again.returncode, again.stdout) == (1, "")
    assert "runs already" in again.stderr
    assert json.loads(run("watch", task, "--once", "--json").stdout)[0]["message"] == ""
    assert run("stop", task).stdout == f"task {task} is being preempted\n"
    watching.wait_for_line(f"task {task} on {ROBOT}: preempted")
    assert watching.wait() == 1
    for name in ("stop", "pause", "resume", "step", "watch"):
        gone = run(name, task)
        assert (gone.returncode, gone.stdout, gone.stderr.count("\n")) == (1, "", 1), gone


def test_task_pauses_at_a_breakpoint_and_resumes(run: Run, start: Start) -> None:
    added = run("breakpoint", "add", "node", "Wait")
    number = re.fullmatch(r"breakpoint (\d+): node Wait start\n", added.stdout)
    assert number, added
    assert run("breakpoint").stdout.splitlines()[-1].split() == [number[1], "node", "Wait", "start"]
    task = task_of(run("run", "wait", "Duration=0.1", "wait", "Duration=60", "--detach"))
    paused = f"paused at breakpoint {number[1]}: before the start of skiros:Wait"
    wait_until(lambda: paused in run("watch", task, "--once").stdout, what="a task that is paused")
    assert run("breakpoint", "remove", number[1]).stdout == f"breakpoint {number[1]} is removed\n"
    assert run("breakpoint").stdout == "no breakpoints\n"
    watching = start("watch", task)
    watching.wait_for_line("task")
    assert run("resume", task).returncode == 0
    watching.wait_for_line("✓ wait")
    watching.wait_for_line("▶ wait")
    assert run("breakpoint", "remove", number[1]).returncode == 1


def test_ctrl_c_preempts_the_task(run: Run, start: Start) -> None:
    running = start("run", "wait", "Duration=60")
    task = running.wait_for_line(r"task (\d+) on")[1]
    running.wait_for_line("▶ wait")
    running.interrupt()
    running.wait_for_line(f"preempting task {task}")
    assert running.wait() == 130
    assert running.output.splitlines()[-1].startswith(f"task {task} was preempted after")
    assert run("watch", "--once").stdout == "no task runs\n"


def test_a_terminal_shows_a_live_tree(run: Run, ros_master: RosMaster) -> None:
    run("run", "drive", "TargetLocation=Workstation 2")
    run("run", "drive", "TargetLocation=Workstation 1")
    run("breakpoint", "add", "node", "CloseGripper")
    task = task_of(run("run", "pick", "Object=Product A", "--detach"))
    with Terminal(["rosrun", "skiros2_skill", "watch", task], ros_master) as terminal:
        terminal.wait_for("paused at breakpoint")
        terminal.wait_for("\x1b[32m├── ✓ move_arm_timed")
        assert "\x1b[36m▶ pick" in terminal.written
        run("stop", task)
        assert terminal.wait() == 1
    assert f"task {task} on /mobile_manipulator: preempted" in terminal.written
    assert re.search(r"\x1b\[\d+A\x1b\[J", terminal.written), "it is drawn anew in place"


def test_several_managers_require_a_name_and_a_killed_one_is_noticed(run: Run, ros: Ros, start: Start) -> None:
    params = {"libraries_list": ["skiros2_std_skills"], "primitive_list": ["wait"]}
    ros.run("skiros2_skill", "skill_manager_node", name="test_robot", params=params)
    ros.service("/test_robot/command", srvs.SkillCommand)
    several = run("list")
    assert (several.returncode, several.stderr) == (
        2,
        f"list: there are 2 skill managers, {ROBOT}, /test_robot: name one with --robot\n",
    )
    assert "wait" in run("list", "--robot", "test_robot").stdout
    unknown = run("list", "--robot", "test_robt")
    assert (unknown.returncode, unknown.stderr.count("\n")) == (3, 1)
    running = start("run", "wait", "Duration=60", "--robot", "/test_robot")
    running.wait_for_line("▶ wait")
    watching = start("watch", "--robot", "/test_robot")
    watching.wait_for_line("▶ wait")
    ros.kill_node("/test_robot")
    assert running.wait() == 3
    assert watching.wait() == 3
    assert "/test_robot is gone" in watching.output
    dead = run("list", "--robot", "test_robot")
    assert (dead.returncode, dead.stderr.count("\n")) == (3, 1)
    assert "does not answer" in dead.stderr
    assert run("list").returncode == 0, "the one that lives is found by itself"


@pytest.mark.parametrize("name", ["list", "watch", "stop", "why"])
def test_command_without_a_master_fails_with_one_line(run: Run, name: str) -> None:
    lonely = run(name, ROS_MASTER_URI="http://localhost:1")
    assert (lonely.returncode, lonely.stdout, lonely.stderr.count("\n")) == (3, "", 1)


def test_command_without_managers_fails_with_a_message(run: Run, tmp_path: Path) -> None:
    with RosMaster(tmp_path) as empty:
        alone = run("list", ROS_MASTER_URI=empty.uri)
    assert (alone.returncode, alone.stderr) == (3, f"list: there is no skill manager on the master {empty.uri}\n")


class Terminal:
    """A program on a terminal of its own, and what it writes there; a context manager."""

    def __init__(self, command: list[str], master: RosMaster) -> None:
        self.written = ""
        self._change = threading.Condition()
        self._closed = False
        self._end, theirs = pty.openpty()
        env = {**master.env, "COLUMNS": "120", "LINES": "40", "TERM": "xterm"}
        self._process = subprocess.Popen(command, env=env, stdin=theirs, stdout=theirs, stderr=theirs)
        os.close(theirs)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join(5.0)
        os.close(self._end)

    def wait_for(self, text: str, timeout: float = 30.0) -> None:
        with self._change:
            found = self._change.wait_for(lambda: text in self.written or self._closed, timeout)
            assert found and text in self.written, self.written[-2000:]

    def wait(self, timeout: float = 30.0) -> int:
        """Waits for the end of the program and returns its status."""
        status = self._process.wait(timeout)
        self._reader.join(5.0)
        return status

    def _read(self) -> None:
        decoded = b""
        while True:
            try:
                part = os.read(self._end, 65536)
            except OSError:  # the other end was closed
                part = b""
            with self._change:
                decoded += part
                self.written = decoded.decode("utf-8", "replace")
                self._closed = not part
                self._change.notify_all()
            if not part:
                return
