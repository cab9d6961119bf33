"""`rosrun skiros2_task achieve` on the system of the demo."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator

import pytest

from skiros2_msgs import srv as srvs
from support.programs import Program
from support.ros import Ros, RosMaster, run_command, wait_until

pytestmark = pytest.mark.timeout(120)

ROBOT = "/mobile_manipulator"
TO_TRAY_B = "(skiros:contain demo:Tray-12 skiros:Product-14)"
TO_TRAY_A = "(skiros:contain demo:Tray-10 skiros:Product-14)"
STEPS = ["drive", "pick", "drive", "place"]

Run = Callable[..., "subprocess.CompletedProcess[str]"]
Start = Callable[..., Program]


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster) -> Iterator[Ros]:
    """The system of the demo, which the tests share; each leaves the robot free."""
    ros = Ros(ros_master)
    ros.launch("skiros2_demo_skills", "demo.launch", gui=False)
    ros.service(f"{ROBOT}/get_skills", srvs.ResourceGetDescriptions)()
    wait_until(lambda: "/tm/achieve/status" in ros_master.topics(), 30.0, "the task manager")
    yield ros
    ros.stop()


@pytest.fixture
def run(ros_master: RosMaster, cell: Ros) -> Run:
    """Runs the command to its end."""

    def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        command = ["rosrun", "skiros2_task", "achieve", *arguments]
        env = {**ros_master.env, **environment}
        return run_command(command, env, timeout=90.0)

    return run


@pytest.fixture
def start(ros: Ros, cell: Ros) -> Start:
    """Starts the command."""
    return lambda *arguments: ros.run("skiros2_task", "achieve", *arguments)


def test_achieve_prints_the_steps_and_reaches_the_goal(run: Run) -> None:
    done = run(TO_TRAY_B)
    assert (done.returncode, done.stderr) == (0, ""), done
    told = [line.partition(" s  ")[2].split() for line in done.stdout.splitlines() if " s  " in line]
    assert ["a", "plan", "of", "4", "steps", "of", "1", "robot,"] in [words[:8] for words in told]
    for symbol in "▶✓":
        assert [words[2] for words in told if words[0] == symbol] == STEPS
    last = done.stdout.splitlines()[-1]
    assert last.startswith("the goal is reached after ")
    assert last.endswith(" s: 4 steps done")
    again = run(TO_TRAY_B)
    assert (again.returncode, again.stderr) == (0, "")
    assert again.stdout.splitlines()[-1] == "the goal holds already"
    back = run(TO_TRAY_A, "--json")
    assert back.returncode == 0
    result = json.loads(back.stdout)
    assert result["state"] == "succeeded"
    assert [(step["label"], step["state"]) for step in result["done"]][-1] == ("place", "succeeded")


def test_achieve_prints_why_a_goal_is_unreachable(run: Run) -> None:
    refused = run("(skiros:contain demo:Tray-12 demo:Tray-10)")
    assert (refused.returncode, refused.stderr) == (1, "")
    assert "No plan: place needs a manipulatable for Object, but Tray A is a tray." in refused.stdout
    unknown = run("(skiros:contain demo:Tray-12 skiros:Product-99)")
    assert unknown.returncode == 1
    assert "unknown element 'skiros:Product-99'" in unknown.stdout


def test_interrupting_achieve_cancels_the_goal(start: Start, run: Run) -> None:
    achieving = start("(skiros:contain demo:Tray-12 skiros:Product-15)")
    achieving.wait_for_line("▶ 1 ")
    achieving.interrupt()
    assert achieving.wait() == 130
    assert "the goal was cancelled after" in achieving.output
    # and the next one works
    assert run("(skiros:at cora:Robot-1 skiros:Location-5)").returncode == 0


def test_achieve_without_a_task_manager_fails_with_a_message(run: Run) -> None:
    refused = run("(a b)", ROS_NAMESPACE="nowhere")
    assert (refused.returncode, refused.stdout) == (3, "")
    assert refused.stderr.startswith("achieve: there is no task manager /nowhere/tm on the master ")
