"""Recording runs: from before there is a master, in the middle of a run, and what is left when it is killed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_bags.core.checking import check
from skiros2_bags.core.run import Run
from support.programs import Program
from support.ros import Ros, RosMaster, wait_until

pytestmark = pytest.mark.timeout(120)

ROBOT = "/mobile_manipulator"
GOAL = "(skiros:at cora:Robot-1 demo:Workstation-6)"
WAIT = 60.0  # s


@pytest.fixture
def system(tmp_path: Path) -> Iterator[Ros]:
    """Programs on a master of their own, which is not started yet."""
    programs = _Unstarted(RosMaster(tmp_path))
    yield programs
    programs.stop_all()


class _Unstarted(Ros):
    """Programs of which some are started before the master."""

    def __init__(self, master: RosMaster) -> None:
        self.master = master
        self.programs = []

    def stop_all(self) -> None:
        for program in reversed(self.programs):
            program.stop()
        self.master.stop()

    def record(self, bag: Path, *options: str) -> Program:
        return self.run("skiros2_bags", "record", "-o", str(bag), *options)

    def launch_robot(self) -> None:
        """Waits until it can be given goals."""
        self.launch("skiros2_demo_skills", "demo.launch", gui=False)
        wait_until(lambda: f"{ROBOT}/get_skills" in self.master.services(), WAIT, "the skill manager")
        wait_until(lambda: "/tm/achieve/status" in self.master.topics(), WAIT, "the task manager")

    def achieve(self) -> None:
        achieve = self.run("skiros2_task", "achieve", GOAL)
        assert achieve.wait(WAIT) == 0, achieve.output


def test_a_run_that_is_recorded_from_before_the_master_is_whole(system: _Unstarted, tmp_path: Path) -> None:
    bag = tmp_path / "run.bag"
    recorder = system.record(bag, "--robots", ROBOT, "--compression", "lz4")
    recorder.wait_for_line("waits for the master")
    system.master.start()
    recorder.wait_for_line("recording to")
    system.launch_robot()
    system.achieve()
    system.program("rosnode", "kill", "/recorder")
    assert recorder.wait(WAIT) == 0, recorder.output
    assert "ok: " in recorder.output

    run = Run.open(bag)
    assert run.damage == ""
    assert [f.text for f in check(run) if not f.holds] == []
    first = run.changes()[0].change
    assert (first.author, first.action) == ("wm", "reset")
    (goal,) = run.goals()
    assert (goal.goals, goal.state) == (GOAL, "succeeded")
    (task,) = run.tasks()
    assert (task.robot, task.message, task.is_whole) == (ROBOT, "Success", True)
    assert {s.label: s.state_name for s in run.skills() if s.depth == 1} == {"drive": "Success"}
    assert {call.name for call in run.actions()} == {"/tm/achieve", f"{ROBOT}/execute"}
    assert run.world(goal.time).related("cora:Robot-1", "skiros:at", "skiros:Location-5")
    assert run.world().related("cora:Robot-1", "skiros:at", "demo:Workstation-6")
    (parameters,) = list(run.messages("/recorder/parameters"))[-1:]
    assert "mobile_manipulator" in parameters.content.data


def test_a_recorder_that_comes_late_asks_for_the_scene(system: _Unstarted, tmp_path: Path) -> None:
    bag = tmp_path / "run.bag"
    system.master.start()
    system.launch_robot()
    system.achieve()
    recorder = system.record(bag)
    recorder.wait_for_line("the scene is taken from /wm/snapshot")
    mark = system.run("skiros2_world_model", "set", "cora:Robot-1", "label", "Robbie")
    assert mark.wait(WAIT) == 0, mark.output
    recorder.signal(signal.SIGINT)
    assert recorder.wait(WAIT) == 0, recorder.output
    run = Run.open(bag)
    first = run.changes()[0].change
    assert (first.author, first.action) == ("recorder", "reset")
    assert run.world().node("cora:Robot-1").label == "Robbie"
    assert run.world(run.changes()[0].time).related("cora:Robot-1", "skiros:at", "demo:Workstation-6")
