"""Recorded trees, ticked again in this process."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.normal import Tolerance
from skiros2_bags.testing.kinds import Settings
from skiros2_bags.testing.recording import Recording
from skiros2_bags.testing.rerun import rerun
from skiros2_bags.testing.task_runs import task_runs
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_demo_skills import timed_motions, transport_skills
from skiros2_skill.core.processors import ParallelFs
from support.ros import ROOT

BAGS = ROOT / "tests" / "bags"
WORKSPACE = ROOT / "skiros2_std_lib" / "skiros2_demo_skills" / "owl"
SETTINGS = Settings(WORKSPACE)
SIMULATED = Settings(ROOT / "skiros2_std_lib" / "skiros2_sim_skills" / "owl", tolerance=Tolerance(0.02, 0.02))


@pytest.fixture(scope="module")
def pick_place() -> Recording:
    return Recording(BAGS / "timed_pick_place.bag")


@pytest.fixture(scope="module")
def gripper() -> Recording:
    """A tree with parallel branches and an action, one that fails, and one that is cancelled, side by side."""
    sys.path.append(str(ROOT / "tests" / "libraries"))
    return Recording(BAGS / "gripper.bag")


@pytest.mark.parametrize("bag", ["timed_pick_place.bag", "timed_drive.bag", "timed_unmet.bag"])
def test_unchanged_code_goes_as_recorded(bag: str) -> None:
    assert rerun(Recording(BAGS / bag), SETTINGS) is None


def test_actions_answer_as_recorded(gripper: Recording) -> None:
    assert rerun(gripper, Settings()) is None


def test_a_run_in_physics_with_its_disturbances_goes_as_recorded() -> None:
    recording = Recording(BAGS / "simulated_disturbed.bag")
    assert sum(run.told[-1].nodes[0].state == "F" for run in task_runs(recording)) > 0
    assert rerun(recording, SIMULATED) is None


def test_another_goal_for_a_driver_is_told_with_the_field(gripper: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    from replay_skills import skills

    genuine = skills.grasp.buildGoal

    def wider(self: skills.grasp) -> object:
        goal = genuine(self)
        goal.command.position += 0.01
        return goal

    monkeypatch.setattr(skills.grasp, "buildGoal", wider)
    found = rerun(gripper, Settings())
    assert found is not None
    assert found.what == "a goal to /gripper, field command.position"
    assert (found.expected, found.got[:5]) == ("0.05", "0.060")


def test_a_branch_that_ends_the_others_is_told(gripper: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    from replay_skills import skills

    monkeypatch.setattr(skills, "ParallelFf", ParallelFs)
    found = rerun(gripper, Settings())
    assert found is not None
    assert found.what == "root / grasp_and_wait"


def test_a_missing_condition_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport_skills.Manipulation, "add_common", _only_parameters)
    found = rerun(Recording(BAGS / "timed_unmet.bag"), SETTINGS)
    assert found is not None
    assert "RobotAtWorkstation" in found.expected


def test_a_changed_tree_is_told_with_the_first_node_that_is_otherwise(
    pick_place: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    genuine = transport_skills.pick.expand

    def without_grasp(self: transport_skills.pick, skill: object) -> None:
        genuine(self, skill)
        del skill.children[1]  # type: ignore[attr-defined]

    monkeypatch.setattr(transport_skills.pick, "expand", without_grasp)
    found = rerun(pick_place, SETTINGS)
    assert found is not None
    assert "tick 1 of task 1 of /mobile_manipulator (pick)" in found.where
    assert found.what == "root / pick / CloseGripper"
    assert (found.expected, found.got) == ("CloseGripper: idle, code 0", "wm_move_object: idle, code 0")


def test_a_changed_condition_is_told_with_the_skill_that_it_stops(
    pick_place: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    genuine = transport_skills.Pick.createDescription

    def demanding(self: transport_skills.Pick) -> None:
        genuine(self)
        full = self.getPropCond("GripperFullBefore", "skiros:ContainerState", "Gripper", "=", "Full", True)
        self.addPreCondition(full)

    monkeypatch.setattr(transport_skills.Pick, "createDescription", demanding)
    found = rerun(pick_place, SETTINGS)
    assert found is not None
    assert found.what == "root / pick"
    assert "GripperFullBefore" in found.got


def test_a_skill_that_leaves_something_else_in_the_world_is_told_with_the_change(
    pick_place: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transport_skills, "at_height", lambda height: {"skiros:PositionZ": height + 0.5})
    found = rerun(pick_place, SETTINGS)
    assert found is not None
    assert "skiros:PositionZ is 0.5, expected 0" in found.got


def test_a_motion_that_ends_too_early_is_told_with_its_tick(
    pick_place: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(timed_motions.close_gripper_timed, "execute", lambda self: self.success("done"))
    found = rerun(pick_place, SETTINGS)
    assert found is not None
    assert found.what.endswith("close_gripper_timed")
    assert found.expected.startswith("running, code 1") and found.got.startswith("success")
    assert any("move_arm_timed" in line for line in found.context)


def test_a_bag_without_what_is_needed_is_refused(tmp_path: Path) -> None:
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
