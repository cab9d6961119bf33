"""Drive, pick and place on the demo's scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_skill.testing import FakeClock, SkillBench
from skiros2_std_reasoners.core.spatial_data import pose_of

ROOT = Path(__file__).parents[3]
SCENE = ROOT / "skiros2_std_lib/demos/timed_skills/owl" / "pick_place_scene.ttl"


@pytest.fixture
def bench(fake_clock: FakeClock) -> SkillBench:
    """The demo's scene with the robot at the charging station. A tick takes a second."""
    bench = SkillBench(SCENE, clock=fake_clock, period=1.0)
    bench.wmi.set_relation(bench.robot.id, "skiros:at", bench.robot.getRelation("-1", "skiros:hasStartLocation")["dst"])
    return bench.import_libraries("skiros2_std_skills", "skiros2_demo_skills")


def drive(bench: SkillBench, place: str) -> Any:
    return bench.command("Drive", TargetLocation=bench.element(place)).run().skill


def at(bench: SkillBench) -> list[str]:
    return bench.related(bench.robot.label, "skiros:at")


def pick(bench: SkillBench, product: str) -> Any:
    return bench.command("Pick", Object=bench.element(product)).run().skill


def place(bench: SkillBench, product: str, tray: str) -> Any:
    return bench.command("Place", Object=bench.element(product), Container=bench.element(tray)).run().skill


def succeeded(*nodes: Any) -> bool:
    for node in nodes:
        assert node.state is State.Success, node.progress_msg
    return True


def test_skills_bring_a_product_to_another_tray(bench: SkillBench) -> None:
    assert succeeded(drive(bench, "Workstation 1"), pick(bench, "Product A"))
    assert bench.holder("Product A") == "Gripper"
    assert bench.element("Gripper").value_of("skiros:ContainerState") == "Full"
    assert succeeded(drive(bench, "Workstation 2"), place(bench, "Product A", "Tray B"))
    assert bench.holder("Product A") == "Tray B"
    assert bench.element("Gripper").value_of("skiros:ContainerState") == "Empty"
    assert [bench.element(f"Tray {t}").value_of("skiros:ContainerState") for t in "ABCD"] == [
        "Empty",
        "Full",
        "Full",
        "Full",
    ]


def test_drive_updates_location_and_pose(bench: SkillBench) -> None:
    assert succeeded(drive(bench, "Workstation 1"))
    assert at(bench) == ["Workstation 1"]
    assert pose_of(bench.wmi.get_element(bench.robot.id)).position == pytest.approx((1.1, 1.5, 0.2))


def test_drive_without_approach_pose_ends_at_the_place(bench: SkillBench) -> None:
    assert succeeded(drive(bench, "Workstation 1"), drive(bench, "Charging station"))
    assert pose_of(bench.wmi.get_element(bench.robot.id)).position == pytest.approx((0.0, 0.0, 0.2))


def test_drive_to_the_current_place_is_refused(bench: SkillBench) -> None:
    node = drive(bench, "Charging station")
    assert node.state is State.Failure
    assert "RobotElsewhere" in node.progress_msg


def test_pick_at_another_place_is_refused(bench: SkillBench) -> None:
    succeeded(drive(bench, "Workstation 2"))
    node = pick(bench, "Product A")
    assert node.state is State.Failure
    assert bench.holder("Product A") == "Tray A"


def test_pick_with_a_full_gripper_is_refused(bench: SkillBench) -> None:
    succeeded(drive(bench, "Workstation 1"), pick(bench, "Product A"))
    node = pick(bench, "Product C")
    assert node.state is State.Failure
    assert "Gripper" in node.progress_msg
    assert bench.holder("Product C") == "Tray C"


def test_place_without_the_object_is_refused(bench: SkillBench) -> None:
    succeeded(drive(bench, "Workstation 2"))
    assert place(bench, "Product A", "Tray B").state is State.Failure
    assert bench.holder("Product A") == "Tray A"


def test_moved_robot_stops_picking(bench: SkillBench) -> None:
    succeeded(drive(bench, "Workstation 1"))
    task = bench.command("Pick", Object=bench.element("Product A"))
    assert task.tick() is State.Running
    bench.wmi.set_relation(bench.robot.id, "skiros:at", bench.element("Workstation 1").id, False)
    assert task.tick() is State.Failure
    assert "RobotAtWorkstation" in task.root.children[0].progress_msg
    assert bench.holder("Product A") == "Tray A"


def test_preempted_motion_changes_nothing(bench: SkillBench) -> None:
    succeeded(drive(bench, "Workstation 1"))
    task = bench.command("Drive", TargetLocation=bench.element("Workstation 2"))
    assert task.tick() is State.Running
    task.preempt()
    assert task.tick() is State.Failure
    assert at(bench) == ["Workstation 1"]


def test_motions_report_progress(bench: SkillBench) -> None:
    task = bench.command("Drive", TargetLocation=bench.element("Workstation 1"))
    task.tick()
    task.tick()
    told = [n.progress_message for n in task.progress() if n.label == "move_base_timed"]
    assert told == ["Driving to Workstation 1: 50%"]


def test_object_poses_after_pick_and_place(bench: SkillBench) -> None:
    def position() -> tuple[float, ...]:
        return pose_of(bench.element("Product A")).position

    succeeded(drive(bench, "Workstation 1"), pick(bench, "Product A"))
    assert position() == (0.0, 0.0, 0.0)
    succeeded(drive(bench, "Workstation 2"), place(bench, "Product A", "Tray B"))
    assert position() == (0.0, 0.0, 0.06)
