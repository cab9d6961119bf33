"""Recorded trees, ticked again in this process."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.kinds import Settings
from skiros2_bags.testing.recording import Recording
from skiros2_bags.testing.rerun import rerun
from skiros2_demo_skills import timed_motions, transport_skills
from support.ros import ROOT

BAGS = ROOT / "tests" / "bags"
WORKSPACE = ROOT / "skiros2_std_lib" / "skiros2_demo_skills" / "owl"
SETTINGS = Settings(WORKSPACE)


@pytest.fixture(scope="module")
def pick_place() -> Recording:
    return Recording(BAGS / "timed_pick_place.bag")


def test_unchanged_code_goes_as_recorded(pick_place: Recording) -> None:
    assert rerun(pick_place, SETTINGS) is None


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
