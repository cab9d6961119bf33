"""Recording a run, from before the master or later; restoring it; playing foreign bags."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from skiros2_bags.core.bag_file import BagError
from skiros2_bags.core.run import Run, check
from skiros2_bags.testing.recording import Recording, recorded_tasks
from skiros2_runs.core.states import NodeState
from support.programs import Program
from support.ros import Ros, RosMaster, wait_until

pytestmark = pytest.mark.timeout(120)

ROBOT = "/mobile_manipulator"
ROBOT_ID, STATION, WORKSTATION = "cora:Robot-1", "skiros:Location-5", "demo:Workstation-6"
GOAL = f"(skiros:at {ROBOT_ID} {WORKSTATION})"
PICK_PLACE = Path(__file__).parents[1] / "bags/pick_place.bag"
WAIT = 60.0  # s


class _System(Ros):
    """Programs on a master of their own, some of which are started before it."""

    def __init__(self, folder: Path) -> None:
        self.master = RosMaster(folder)
        self.programs = []

    def stop(self) -> None:
        for program in reversed(self.programs):
            program.stop()
        self.master.stop()

    def done(self, package: str, program: str, *arguments: str) -> str:
        """What a program printed that ended well."""
        return _ended(self.run(package, program, *arguments))

    def launch_robot(self, record: Path) -> Program:
        """Waits until it can be given goals, and its recorder hears of them."""
        program = self.launch("skiros2_demo_skills", "demo.launch", gui=False, record=str(record))
        wait_until(lambda: f"{ROBOT}/get_skills" in self.master.services(), WAIT, "the skill manager")
        wait_until(lambda: "/tm/achieve/status" in self.master.topics(), WAIT, "the task manager")
        for node, topic in (("/tm", "/tm/achieve/feedback"), (ROBOT, f"{ROBOT}/monitor")):
            wait_until(lambda n=node, t=topic: ("/recorder", t) in self.master.readers(n), WAIT, f"a record of {topic}")
        return program


@dataclass
class Recorded:
    """One run, recorded from before the master and in its middle, and what the recorders said."""

    whole: Run
    late: Run
    launched: Run
    output: str
    restored: str
    place: str


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Recorded]:
    folder = tmp_path_factory.mktemp("recorded")
    system = _System(folder)
    whole, late, launched = (folder / f"{name}.bag" for name in ("whole", "late", "launched with a blank"))
    try:
        options = ("-o", str(whole), "--robots", ROBOT, "--compression", "lz4")
        recorder = system.run("skiros2_bags", "record", *options, name="from_the_start")
        recorder.wait_for_line("waiting for the master")
        system.master.start()
        recorder.wait_for_line("recording to")
        launch = system.launch_robot(launched)
        system.done("skiros2_task", "achieve", GOAL)
        system.program("rosnode", "kill", "/from_the_start")
        output = _ended(recorder)

        second = system.run("skiros2_bags", "record", "-o", str(late), "--no-check", name="late")
        second.wait_for_line("requested the scene from /wm/snapshot")
        system.done("skiros2_world_model", "set", ROBOT_ID, "label", "Robbie")
        wait_until(lambda: _label(late.with_name("late.bag.active")) == "Robbie", WAIT, "the change in the file")
        second.signal(signal.SIGINT)
        _ended(second)

        goal = Run.open(whole).goals()[0]
        restored = system.done("skiros2_bags", "restore", str(whole), "--at", str(goal.time))
        place = system.done("skiros2_world_model", "get", ROBOT_ID, "skiros:at")
        launch.signal(signal.SIGINT)
        launch.wait(WAIT)
        yield Recorded(*map(Run.open, (whole, late, launched)), output, restored, place)
    finally:
        system.stop()


def _ended(program: Program) -> str:
    assert program.wait(WAIT) == 0, program.output
    return program.output


def _label(bag: Path) -> str:
    """The robot's label at the end of a bag that is still written; "" while there is no such."""
    try:
        node = Run.open(bag).world().record(ROBOT_ID)
    except BagError:
        return ""
    return node.label if node is not None else ""


def test_recorder_started_before_the_master_misses_nothing(recorded: Recorded) -> None:
    run = recorded.whole
    assert run.damage == ""
    assert [f.text for f in check(run) if not f.holds] == []
    assert "ok: the file is whole" in recorded.output and "MISSING" not in recorded.output
    first = run.changes()[0].change
    assert (first.author, first.action) == ("wm", "reset")
    assert {call.name for call in run.actions()} == {"/tm/achieve", f"{ROBOT}/execute"}
    assert {"/rosout", "/tf_static", "/skill_managers/description"} <= {*run.topics}
    *_, parameters = run.messages("/recorder/parameters")
    assert "move_base_timed" in parameters.content.data


def test_launch_file_records_evidence_and_the_program_only_on_request(recorded: Recorded) -> None:
    topic = f"{ROBOT}/evidence"
    messages = recorded.launched.messages(topic)
    entries = [entry for message in messages for entry in json.loads(message.content.data)["entries"]]
    assert ["0", "post", "RobotAtTarget", True] in entries
    assert ["0.0", "hook", "onStart", None] in entries
    (task,) = recorded_tasks(Recording(recorded.launched.path))
    started, first, *_ = [time for _, readings in sorted(task.readings.items()) for path, time in readings]
    assert first >= started > 0.0
    assert topic not in recorded.whole.topics


def test_bag_contains_the_run(recorded: Recorded) -> None:
    run = recorded.whole
    (goal,) = run.goals()
    assert (goal.goals, goal.state) == (GOAL, "succeeded")
    (task,) = run.tasks()
    assert (task.robot, task.latest.message(0), task.is_complete) == (ROBOT, "End", True)
    assert [(s.label, s.state) for s in run.skills() if s.depth == 1] == [("drive", NodeState.SUCCESS)]
    assert run.world(goal.time).related(ROBOT_ID, "skiros:at", STATION)
    assert run.world().related(ROBOT_ID, "skiros:at", WORKSTATION)


def test_late_recorder_requests_the_scene(recorded: Recorded) -> None:
    run = recorded.late
    first, *others = run.changes()
    assert (first.change.author, first.change.action) == ("recorder", "reset")
    assert [timed.change.action for timed in others] == ["update"]
    assert run.world(first.time).related(ROBOT_ID, "skiros:at", WORKSTATION)
    assert run.world().record(ROBOT_ID).label == "Robbie"


def test_launch_file_records_its_run(recorded: Recorded) -> None:
    run = recorded.launched
    assert run.damage == ""
    assert [timed.gap for timed in run.changes() if timed.gap] == []
    assert [goal.state for goal in run.goals()] == ["succeeded"]
    last, last_of_whole = (changes[-1].change.number for changes in (run.changes(), recorded.whole.changes()))
    assert last > last_of_whole  # it saw the end


def test_restore_sets_a_running_world_model_to_a_past_state(recorded: Recorded) -> None:
    assert "0 added, 1 changed, 0 removed" in recorded.restored
    assert recorded.place.strip() == STATION


@pytest.mark.long
def test_foreign_bag_can_be_played(ros: Ros, tmp_path: Path) -> None:
    recorder = ros.run("skiros2_bags", "record", "-o", str(tmp_path / "again.bag"), "--robots", ROBOT)
    recorder.wait_for_line("recording to")
    options = ("--quiet", "--rate", "10", "--wait-for-subscribers")
    topics = ("/wm/monitor", f"{ROBOT}/monitor")
    _ended(ros.program("rosbag", "play", *options, str(PICK_PLACE), "--topics", *topics))
    recorder.signal(signal.SIGTERM)
    recorder.wait(WAIT)
    once, again = Run.open(PICK_PLACE), Run.open(tmp_path / "again.bag")
    assert [t.change.snapshot_id for t in again.changes()] == [t.change.snapshot_id for t in once.changes()]
    assert set(again.world().relations()) == set(once.world().relations())
    assert [(s.path, s.state) for s in again.skills()] == [(s.path, s.state) for s in once.skills()]
