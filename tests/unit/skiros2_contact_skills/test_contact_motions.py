"""Primitives with a stand-in arm above a surface: what they command, how they end, and why they fail."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import OutOfLimits, WrongValue
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.world_element import Element
from skiros2_contact_skills import contact_motions, force_motions, free_motions, plugging
from skiros2_contact_skills import contact_primitive as codes
from skiros2_contact_skills.arms import provided_arms
from skiros2_contact_skills.core.part_poses import aligned_tool, depth_and_tilt, smallest_rotation
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, angle_between, from_euler, rotated
from skiros2_perception.core.fusion import covariance_text
from skiros2_skill.core.skill import RetryOnFail, SelectorStar, Skill
from skiros2_skill.testing import SkillBench
from skiros2_std_reasoners.core.spatial_data import set_pose
from support.surface_arm import DOWN, OPENING, SURFACE, SurfaceArm


class Rig:
    """A bench with the skills and the stand-in."""

    def __init__(self, bench: SkillBench, arm: SurfaceArm, source: _Source) -> None:
        self.bench, self.arm, self.source = bench, arm, source
        self.element: Element = bench.add("rparts:ArmDevice", "arm", bench.robot, "skiros:hasA")

    def command(self, skill: str, **params: Any) -> Any:
        return self.bench.command(skill, Arm=self.element, **params)

    def run(self, task: Any, ticks: int = 400) -> Any:
        """Ticks to the end."""
        for _ in range(ticks):
            if task.tick() is not State.Running:
                break
            self.arm.step()
        return task


@pytest.fixture
def rig(skill_bench: SkillBench) -> Iterator[Rig]:
    for module in (contact_motions, force_motions, free_motions):
        names = [name for name in vars(module) if name.islower() and hasattr(getattr(module, name), "setDescription")]
        skill_bench.load(*(getattr(module, name) for name in names))
    arm = SurfaceArm()
    source = _Source(arm)
    with provided_arms(source):
        yield Rig(skill_bench, arm, source)


class _Source:
    def __init__(self, arm: SurfaceArm) -> None:
        self.arm_here = arm
        self.fingers: float | None = None

    def width(self, wmi: Any, robot: Element, gripper: Element) -> float | None:
        return self.fingers

    def arm(self, wmi: Any, robot: Element, arm: Element) -> SurfaceArm:
        return self.arm_here


def code(task: Any) -> int:
    return int(task.skill.progress_code)


def test_motion_until_contact_ends_at_the_surface_and_reports_it(rig: Rig) -> None:
    task = rig.run(rig.command("MoveUntilContact", ContactForce=3.0))
    assert task.state is State.Success, task.why
    assert task.skill.params["Surface"].values == pytest.approx([0.5, 0.0, SURFACE])
    assert "N" in task.skill.progress_msg
    assert rig.arm.calls == ["begin", "40 15", "end"]


def test_limits_of_axes_are_set_and_slow_the_motion_down(rig: Rig) -> None:
    task = rig.run(rig.command("MoveUntilContact", MaxForceAxes=[0.0, 5.0, 10.0], MaxTorqueAxes=[1.0, 0.0, 0.0]))
    assert "40 15 0 5 10 1 0 0" in rig.arm.calls
    assert task.state is State.Success, task.why
    assert "stay below 10 N" in task.skill.progress_msg


def test_limit_of_an_axis_that_is_not_a_number_is_refused(rig: Rig) -> None:
    with pytest.raises(OutOfLimits, match="MaxForceAxes"):
        rig.command("MoveUntilContact", MaxForceAxes=[math.nan, 0.0, 0.0])


@pytest.mark.parametrize("limits", [[10.0], [math.inf, 0.0, 0.0]])
def test_limits_of_axes_that_are_not_three_numbers_do_not_start(rig: Rig, limits: list[float]) -> None:
    task = rig.run(rig.command("MoveUntilContact", MaxForceAxes=limits))
    assert task.state is State.Failure
    assert "MaxForceAxes" in task.why


def test_motion_without_contact_fails_with_its_code(rig: Rig) -> None:
    task = rig.run(rig.command("MoveUntilContact", MaxDistance=0.01))
    assert task.state is State.Failure
    assert code(task) == codes.NO_CONTACT
    assert "No contact within 10" in task.skill.progress_msg
    assert rig.arm.calls[-1] == "end"


def test_motion_that_needs_no_contact_succeeds_without(rig: Rig) -> None:
    task = rig.run(rig.command("MoveUntilContact", MaxDistance=0.01, NeedsContact=False))
    assert task.state is State.Success, task.why


def test_stop_of_the_driver_fails_the_skill_in_the_next_tick_with_its_reason(rig: Rig) -> None:
    task = rig.command("MoveUntilContact")
    task.tick(2)
    rig.arm.stopped = "force of 41.0 N above the limit of 40 N"
    assert task.tick() is State.Failure
    assert code(task) == codes.STOPPED
    assert "arm has stopped: force of 41.0 N above the limit of 40 N" in task.skill.progress_msg


class PeakArm(SurfaceArm):
    """An arm whose driver has measured a peak between two ticks."""

    peak = 0.0

    def take_peak(self) -> float:
        return self.peak


def test_contact_with_a_peak_far_above_the_limit_fails(rig: Rig) -> None:
    rig.source.arm_here = arm = PeakArm()
    arm.peak = 51.0
    task = rig.command("MoveUntilContact")
    while task.tick() is State.Running:
        arm.step()
    assert code(task) == codes.OVERSHOT
    assert "peak of 51.0 N above the limit of 40 N" in task.skill.progress_msg
    assert task.skill.params["PeakForce"].value == 51.0


def test_contact_with_a_peak_a_little_above_the_limit_says_so(rig: Rig) -> None:
    rig.source.arm_here = arm = PeakArm()
    arm.peak = 42.0
    task = rig.command("MoveUntilContact")
    while task.tick() is State.Running:
        arm.step()
    assert task.state is State.Success
    assert "peak of 42.0 N above the limit of 40 N" in task.skill.progress_msg


def test_driver_that_does_not_answer_fails_the_skill_after_some_seconds(rig: Rig) -> None:
    rig.arm.silent = True
    task = rig.run(rig.command("HoldPose"))
    assert code(task) == codes.NOT_READY
    assert "it does not answer" in task.skill.progress_msg
    assert rig.arm.time == pytest.approx(codes.READY_TIME, abs=0.1)


def test_answer_that_is_late_in_the_middle_of_a_motion_is_waited_for(rig: Rig) -> None:
    task = rig.command("HoldPose")
    task.tick()
    rig.arm.time += 2.0 * codes.READY_TIME
    rig.arm.silent = True
    assert task.tick() is State.Running
    rig.arm.silent = False
    assert task.tick() is State.Running


def test_refused_request_is_repeated_until_the_driver_follows(rig: Rig) -> None:
    rig.arm.stopped = "controller compliant is not loaded"
    task = rig.command("RetractTool", Height=0.05)
    task.tick(3)
    assert task.state is State.Running
    assert rig.arm.calls.count("begin") > 1
    rig.arm.stopped = ""
    assert rig.run(task).state is State.Success, task.why


@pytest.mark.parametrize("kind", [kind for kind in FailureKind if kind.is_final])
def test_start_clears_a_stop_once_only(rig: Rig, kind: FailureKind) -> None:
    rig.arm.stopped, rig.arm.kind = "force of 74.2 N above the limit of 40 N", kind
    task = rig.run(rig.command("RetractTool", Height=0.05))
    assert task.state is State.Failure
    assert task.cause().failure_kind is kind
    assert rig.arm.calls.count("begin") == 1


@pytest.mark.parametrize("kind", [kind for kind in FailureKind if kind.is_final])
def test_stopped_motion_is_not_retried(rig: Rig, kind: FailureKind) -> None:
    hold = rig.bench.node("HoldPose", Arm=rig.element)
    task = rig.bench.task(Skill("", RetryOnFail(5))(hold))
    task.tick(2)
    rig.arm.stopped, rig.arm.kind = "force of 41.0 N above the limit of 40 N", kind
    task.tick(10)
    assert task.state is State.Failure
    assert task.cause().failure_kind is kind
    assert rig.arm.calls == ["begin", "40 15", "end"]


@pytest.mark.parametrize(("kind", "retracts"), [(FailureKind.LIMIT, True), (FailureKind.CONTROLLER, False)])
def test_arm_retracts_after_a_limit_and_leaves_a_foreign_controller_alone(
    rig: Rig, kind: FailureKind, retracts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = rig.arm.begin

    def begin_and_clear() -> None:
        begin()
        rig.arm.stopped = ""

    monkeypatch.setattr(rig.arm, "begin", begin_and_clear)
    nodes = [rig.bench.node(name, Arm=rig.element) for name in ("HoldPose", "RetractAfterFailure")]
    task = rig.bench.task(Skill("", SelectorStar())(*nodes))
    task.tick(2)
    height = rig.arm.pose.position[2]
    rig.arm.stopped, rig.arm.kind = "41.0 N", kind
    rig.run(task)
    assert (rig.arm.pose.position[2] > height + 0.01) is retracts
    assert rig.arm.calls.count("begin") == 1 + retracts
    assert task.state is State.Failure
    assert (task.cause().label, task.cause().failure_kind) == ("hold_pose", kind)


@pytest.mark.parametrize(("width", "is_held"), [(0.0005, False), (0.08, False), (0.02, True), (None, True)])
def test_arm_that_was_not_compliant_does_not_move_when_its_part_is_lost(
    rig: Rig, width: float | None, is_held: bool
) -> None:
    gripper = rig.bench.add("rparts:GripperEffector", "gripper", rig.element, "skiros:hasA")
    rig.bench.add("skiros:Product", "piston", gripper, "skiros:contain")
    rig.source.fingers = width
    rig.arm.stopped, rig.arm.kind = "the controller is not active", FailureKind.CONTROLLER
    task = rig.command("RetractTool", Height=0.01)
    rig.arm.stopped = ""  # `begin` activates it
    rig.run(task)
    assert (task.state is State.Success) is is_held, task.why
    if not is_held:
        assert "piston: not between the fingers" in task.why
        assert (code(task), task.cause().failure_kind) == (codes.NOT_HELD, FailureKind.CONTROLLER)
        assert rig.arm.pose.position[2] == 0.32


def test_preempted_skill_leaves_the_arm_at_rest(rig: Rig) -> None:
    task = rig.command("HoldPose", Force=5.0)
    task.tick(3)
    assert rig.arm.exerted > 0.0
    task.preempt()
    task.tick()
    assert rig.arm.calls[-1] == "end"
    assert rig.arm.exerted == 0.0


def test_second_skill_for_the_same_arm_is_refused(rig: Rig) -> None:
    first, second = rig.command("HoldPose"), rig.command("HoldPose")
    first.tick()
    second.tick()
    assert second.state is State.Failure
    assert "arm is used by another skill" in second.why
    assert "onEnd" not in second.why
    assert "end" not in rig.arm.calls
    first.preempt()
    first.tick()
    assert rig.command("HoldPose").tick() is State.Running


def test_search_ends_when_the_part_drops(rig: Rig) -> None:
    rig.arm.set_reference(Pose((0.5, 0.0, SURFACE), DOWN))
    rig.arm.step()
    task = rig.command("SpiralSearch")
    for _ in range(10):
        task.tick()
        rig.arm.step()
    assert task.state is State.Running
    assert "start_spiral" in rig.arm.calls
    rig.arm.opens = True
    rig.run(task, 50)
    assert task.state is State.Success, task.why


def test_search_without_an_opening_ends_in_time(rig: Rig) -> None:
    rig.arm.set_reference(Pose((0.5, 0.0, SURFACE), DOWN))
    rig.arm.step()
    task = rig.run(rig.command("SpiralSearch", SearchTime=2.0))
    assert code(task) == codes.NOT_FOUND


def test_part_that_finds_no_opening_is_lifted_off_the_rim(rig: Rig) -> None:
    task = pressed(rig).run(rig.command("SpiralSearch", SearchTime=1.0))
    assert code(task) == codes.NOT_FOUND
    assert "it is lifted" in task.skill.progress_msg
    assert rig.arm.pose.position[2] > SURFACE + 0.004


def test_part_that_cannot_be_lifted_is_reported_with_where_it_is(rig: Rig) -> None:
    pressed(rig)
    stuck = rig.arm.pose
    task = rig.command("SpiralSearch", SearchTime=1.0)
    for _ in range(200):
        if task.tick() is not State.Running:
            break
        rig.arm.step()
        rig.arm.pose = stuck
    assert code(task) == codes.NOT_FOUND
    assert "it cannot be lifted and stays 0.0 mm deep" in task.skill.progress_msg


def pressed(rig: Rig) -> Rig:
    rig.arm.set_reference(Pose((0.5, 0.0, SURFACE), DOWN))
    rig.arm.step()
    return rig


def test_search_ends_when_its_spiral_has_returned(rig: Rig) -> None:
    spiral = {"Radius": 0.002, "PathDistance": 0.001, "PathVelocity": 0.01}  # 1.3 s each way
    task = pressed(rig).run(rig.command("SpiralSearch", SearchTime=60.0, **spiral))
    assert code(task) == codes.NOT_FOUND
    assert rig.arm.time < 6.0


def test_attempts_of_a_task_have_a_total_time(rig: Rig) -> None:
    task = pressed(rig).run(rig.command("SpiralSearch", SearchTime=5.0, TotalTime=6.0, Searched=[5.5]))
    assert code(task) == codes.NOT_FOUND
    assert rig.arm.time < 1.0
    assert task.skill.params["Searched"].value > 6.0


@pytest.mark.parametrize(
    ("deviation", "turn", "radius"), [(0.0001, 0.0001, 0.0023), (0.0005, 0.0001, 0.0035), (0.0001, 0.01, 0.005)]
)
def test_covariance_of_an_estimated_pose_bounds_the_search(
    rig: Rig, deviation: float, turn: float, radius: float
) -> None:
    block = rig.bench.add("skiros:Product", "block", rig.bench.robot, "skiros:contain")
    block.setProperty("skiros:PoseCovariance", covariance_text(np.diag([deviation**2] * 3 + [turn**2] * 3)))
    rig.bench.wmi.update_element_properties(block)
    bore = rig.bench.add("skiros:Bore", "bore", block, "skiros:hasA")
    set_pose(bore, Pose((0.1, 0.0, 0.0), IDENTITY.orientation))
    rig.bench.wmi.update_element_properties(bore)
    task = pressed(rig).command("SpiralSearch", Bore=bore)
    task.tick(3)
    assert rig.arm.spiral.radius == pytest.approx(radius, abs=1e-4)


def test_insertion_ends_on_the_floor_and_a_jam_fails(rig: Rig) -> None:
    rig.arm.opens = True
    rig.arm.set_reference(Pose((0.5, 0.0, SURFACE), DOWN))
    rig.arm.step()
    task = rig.run(rig.command("InsertPart", Depth=SURFACE - OPENING))
    assert task.state is State.Success, task.why
    rig.arm.set_reference(Pose((0.5, 0.0, SURFACE), DOWN))
    rig.arm.step()
    jammed = rig.run(rig.command("InsertPart", Depth=0.1))
    assert code(jammed) == codes.NO_PROGRESS
    assert "of 100.0 mm deep" in jammed.skill.progress_msg


def test_pull_test_fails_when_the_part_moves(rig: Rig) -> None:
    task = rig.run(rig.command("PullTest"))
    assert code(task) == codes.NOT_HELD
    assert "the part does not hold" in task.skill.progress_msg


class HeldArm(SurfaceArm):
    """The tool is held by something elastic.

    :ivar elasticity: N/m.
    :ivar most: the largest force with which it was pulled (N).
    """

    elasticity, most = 2000.0, 0.0

    def step(self) -> None:
        self.time += 0.04
        pull = -self.exerted / (1.0 + self.stiffness / self.elasticity)
        x, y, z = self.reference.position
        self.pose = Pose((x, y, z + pull / self.elasticity), DOWN)
        self._pressed = -pull
        self.most = max(self.most, pull)


def test_pull_test_ends_when_the_force_was_measured(rig: Rig) -> None:
    rig.arm = rig.source.arm_here = arm = HeldArm()
    task = rig.run(rig.command("PullTest", Force=10.0, MaxDistance=0.01))
    assert task.state is State.Success, task.why
    assert 9.0 < arm.most < 10.5
    assert "withstands 9." in task.skill.progress_msg or "withstands 10.0" in task.skill.progress_msg


def test_pull_that_does_not_reach_its_force_proves_nothing(rig: Rig) -> None:
    rig.arm = rig.source.arm_here = HeldArm()
    rig.arm.elasticity = 100.0  # the spring of the arm takes up the largest wrench
    task = rig.run(rig.command("PullTest", Force=20.0, MaxDistance=0.05))
    assert code(task) == codes.NO_PROGRESS
    assert "has not reached 20 N" in task.skill.progress_msg


class LateArm(SurfaceArm):
    """A plug has clicked and reached its floor between two ticks; the driver has kept the states.

    :ivar kept: depth (mm) and force (N) of each.
    """

    kept = ((2.0, 0.5), (14.0, 1.0), (15.5, 9.0), (16.9, 12.0), (18.5, 0.2), (20.0, 7.0))

    def __init__(self) -> None:
        super().__init__()
        self.ticks = 0

    def at(self, depth: float, force: float) -> ArmState:
        return ArmState(Pose((0.5, 0.0, SURFACE - depth / 1000.0), DOWN), (0.0, 0.0, force, 0.0, 0.0, 0.0), self.time)

    def state(self) -> ArmState:
        return self.at(*self.kept[-1])

    def take_states(self) -> list[ArmState]:
        self.ticks += 1
        return [] if self.ticks == 1 else [self.at(*each) for each in self.kept]


def test_click_between_two_ticks_is_felt(rig: Rig) -> None:
    rig.bench.load(plugging.plug_in)
    rig.arm = rig.source.arm_here = LateArm()
    socket = rig.bench.add("skiros:Bore", "socket", rig.bench.robot, "skiros:hasA")
    for key, value in (("Depth", 0.02), ("LatchDepth", 0.017), ("LatchForce", 12.0)):
        socket.setProperty(f"skiros:{key}", value)
    rig.bench.wmi.update_element_properties(socket)
    task = rig.run(rig.command("PlugIn", Socket=socket, Surface=[0.5, 0.0, SURFACE]), 5)
    assert task.state is State.Success, task.why
    assert task.skill.params["Signature"].values == pytest.approx([12.0, 0.0169, 0.2, 0.020])


def test_retraction_moves_back_along_the_tool_axis(rig: Rig) -> None:
    task = rig.run(rig.command("RetractTool", Height=0.1))
    assert task.state is State.Success, task.why
    assert rig.arm.pose.position == pytest.approx((0.5, 0.0, 0.42), abs=1e-3)


@pytest.mark.parametrize(
    ("skill", "params"),
    [
        ("RetractTool", {"Height": 0.2, "Speed": 0.2}),
        ("MoveUntilContact", {"MaxDistance": 0.02, "Speed": 0.02, "NeedsContact": False}),
    ],
)
def test_late_tick_delays_the_motion_without_a_jump_of_the_reference(
    rig: Rig, skill: str, params: dict[str, Any]
) -> None:
    rig.arm.pose = rig.arm.reference = Pose((0.5, 0.0, 0.5), DOWN)
    task, heights = rig.command(skill, **params), []
    for tick in range(400):
        if task.tick() is not State.Running:
            break
        heights.append(rig.arm.reference.position[2])
        rig.arm.step()
        rig.arm.time += 3.0 if tick == 10 else 0.0
    assert task.state is State.Success, task.why
    assert max(abs(b - a) for a, b in itertools.pairwise(heights)) <= 0.1 * params["Speed"] + 1e-9


@pytest.mark.parametrize("value", [0.0, 500.0])
def test_parameter_out_of_its_limits_does_not_start(rig: Rig, value: float) -> None:
    with pytest.raises(OutOfLimits, match=r"'ContactForce': expected 0\.5 to 30 N"):
        rig.command("MoveUntilContact", ContactForce=value)


def test_aligned_tool_puts_the_lower_end_above_the_target_and_keeps_the_yaw() -> None:
    tool = Pose((0.4, 0.1, 0.5), DOWN)
    end = Pose((0.0, 0.0, 0.08), DOWN)
    target = Pose((0.5, 0.0, 0.2), from_euler(0.02, 0.0, 0.5))
    goal = aligned_tool(tool, end, target, 0.01)
    assert angle_between(goal.orientation, tool.orientation) == pytest.approx(0.02, abs=1e-6)
    assert depth_and_tilt(target, Pose((0.5, 0.0, 0.2), IDENTITY.orientation), 0.1)[0] == pytest.approx(0.05, abs=1e-4)
    assert goal.position[2] == pytest.approx(0.29, abs=1e-3)


@pytest.mark.parametrize("b", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.6, 0.0, 0.8)])
def test_smallest_rotation_turns_one_vector_to_the_other(b: Vector) -> None:
    assert rotated(smallest_rotation((0.0, 0.0, 1.0), b), (0.0, 0.0, 1.0)) == pytest.approx(b, abs=1e-9)


def test_source_is_removed_after_its_block() -> None:
    with pytest.raises(WrongValue), provided_arms(_Source(SurfaceArm())):
        raise WrongValue("left")
