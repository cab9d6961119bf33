"""The commands of `rosrun skiros2_world_model` on a node."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from skiros2_msgs import srv as srvs
from support.ros import Ros, RosMaster, run_command, wait_until

pytestmark = pytest.mark.timeout(90)

SCENE = """@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
:Scene-0 a :Scene ; :contain :LargeBox-80 .
:LargeBox-80 a :LargeBox ; rdfs:label "tray" .
"""

Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def workspace(ros_master: RosMaster, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The workspace of a world model /cell/wm, which the tests share."""
    folder = tmp_path_factory.mktemp("workspace")
    (folder / "lab.ttl").write_text(SCENE)
    ros = Ros(ros_master)
    params = {"workspace_dir": str(folder), "init_scene": "lab.ttl", "journal": str(folder / "wm.journal")}
    ros.run("skiros2_world_model", "world_model_server_node", name="wm", namespace="cell", params=params)
    ros.service("/cell/wm/history", srvs.WmHistory)
    yield folder
    ros.stop()


@pytest.fixture
def run(ros_master: RosMaster, workspace: Path) -> Run:
    """Runs a command in the namespace of the world model."""

    def run(name: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        env = {**ros_master.env, "ROS_NAMESPACE": "cell", **environment}
        command = ["rosrun", "skiros2_world_model", name, *arguments]
        return run_command(command, env, workspace)

    return run


def test_the_scene_is_shown_changed_saved_and_compared(run: Run, workspace: Path) -> None:
    assert run("view").stdout.splitlines()[-1].split() == ["└──", "skiros:LargeBox-80", "tray"]
    assert run("set", "skiros:LargeBox-80", "SizeX", "0.5", "--author", "mary").stdout == (
        "~ skiros:LargeBox-80 skiros:SizeX: (none) -> 0.5\n"
    )
    assert run("get", "skiros:LargeBox-80", "SizeX", "--json").stdout == "[\n  0.5\n]\n"
    told = json.loads(run("history", "skiros:LargeBox-80", "--json").stdout)
    assert [entry["author"] for entry in told] == ["wm", "mary"]
    assert run("query", "SELECT ?x { ?x skiros:SizeX 0.5e0 }").stderr == ""
    assert run("save", "now.ttl").returncode == 0
    compared = run("diff", "lab.ttl", "now.ttl", ROS_MASTER_URI="http://localhost:1")
    assert (compared.returncode, compared.stdout) == (1, "~ skiros:LargeBox-80 skiros:SizeX: (none) -> 0.5\n")
    assert run("diff", "now.ttl").returncode == run("diff", f"@#{told[-1]['number']}").returncode == 0
    assert run("load", "lab.ttl", "--author", "paul").returncode == 0
    last = json.loads(run("history", "--limit", "1", "--json").stdout)[0]
    assert (last["author"], last["action"]) == ("/paul", "load lab.ttl")
    assert run("diff", "lab.ttl").returncode == 0


def test_refusal_is_printed_in_one_line(run: Run) -> None:
    far = run("set", "skiros:LargeBox-80", "PositionX", "far")
    for refused in (run("get", "skiros:Part-7"), far, run("query", "?")):
        assert (refused.returncode, refused.stdout, refused.stderr.count("\n")) == (1, "", 1), refused


def test_world_model_with_another_name_is_reached(run: Run) -> None:
    found = run("get", "skiros:LargeBox-80", "label", "--wm", "/cell/wm", ROS_NAMESPACE="/elsewhere")
    assert found.stdout == "tray\n"
    missing = run("view", "--wm", "robots", ROS_NAMESPACE="/elsewhere")
    assert missing.returncode == 3
    assert "there is no world model /elsewhere/robots on the master" in missing.stderr


def test_command_without_master_or_server_fails_with_a_message(
    run: Run, ros: Ros, ros_master: RosMaster, tmp_path: Path
) -> None:
    lonely = run("view", ROS_MASTER_URI="http://localhost:1")
    assert (lonely.returncode, lonely.stdout, lonely.stderr.count("\n")) == (3, "", 1)
    params = {"workspace_dir": str(tmp_path), "journal": False}
    node = ros.run("skiros2_world_model", "world_model_server_node", name="gone", params=params)
    ros.service("/gone/get", srvs.WmGet)
    pid = ros_master.node_pid("/gone")
    subprocess.run(["kill", "-KILL", str(pid)], check=True)
    node.wait()
    wait_until(lambda: not Path(f"/proc/{pid}").exists(), what="the killed node to be gone")
    dead = run("view", "--wm", "/gone")
    assert dead.returncode == 3 and "does not answer" in dead.stderr and dead.stderr.count("\n") == 1


def test_reader_may_close_the_pipe_early(ros_master: RosMaster, run: Run) -> None:
    env = {**ros_master.env, "ROS_NAMESPACE": "cell"}
    command = "rosrun skiros2_world_model view --all --json | head -1"
    shown = subprocess.run(["bash", "-o", "pipefail", "-c", command], env=env, capture_output=True, text=True)
    assert (shown.returncode, shown.stdout, shown.stderr) == (0, "[\n", "")
