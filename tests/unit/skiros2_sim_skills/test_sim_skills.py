"""The skills of the simulated robot with scripted drivers: goals, changes, failures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from actionlib_msgs.msg import GoalStatus

from control_msgs.msg import GripperCommandResult
from skiros2_common.core.abstract_skill import State
from skiros2_motion.core.geometry import Pose, rotated
from skiros2_sim_msgs.msg import CartesianMotionGoal, CartesianMotionResult
from skiros2_sim_msgs.srv import DetectResponse
from skiros2_skill.testing import FakeClock, SkillBench
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from support.stand_in_drivers import ABORTED, SUCCEEDED, StandInDrivers, install, pose_of, true_things

SCENE = Path(__file__).parents[3] / "skiros2_std_lib/demos/pick_and_place/owl" / "sim_scene.ttl"
MOVE = "/mobile_manipulator/move_base"
ARM = "/mobile_manipulator/arm/cartesian_motion"
JOINTS = "/mobile_manipulator/arm/follow_joint_trajectory"
GRIPPER = "/mobile_manipulator/gripper/gripper_action"
DETECT = "/sim/detect"


class Cell(SkillBench):
    """The scene, and drivers that stand in."""

    def __init__(self, clock: FakeClock) -> None:
        super().__init__(SCENE, clock=clock, period=0.1)
        start = self.robot.getRelation("-1", "skiros:hasStartLocation")["dst"]
        self.wmi.set_relation(self.robot.id, "skiros:at", start)
        self.import_libraries("skiros2_std_skills", "skiros2_sim_skills")
        things = true_things(self.wmi, self.element("Product A"), self.element("Product B"))
        self.drivers = StandInDrivers(things)

    def do(self, skill: str, **params: str) -> Any:
        """Runs a skill, its parameters by label, and returns the task."""
        return self.command(skill, **{key: self.element(label) for key, label in params.items()}).run()

    def done(self, skill: str, **params: str) -> None:
        task = self.do(skill, **params)
        assert task.state is State.Success, task.why

    def why(self, skill: str, **params: str) -> str:
        """Why a skill fails."""
        task = self.do(skill, **params)
        assert task.state is State.Failure
        return str(task.why)

    def ready_to_pick(self) -> None:
        self.done("Drive", TargetLocation="Workstation 1")
        self.done("Look", Workstation="Workstation 1")

    def ready_to_place(self) -> None:
        """With Product A in the gripper, before the other workstation."""
        self.ready_to_pick()
        self.done("Pick", Object="Product A")
        self.done("Drive", TargetLocation="Workstation 2")
        self.done("Look", Workstation="Workstation 2")

    def place_in_map(self, label: str) -> tuple[float, ...]:
        return pose_in_scene(self.wmi, self.element(label))[1].position

    def is_observed(self, label: str) -> bool:
        return bool(self.element(label).value_of("demo:Observed"))


@pytest.fixture
def cell(fake_clock: FakeClock, monkeypatch: pytest.MonkeyPatch) -> Cell:
    cell = Cell(fake_clock)
    install(monkeypatch, cell.drivers)
    return cell


def ends(status: int, result: Any, text: str = "") -> Any:
    return lambda goal: (status, result, text)


def gripped(width: float, stalled: bool = True) -> Any:
    return ends(SUCCEEDED, GripperCommandResult(position=width, stalled=stalled))


def test_skills_bring_a_product_to_the_other_workstation(cell: Cell) -> None:
    cell.ready_to_pick()
    cell.done("Pick", Object="Product A")
    assert cell.holder("Product A") == "Gripper"
    assert cell.element("Gripper").value_of("skiros:ContainerState") == "Full"
    assert cell.element("Tray A").value_of("skiros:ContainerState") == "Empty"
    cell.done("Drive", TargetLocation="Workstation 2")
    cell.done("Look", Workstation="Workstation 2")
    cell.done("Place", Object="Product A", Container="Tray B")
    assert cell.holder("Product A") == "Tray B"
    assert cell.element("Gripper").value_of("skiros:ContainerState") == "Empty"
    assert cell.element("Tray B").value_of("skiros:ContainerState") == "Full"
    assert cell.place_in_map("Product A")[:2] == pytest.approx((1.85, -1.25), abs=1e-6)


def test_drive_updates_free_and_observed(cell: Cell) -> None:
    cell.ready_to_pick()
    assert cell.is_observed("Workstation 1")
    assert not cell.element("Workstation 1").value_of("demo:Free")
    assert cell.element("Charging station").value_of("demo:Free")
    cell.done("Drive", TargetLocation="Workstation 2")
    assert not cell.is_observed("Workstation 1")
    assert cell.element("Workstation 1").value_of("demo:Free")
    goal = cell.drivers.sent_to(MOVE)[0].target_pose
    assert goal.header.frame_id == "map"
    assert pose_of(goal.pose).position == pytest.approx((1.0, 1.5, 0.0))


def test_drive_to_an_occupied_place_is_refused(cell: Cell) -> None:
    station = cell.element("Workstation 1")
    station.setProperty("demo:Free", False)
    cell.wmi.update_element_properties(station)
    assert "TargetFree" in cell.why("Drive", TargetLocation="Workstation 1")


def test_pick_sends_the_expected_motions(cell: Cell) -> None:
    cell.ready_to_pick()
    cell.done("Pick", Object="Product A")
    high, low, lift = cell.drivers.sent_to(ARM)
    assert pose_of(high.target.pose).position == pytest.approx((1.85, 1.75, 0.545 + 0.12))
    assert pose_of(low.target.pose).position == pytest.approx((1.85, 1.75, 0.545))
    assert rotated(pose_of(low.target.pose).orientation, (0.0, 0.0, 1.0)) == pytest.approx((0.0, 0.0, -1.0))
    assert low.speed < high.speed
    assert low.max_force > 0
    assert lift.target.header.frame_id == "mobile_manipulator/arm/tool"
    assert pose_of(lift.target.pose).position == pytest.approx((0.0, 0.0, -0.12))
    assert cell.drivers.sent_to(GRIPPER)[0].command.position == 0.08
    switched = [r.start_controllers[0] for name, r in cell.drivers.goals if name.endswith("switch_controller")]
    assert switched[-3:] == ["position", "compliant", "position"]


def test_look_updates_a_moved_product(cell: Cell) -> None:
    product = cell.element("Product A").id
    cell.drivers.things[product] = (Pose((1.87, 1.22, 0.545), (0.0, 0.0, 0.0, 1.0)), 0.05)
    cell.ready_to_pick()
    assert cell.holder("Product A") == "Tray C"
    assert cell.element("Tray A").value_of("skiros:ContainerState") == "Empty"
    assert cell.element("Tray C").value_of("skiros:ContainerState") == "Full"
    assert cell.place_in_map("Product A") == pytest.approx((1.87, 1.22, 0.545))
    why = cell.do("Pick", Object="Product A", Container="Tray A").why
    assert "ObjectInContainer" in why


def test_look_finds_a_product_on_the_table(cell: Cell) -> None:
    product = cell.element("Product A").id
    cell.drivers.things[product] = (Pose((2.1, 1.6, 0.525), (0.0, 0.0, 0.38268343, 0.92387953)), 0.05)
    cell.ready_to_pick()
    assert cell.holder("Product A") == "Top of workstation 1"
    cell.done("Pick", Object="Product A")
    assert cell.holder("Product A") == "Gripper"


def test_look_removes_a_missing_product_after_two_detections(cell: Cell) -> None:
    cell.drivers.missing.add(cell.element("Product A").id)
    cell.done("Drive", TargetLocation="Workstation 1")
    task = cell.do("Look", Workstation="Workstation 1")
    assert task.state is State.Success
    assert len(cell.drivers.sent_to(DETECT)) == 2
    assert cell.holder("Product A") == "Simulated cell"
    assert cell.element("Tray A").value_of("skiros:ContainerState") == "Empty"
    assert "Product A is no longer in Tray A" in task.node("detect_objects").progress_msg


def test_product_on_the_floor_has_no_container(cell: Cell) -> None:
    cell.drivers.things[cell.element("Product A").id] = (Pose((1.5, 1.5, 0.025), (0.0, 0.0, 0.0, 1.0)), 0.05)
    cell.ready_to_pick()
    assert cell.holder("Product A") == "Simulated cell"


def test_pick_of_nothing_fails_and_resets_observed(cell: Cell) -> None:
    cell.ready_to_pick()
    cell.drivers.answer(GRIPPER, None, gripped(0.0, stalled=False))
    assert "Product A is not between the fingers: they have closed" in cell.why("Pick", Object="Product A")
    assert cell.holder("Product A") == "Tray A"
    assert cell.element("Gripper").value_of("skiros:ContainerState") == "Empty"
    assert not cell.is_observed("Workstation 1")
    assert "WorkstationObserved" in cell.why("Pick", Object="Product A")


def test_pick_of_another_width_fails(cell: Cell) -> None:
    cell.ready_to_pick()
    cell.drivers.answer(GRIPPER, None, gripped(0.075))
    assert "75 mm wide, but Product A is 50 x 50 x 50 mm" in cell.why("Pick", Object="Product A")


@pytest.mark.parametrize("check", [0, 1])
def test_slipped_product_leaves_the_gripper(cell: Cell, check: int) -> None:
    cell.ready_to_pick()

    def slips(goal: Any) -> Any:
        cell.drivers.lose()
        return gripped(0.0, stalled=False)(goal)

    cell.drivers.answer(GRIPPER, None, None, *[None] * check, slips)
    assert "they have closed" in cell.why("Pick", Object="Product A")
    assert cell.holder("Product A") == "Tray A"
    cell.done("Look", Workstation="Workstation 1")
    cell.done("Pick", Object="Product A")


def test_lost_product_stops_the_drive(cell: Cell) -> None:
    cell.ready_to_pick()
    cell.done("Pick", Object="Product A")
    cell.drivers.answer(MOVE, ends(GoalStatus.ACTIVE, None))
    cell.drivers.answer(GRIPPER, None, gripped(0.0, stalled=False))
    assert "Gripper has lost it" in cell.why("Drive", TargetLocation="Workstation 2")
    assert cell.drivers.goals[-1] == (MOVE, "cancel") or (MOVE, "cancel") in cell.drivers.goals
    assert cell.holder("Product A") == "Simulated cell"
    assert cell.element("Gripper").value_of("skiros:ContainerState") == "Empty"
    assert cell.related("demo:mobile_manipulator", "skiros:at") == ["Workstation 1"]


def test_look_ignores_a_held_product(cell: Cell) -> None:
    cell.ready_to_pick()
    cell.done("Pick", Object="Product A")
    held = pose_in_scene(cell.wmi, cell.element("Product A"))[1]
    cell.drivers.things[cell.element("Product A").id] = (held, 0.05)
    cell.drivers.held = None
    cell.done("Look", Workstation="Workstation 1")
    assert cell.holder("Product A") == "Gripper"


def test_look_finds_a_dropped_product(cell: Cell) -> None:
    cell.ready_to_pick()
    cell.done("Pick", Object="Product A")
    cell.drivers.things[cell.element("Product A").id] = (Pose((1.85, 1.25, 0.545), (0.0, 0.0, 0.0, 1.0)), 0.05)
    cell.drivers.held = None
    cell.done("Look", Workstation="Workstation 1")
    assert cell.holder("Product A") == "Tray C"
    assert cell.element("Gripper").value_of("skiros:ContainerState") == "Empty"


def test_place_fails_if_the_product_is_not_there(cell: Cell) -> None:
    cell.ready_to_place()

    def rolled_away(goal: Any) -> Any:
        cell.drivers.things[cell.element("Product A").id] = (Pose((2.2, -1.0, 0.525), (0.0, 0.0, 0.0, 1.0)), 0.05)
        return cell.drivers._detect()

    cell.drivers.answer(DETECT, rolled_away)
    assert "ObjectInContainer" in cell.why("Place", Object="Product A", Container="Tray B")
    assert cell.holder("Product A") == "Top of workstation 2"
    assert cell.element("Tray B").value_of("skiros:ContainerState") == "Empty"


def test_place_into_a_full_tray_is_refused(cell: Cell) -> None:
    cell.ready_to_place()
    assert "ContainerNotFull" in cell.why("Place", Object="Product A", Container="Tray D")


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (CartesianMotionGoal.UNREACHABLE, "out of reach of the arm"),
        (CartesianMotionGoal.FORCE_LIMIT, "the tool has hit something"),
        (CartesianMotionGoal.BLOCKED, "the arm is blocked"),
    ],
)
def test_failed_tool_motion_has_a_reason(cell: Cell, code: int, words: str) -> None:
    cell.ready_to_pick()
    result = CartesianMotionResult(error_code=code, error_string="the driver's own words")
    cell.drivers.answer(ARM, ends(ABORTED, result))
    why = cell.why("Pick", Object="Product A")
    assert f"Moving above Product A failed: {words} (the driver's own words)" in why
    assert ("it is not retried: a limit was exceeded" in why) == (code == CartesianMotionGoal.FORCE_LIMIT)


def test_failed_base_motion_has_a_reason(cell: Cell) -> None:
    cell.drivers.answer(MOVE, ends(ABORTED, None, "blocked after 1.2 m"))
    assert "Driving to Workstation 1 failed: blocked after 1.2 m" in cell.why("Drive", TargetLocation="Workstation 1")
    assert cell.related("demo:mobile_manipulator", "skiros:at") == ["Charging station"]
    cell.done("Drive", TargetLocation="Workstation 1")


def test_failed_detection_has_a_reason(cell: Cell) -> None:
    cell.done("Drive", TargetLocation="Workstation 1")
    cell.drivers.answer(DETECT, lambda request: DetectResponse(ok=False, message="no picture yet"))
    assert "Camera detected nothing: no picture yet" in cell.why("Look", Workstation="Workstation 1")
    assert not cell.is_observed("Workstation 1")


def test_invalid_detections_are_ignored(cell: Cell) -> None:
    cell.done("Drive", TargetLocation="Workstation 1")

    def odd(request: Any) -> Any:
        response = cell.drivers._detect()
        response.detections[0].id = "skiros:Product-999"
        response.detections[1].pose.pose.position.x = float("nan")
        return response

    cell.drivers.answer(DETECT, odd, odd)
    cell.done("Look", Workstation="Workstation 1")
    assert cell.holder("Product B") == "Tray D"


def test_look_accepts_elements_without_pose_or_size(cell: Cell) -> None:
    for label, key in (("Tray D", "skiros:PositionX"), ("Product A", "skiros:SizeX")):
        element = cell.element(label)
        element.removeProperty(key)
        cell.wmi.update_element_properties(element)
    cell.ready_to_pick()
    assert cell.holder("Product A") == "Tray A"
    assert cell.holder("Product B") == "Top of workstation 2"


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("skiros:Postures", '{"tucked": [0, 0, 0, 0, 0, 0, 0]}', "has no posture 'home'; it has: tucked"),
        ("skiros:Postures", '{"home": [0, 0]}', "expected 7 numbers"),
        ("skiros:Postures", '{"home": [0, 0, 0, 0, 0, 0, "NaN"]}', "expected 7 numbers"),
        ("skiros:JointNames", "[", "expected a JSON list"),
    ],
)
def test_invalid_postures_are_reported(cell: Cell, key: str, value: str, words: str) -> None:
    arm = cell.element("Arm")
    arm.setProperty(key, value)
    cell.wmi.update_element_properties(arm)
    cell.done("Drive", TargetLocation="Workstation 1")
    why = cell.why("Look", Workstation="Workstation 1")
    assert words in why
    assert "Traceback" not in why
    assert not cell.drivers.sent_to(JOINTS)


def test_pick_without_size_fails_with_reason(cell: Cell) -> None:
    cell.ready_to_pick()
    product = cell.element("Product A")
    product.setProperty("skiros:SizeX", 0.0)
    cell.wmi.update_element_properties(product)
    assert "'Product A' has no size" in cell.why("Pick", Object="Product A")


def test_pick_of_a_wide_product_fails_before_motion(cell: Cell) -> None:
    cell.ready_to_pick()
    for label, key, value in (("Product A", "skiros:SizeX", 0.09), ("Product A", "skiros:SizeY", 0.12)):
        element = cell.element(label)
        element.setProperty(key, value)
        cell.wmi.update_element_properties(element)
    assert "the object is 90 mm wide, but the gripper opens to 80 mm" in cell.why("Pick", Object="Product A")
    assert not cell.drivers.sent_to(ARM)


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_invalid_opening_is_reported(cell: Cell, value: float) -> None:
    cell.ready_to_pick()
    gripper = cell.element("Gripper")
    gripper.setProperty("skiros:Opening", value)
    cell.wmi.update_element_properties(gripper)
    assert "skiros:Opening is" in cell.why("Pick", Object="Product A")


def test_preempted_pick_leaves_the_product_in_its_tray(cell: Cell) -> None:
    cell.ready_to_pick()
    cell.drivers.answer(ARM, None, ends(GoalStatus.ACTIVE, None))
    task = cell.command("Pick", Object=cell.element("Product A"))
    task.run(ticks=20)
    task.preempt()
    assert task.tick() is State.Failure
    assert cell.drivers.goals[-1] == (ARM, "cancel")
    assert cell.holder("Product A") == "Tray A"
    assert not cell.is_observed("Workstation 1")
