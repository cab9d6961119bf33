"""Re-runs of recorded trees."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from copy import copy
from dataclasses import replace
from pathlib import Path

import pytest
from rosbags.rosbag1 import Reader, Writer

from skiros2_bags.command_line.replay import main
from skiros2_bags.core.bag_file import BagError
from skiros2_bags.testing.fake_action_clients import RecordedActions
from skiros2_bags.testing.field_tolerances import FieldTolerances, field_tolerances
from skiros2_bags.testing.recording import Recording, recorded_tasks
from skiros2_bags.testing.rerun import Settings, rerun
from skiros2_bags.testing.stored import Stored, read_stored
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_demo_skills import timed_motions, transport_skills
from skiros2_runs.core.states import TaskState
from skiros2_runs.core.tolerance import Tolerance
from skiros2_skill.core.processors import ParallelFs
from support.ros import ROOT

BAGS = ROOT / "tests" / "bags"
WORKSPACE = ROOT / "skiros2_std_lib/demos/timed_skills/owl"
SETTINGS = Settings(WORKSPACE)
UNSEEN = ["1 plan: with --plans they are made again"]
WITHIN = "message 0.001 (relative 0.001), value 0.001 (relative 0.001), pose exact; all else exact"
SIMULATED = Settings(
    ROOT / "skiros2_std_lib/demos/pick_and_place/owl", tolerances=FieldTolerances(Tolerance(0.02, 0.02))
)


@pytest.fixture(scope="module")
def pick_place() -> Recording:
    return Recording(BAGS / "timed_pick_place.bag")


@pytest.fixture(scope="module")
def gripper() -> Recording:
    """A tree with parallel branches and an action, a failing action and a cancelled one, in parallel."""
    sys.path.append(str(ROOT / "tests" / "libraries"))
    return Recording(BAGS / "gripper.bag")


@pytest.mark.parametrize("bag", ["timed_pick_place.bag", "timed_drive.bag", "timed_unmet.bag"])
def test_rerun_of_unchanged_code_has_no_divergence(bag: str) -> None:
    assert rerun(Recording(BAGS / bag), SETTINGS).divergence is None


def test_rerun_delivers_recorded_action_results(gripper: Recording) -> None:
    assert rerun(gripper, Settings()).divergence is None


def test_rerun_of_a_simulated_run_has_no_divergence() -> None:
    recording = Recording(BAGS / "simulated_disturbed.bag")
    assert sum(task.run.state is TaskState.FAILED for task in recorded_tasks(recording)) > 0
    assert rerun(recording, SIMULATED).divergence is None


def test_goal_may_be_recorded_after_the_first_progress(gripper: Recording) -> None:
    recording = copy(gripper)
    late = {id(task.goal): task.progress[0].order + 0.5 for task in recorded_tasks(recording)}
    events = [replace(e, order=late[id(e)]) if id(e) in late else e for e in recording.events]
    recording.events = sorted(events, key=lambda event: event.order)
    assert rerun(recording, Settings()).divergence is None


def test_goal_may_be_recorded_after_the_first_change_of_its_task() -> None:
    recording = Recording(BAGS / "simulated_disturbed.bag")
    task = recorded_tasks(recording)[0]
    change = next(e for e in recording.changes if e.change.author == task.manager and e.order > task.begin)
    assert task.goal is not None and change.order < task.progress[0].order
    late = replace(task.goal, order=change.order + 0.5)  # type: ignore[arg-type]
    recording.events = [late if e is task.goal else e for e in recording.events]
    recording.events.sort(key=lambda event: event.order)
    found = rerun(recording, SIMULATED)
    assert found.is_as_recorded, found


def test_change_of_others_after_that_of_a_tick_was_not_seen_by_it() -> None:
    recording = Recording(BAGS / "simulated_disturbed.bag")
    changed = [(e, e.change.elements[0]) for e in recording.changes if e.change.elements]
    placed = next(
        event
        for event, element in changed
        if event.change.author in recording.managers
        and element.id == "skiros:Product-14"
        and element.property_view["skiros:BaseFrameId"].value == "demo:Tray-12"
    )
    seen = [(e, x) for e, x in changed if e.order < placed.order and x.id == "rparts:GripperEffector-4"]
    event, gripper = seen[-1]
    gripper = gripper.copy()
    gripper.setProperty("skiros:PositionZ", 2.0)  # the product would be placed there
    moved = replace(event, order=placed.order + 0.5, change=replace(event.change, elements=(gripper,)))
    late = [replace(e, time=e.time + 0.1) if e.order > placed.order else e for e in recording.events]
    recording.events = sorted([*late, moved], key=lambda event: event.order)
    assert rerun(recording, SIMULATED).divergence is None


@pytest.mark.parametrize("lost", [1, 2])
def test_feedback_may_be_lost_before_the_client_knows_its_goal(gripper: Recording, lost: int) -> None:
    """actionlib drops answers that arrive before `send_goal` has returned; the recorder has them."""
    recording = copy(gripper)
    (goal, *_) = recording.goals("/gripper")
    answers = [e for e in recording.action_messages if e.goal_id == goal.goal_id and e.part == "feedback"]
    early = []
    for number in range(1, lost + 1):
        content = copy(answers[0].content)
        content.position = 0.1 - 0.001 * number
        early.append(replace(answers[0], order=goal.order + 0.1 * number, time=goal.time, content=content))
    recording.events = sorted([*recording.events, *early], key=lambda event: event.order)
    found = rerun(recording, Settings())
    assert found.is_as_recorded, found
    late = [replace(e, time=answers[0].time, order=answers[0].order - 0.5) for e in early]
    recording.events = sorted([*gripper.events, *late], key=lambda event: event.order)
    assert rerun(recording, Settings()).divergence is not None, "feedback is lost only when the goal is sent"


def test_goal_field_may_have_a_tolerance(gripper: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    from replay_skills import skills

    genuine = skills.grasp.buildGoal

    def wider(self: skills.grasp) -> object:
        goal = genuine(self)
        goal.command.position += 0.001
        return goal

    monkeypatch.setattr(skills.grasp, "buildGoal", wider)
    wide = FieldTolerances(fields=field_tolerances(["/gripper:command.position=0.002"]))
    assert rerun(gripper, Settings(tolerances=wide)).is_as_recorded
    other = FieldTolerances(fields=field_tolerances(["/gripper:command.max_effort=0.002"]))
    assert not rerun(gripper, Settings(tolerances=other)).is_as_recorded


def test_tolerance_of_one_field_is_stored_and_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / "drive.bag"
    bag.write_bytes((BAGS / "timed_drive.bag").read_bytes())
    options = [str(bag), "--workspace", str(WORKSPACE)]
    assert main([*options, "--store", "--tolerance", "pose=0.01", "--tolerance", "value:Force=0.5,0.02"]) == 0
    stored = read_stored(bag)
    assert stored is not None
    fields = {"pose": Tolerance(0.0, 0.01), "value:Force": Tolerance(0.02, 0.5)}
    assert stored.tolerances == FieldTolerances(fields=fields)
    capsys.readouterr()
    assert main(options) == 0
    assert "pose 0.01 (relative 0), value:Force 0.5 (relative 0.02); all else exact" in capsys.readouterr().out
    assert main([*options, "--tolerance", "pose"]) == 2
    assert "expected a tolerance such as pose=0.01" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--relative=-0.1", "--absolute=nan", "--tolerance=pose=inf"])
def test_tolerance_that_is_no_finite_number_from_zero_is_refused(
    option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(BAGS / "timed_unmet.bag"), "--workspace", str(WORKSPACE), option]) == 2
    assert "expected" in capsys.readouterr().err


@pytest.mark.parametrize("more", [0.01, 0.0001])
def test_changed_driver_goal_names_the_field(gripper: Recording, monkeypatch: pytest.MonkeyPatch, more: float) -> None:
    from replay_skills import skills

    genuine = skills.grasp.buildGoal

    def wider(self: skills.grasp) -> object:
        goal = genuine(self)
        goal.command.position += more
        return goal

    monkeypatch.setattr(skills.grasp, "buildGoal", wider)
    found = rerun(gripper, Settings()).divergence
    assert found is not None
    assert found.what == "a goal to /gripper, field command.position"
    assert (found.expected, float(found.got)) == ("0.05", pytest.approx(0.05 + more))


def test_server_whose_status_is_recorded_is_not_silent_before_the_goal_is_due(gripper: Recording) -> None:
    tasks = recorded_tasks(gripper)
    without_goals = copy(gripper)
    without_goals.events = [e for e in gripper.events if getattr(e, "part", "") != "goal"]
    last = tasks[-1].progress[-1]
    actions = RecordedActions(without_goals, FieldTolerances())
    actions.deliver_answers(last, last, lambda skill: (None, None), False)
    gripper_client, other = actions.client("/gripper", None), actions.client("/other", None)
    assert not gripper_client.is_connected()
    assert gripper_client.last_status_msg not in (None, gripper_client.last_status_msg)  # another one each time
    assert other.last_status_msg is None


def test_goal_that_the_recorder_has_missed_is_no_divergence(gripper: Recording, tmp_path: Path) -> None:
    found = rerun(_without(tmp_path, "/gripper/goal"), Settings())
    assert found.is_as_recorded, found
    missed = "a goal to /gripper: the bag has its answers, but the recorder has missed the goal"
    assert found.not_compared == (missed,)


def test_divergence_names_what_the_bag_lacks(
    gripper: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from replay_skills import skills

    monkeypatch.setattr(skills, "ParallelFf", ParallelFs)
    found = rerun(_without(tmp_path, "/gripper/goal"), Settings())
    assert found.divergence is not None
    assert "the bag is incomplete: " in str(found) and "/gripper" in found.missing[0]


def _without(folder: Path, *topics: str) -> Recording:
    with Reader(BAGS / "gripper.bag") as reader, Writer(folder / "lacking.bag") as writer:
        known = {}
        for connection, time, data in reader.messages():
            if connection.topic not in topics:
                if connection.id not in known:
                    text = connection.msgdef.data
                    known[connection.id] = writer.add_connection(
                        connection.topic, connection.msgtype, msgdef=text, md5sum=connection.digest,
                        callerid=connection.ext.callerid,
                    )  # fmt: skip
                writer.write(known[connection.id], time, data)
    return Recording(folder / "lacking.bag")


def test_changed_processor_is_found(gripper: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    from replay_skills import skills

    monkeypatch.setattr(skills, "ParallelFf", ParallelFs)
    found = rerun(gripper, Settings()).divergence
    assert found is not None
    assert found.what == "root / grasp_and_wait"
    assert (found.expected, found.got) == ("processor |ff|, running, code 0", "processor |fs|, running, code 0")


def test_missing_condition_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport_skills.Manipulation, "add_common", _only_parameters)
    found = rerun(Recording(BAGS / "timed_unmet.bag"), SETTINGS).divergence
    assert found is not None
    assert "RobotAtWorkstation" in found.expected


def test_changed_tree_names_the_first_different_node(pick_place: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = transport_skills.pick.expand

    def without_grasp(self: transport_skills.pick, skill: object) -> None:
        genuine(self, skill)
        del skill.children[1]  # type: ignore[attr-defined]

    monkeypatch.setattr(transport_skills.pick, "expand", without_grasp)
    found = rerun(pick_place, SETTINGS).divergence
    assert found is not None
    assert "tick 1 of task 1 of /mobile_manipulator (pick)" in found.where
    assert found.what == "root / pick / CloseGripper"
    assert (found.expected, found.got) == ("CloseGripper: idle, code 0", "wm_move_object: idle, code 0")


def test_changed_condition_names_the_failing_skill(pick_place: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = transport_skills.Pick.createDescription

    def demanding(self: transport_skills.Pick) -> None:
        genuine(self)
        full = self.getPropCond("GripperFullBefore", "skiros:ContainerState", "Gripper", "=", "Full", True)
        self.addPreCondition(full)

    monkeypatch.setattr(transport_skills.Pick, "createDescription", demanding)
    found = rerun(pick_place, SETTINGS).divergence
    assert found is not None
    assert found.what == "root / pick"
    assert "GripperFullBefore" in found.got


def test_changed_effect_names_the_property(pick_place: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport_skills, "at_height", lambda height: {"skiros:PositionZ": height + 0.5})
    found = rerun(pick_place, SETTINGS).divergence
    assert found is not None
    assert "skiros:PositionZ is 0.5, expected 0" in found.got


def test_shorter_motion_names_its_tick(pick_place: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timed_motions.close_gripper_timed, "execute", lambda self: self.success("done"))
    found = rerun(pick_place, SETTINGS).divergence
    assert found is not None
    assert found.what.endswith("close_gripper_timed")
    assert found.expected.startswith("running, code 1") and found.got.startswith("succeeded")
    assert any("move_arm_timed" in line for line in found.context)


def test_program_prints_the_result(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(BAGS / "timed_drive.bag"), "--workspace", str(WORKSPACE)]) == 0
    lines = ["as recorded", f"tolerances: {WITHIN}", *(f"not compared: {each}" for each in UNSEEN)]
    assert capsys.readouterr().out.splitlines() == lines
    assert main([str(BAGS / "timed_drive.bag"), "--workspace", str(WORKSPACE), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "divergence": None,
        "orders": 1,
        "declared": [],
        "not_compared": UNSEEN,
        "plans": {"worse": [], "different": [], "not_compared": []},
        "missing": [],
        "stored_orders": None,
        "tolerances": WITHIN,
    }
    assert main([str(BAGS / "none.bag")]) == 2
    assert "there is no such file" in capsys.readouterr().err


@pytest.mark.replay(BAGS / "timed_drive.bag", workspace=WORKSPACE)
def test_fixture_returns_the_divergence(replayed: str | None) -> None:
    assert replayed is None


def test_bag_without_requests_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="parameters"):
        rerun(Recording(BAGS / "pick_place.bag"), SETTINGS)
    (tmp_path / "no.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(BagError, match=r"no\.bag"):
        Recording(tmp_path / "no.bag")


def _only_parameters(self: transport_skills.Manipulation) -> None:
    for key, kind in (
        ("Workstation", "demo:Workstation"),
        ("Arm", "rparts:ArmDevice"),
        ("Gripper", "rparts:GripperEffector"),
    ):
        self.addParam(key, Element(kind), ParamTypes.Inferred)


def test_tolerance_and_orders_are_stored_with_the_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / "drive.bag"
    bag.write_bytes((BAGS / "timed_drive.bag").read_bytes())
    options = [str(bag), "--workspace", str(WORKSPACE)]
    assert main([*options, "--store", "--relative", "0.05", "--absolute", "0.01"]) == 0
    assert read_stored(bag) == Stored(1, FieldTolerances(Tolerance(0.05, 0.01)))
    assert main(options) == 0
    Stored(0, FieldTolerances(Tolerance(0.05, 0.01))).write(bag)
    capsys.readouterr()
    assert main(options) == 0
    assert "warning: 0 were enough when that was stored" in capsys.readouterr().out
    (tmp_path / "drive.rerun.json").write_text("{}")
    assert main(options) == 2
    assert "expected orders, relative and absolute" in capsys.readouterr().err


@pytest.mark.long
def test_bag_on_the_command_line_of_pytest_has_a_tolerance(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pytest", "-p", "skiros2_bags.testing.plugin", "-p", "no:cacheprovider"]
    command += ["-c", "/dev/null", "--replay", str(BAGS / "simulated_disturbed.bag"), "--replay-relative", "0.02"]
    command += ["--replay-workspace", str(SIMULATED.workspace), "--replay-absolute", "0.02"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
