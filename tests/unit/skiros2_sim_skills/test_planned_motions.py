"""The primitive that moves an arm without collisions: in physics, with scripted planners, and with MoveIt."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import rospy
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from control_msgs.msg import FollowJointTrajectoryResult
from skiros2_common.core.abstract_skill import State
from skiros2_motion.core.geometry import Pose
from skiros2_sim_msgs.msg import PlanMotionGoal, PlanMotionResult
from skiros2_skill.testing import FakeClock, SkillBench
from skiros2_std_reasoners.core import spatial_data as space
from support.moved_robot import DOWN
from support.physical_drivers import PhysicalDrivers
from support.simulated_cell import at, box
from support.stand_in_drivers import ABORTED, SUCCEEDED, StandInDrivers, install

SCENE = Path(__file__).parents[3] / "skiros2_std_lib/demos/pick_and_place/owl" / "sim_scene.ttl"
PLANNER = "/mobile_manipulator/arm/plan_motion"
JOINTS = "/mobile_manipulator/arm/follow_joint_trajectory"
ARM, WALL = "rparts:ArmDevice-3", "test:Wall-1"
PERIOD = 0.1


class Cell(SkillBench):
    """The scene, and drivers."""

    def __init__(self, clock: FakeClock, physics: bool) -> None:
        super().__init__(SCENE, clock=clock, period=PERIOD)
        self.import_libraries("skiros2_std_skills", "skiros2_sim_skills")
        self.drivers: Any = PhysicalDrivers(SCENE, self.wmi) if physics else StandInDrivers({})

    def add_target(self, pose: Pose) -> Any:
        """A pose in the map."""
        scene = self.wmi.get_element("skiros:Scene-0")
        element = self.add("skiros:TransformationPose", "Reach", scene, "skiros:contain")
        space.set_pose(element, pose)
        self.wmi.update_element_properties(element)
        return self.element("Reach")

    def set_of_arm(self, **properties: str) -> None:
        arm = self.element("Arm")
        for key, value in properties.items():
            arm.setProperty(f"skiros:{key}", value)
        self.wmi.update_element_properties(arm)

    def do(self, **params: Any) -> Any:
        task = self.command("MoveArmCollisionFree", Arm=self.element("Arm"), **params)
        for _ in range(300):
            if task.tick() is not State.Running:
                break
            if isinstance(self.drivers, PhysicalDrivers):
                self.drivers.advance(PERIOD)
        return task

    def why(self, **params: Any) -> str:
        task = self.do(**params)
        assert task.state is State.Failure
        return str(task.why)


@pytest.fixture
def make_cell(fake_clock: FakeClock, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[bool], Cell]]:
    made: list[Cell] = []

    def make(physics: bool = False) -> Cell:
        made.append(Cell(fake_clock, physics))
        install(monkeypatch, made[-1].drivers)
        return made[-1]

    yield make
    for cell in made:
        if isinstance(cell.drivers, PhysicalDrivers):
            cell.drivers.close()


@pytest.fixture
def cell(make_cell: Callable[[bool], Cell]) -> Cell:
    return make_cell(False)


def planned(code: int = 0, text: str = "") -> Any:
    point = JointTrajectoryPoint(positions=[0.1] * 7, time_from_start=rospy.Duration(2))
    trajectory = JointTrajectory(joint_names=[f"panda_joint{i}" for i in range(1, 8)], points=[point])
    result = PlanMotionResult(error_code=code, error_string=text, trajectory=trajectory)
    return lambda goal: (ABORTED if code else SUCCEEDED, result, text)


def test_tool_moves_to_a_pose_behind_a_wall(make_cell: Callable[[bool], Cell]) -> None:
    cell = make_cell(True)
    world = cell.drivers.world
    x, y, _ = world.pose_of("cora:Robot-1").position
    where = cell.add_target(Pose((x + 0.75, y - 0.3, 0.6), DOWN))
    task = cell.do(Target=where)
    assert task.state is State.Success, task.why
    world.add_body(box(WALL, at(x + 0.85, y, 0.45), (0.5, 0.04, 0.9)))
    target = Pose((x + 0.75, y + 0.3, 0.6), DOWN)
    space.set_pose(where, target)
    cell.wmi.update_element_properties(where)
    task = cell.do(Target=cell.element("Reach"), Speed=1.0)
    assert task.state is State.Success, task.why
    assert world.arms[ARM].tool_pose().position == pytest.approx(target.position, abs=0.01)
    assert not world.contacts(WALL)


def test_posture_in_collision_fails_with_the_pair(make_cell: Callable[[bool], Cell]) -> None:
    cell = make_cell(True)
    world = cell.drivers.world
    cell.set_of_arm(Postures='{"low": [0.0, 1.5, 0.0, -0.5, 0.0, 1.4, 0.785]}')
    x, y, _ = world.pose_of("cora:Robot-1").position
    world.add_body(box(WALL, at(x + 0.9, y, 0.35), (0.04, 0.8, 0.7)))
    text = cell.why(Posture="low")
    assert "the goal is in collision" in text
    assert "mobile_manipulator/arm/panda_" in text
    assert WALL in text


def test_planned_trajectory_is_sent_to_the_arm(cell: Cell) -> None:
    cell.drivers.answer(PLANNER, planned())
    task = cell.do(Posture="home", Clearance=0.02, PlanningTime=3.0, Speed=0.4)
    assert task.state is State.Success, task.why
    (goal,) = cell.drivers.sent_to(PLANNER)
    assert list(goal.joint_names) == [f"panda_joint{i}" for i in range(1, 8)]
    assert list(goal.positions) == [0.0, -0.9, 0.0, -2.1, 0.0, 1.4, 0.785]
    assert (goal.clearance, goal.planning_time) == (0.02, 3.0)
    assert (goal.velocity_scaling, goal.acceleration_scaling) == (0.4, 0.4)
    assert goal.target.header.frame_id == ""
    (sent,) = [goal for goal in cell.drivers.sent_to(JOINTS) if goal != "cancel"]
    assert sent.trajectory.points[0].positions == [0.1] * 7


def test_target_is_sent_in_the_frame_of_the_scene(cell: Cell) -> None:
    cell.drivers.answer(PLANNER, planned())
    assert cell.do(Target=cell.add_target(Pose((1.0, 0.5, 0.6), DOWN))).state is State.Success
    (goal,) = cell.drivers.sent_to(PLANNER)
    assert goal.target.header.frame_id == "map"
    assert goal.target.pose.position.y == 0.5
    assert not goal.joint_names


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (PlanMotionGoal.UNREACHABLE, "out of reach of the arm (off by 0.2 m)"),
        (PlanMotionGoal.START_IN_COLLISION, "the arm is in collision (off by 0.2 m)"),
        (PlanMotionGoal.NO_PATH, "no collision-free path was found (off by 0.2 m)"),
    ],
)
def test_failed_plan_fails_with_the_reason_and_moves_nothing(cell: Cell, code: int, text: str) -> None:
    cell.drivers.answer(PLANNER, planned(code, "off by 0.2 m"))
    assert text in cell.why(Posture="home")
    assert not cell.drivers.sent_to(JOINTS)


def test_failed_execution_fails_with_the_reason_of_the_driver(cell: Cell) -> None:
    result = FollowJointTrajectoryResult(error_code=FollowJointTrajectoryResult.PATH_TOLERANCE_VIOLATED)
    cell.drivers.answer(PLANNER, planned())
    cell.drivers.answer(JOINTS, lambda goal: (ABORTED, result, "it touches a person"))
    assert "the arm was blocked on its path (it touches a person)" in cell.why(Posture="home")


def test_posture_and_target_together_or_neither_are_refused(cell: Cell) -> None:
    expected = "expected either a posture or a target"
    assert expected in cell.why()
    assert expected in cell.why(Posture="home", Target=cell.add_target(Pose((1.0, 0.5, 0.6), DOWN)))
    assert "no posture 'unknown'" in cell.why(Posture="unknown")
    assert not cell.drivers.goals


def test_moveit_without_its_messages_fails_with_a_clear_error(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "moveit_msgs.msg", None)
    cell.set_of_arm(MoveItGroup="panda_arm", MotionPlanner="/move_group")
    text = cell.why(Posture="home")
    assert "moveit_msgs is not installed" in text
    assert "skiros:MoveItGroup" in text


class _Message(SimpleNamespace):
    """Stands in for a message of MoveIt: fields are there when they are used."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        value: Any = [] if name.endswith("constraints") or name.startswith("primitive") else _Message()
        setattr(self, name, value)
        return value


@pytest.fixture
def moveit(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> Cell:
    """The scene, with an arm of MoveIt."""
    messages, shapes = ModuleType("moveit_msgs.msg"), ModuleType("shape_msgs.msg")
    names = ("MoveGroupAction", "MoveGroupGoal", "Constraints", "JointConstraint", "PositionConstraint")
    for name in (*names, "OrientationConstraint"):
        setattr(messages, name, type(name, (_Message,), {}))
    shapes.SolidPrimitive = type("SolidPrimitive", (_Message,), {"SPHERE": 2})  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "moveit_msgs.msg", messages)
    monkeypatch.setitem(sys.modules, "shape_msgs.msg", shapes)
    cell.set_of_arm(MoveItGroup="panda_arm", MotionPlanner="/lab/move_group", MoveItTCPLink="panda_tcp")
    return cell


def moved(code: int, status: int = SUCCEEDED) -> Any:
    return lambda goal: (status, SimpleNamespace(error_code=SimpleNamespace(val=code)), "")


def test_moveit_plans_and_executes_a_posture(moveit: Cell) -> None:
    moveit.drivers.answer("/lab/move_group", moved(1))
    task = moveit.do(Posture="home", PlanningTime=2.0)
    assert task.state is State.Success, task.why
    ((name, goal),) = moveit.drivers.goals
    assert name == "/lab/move_group"
    assert (goal.request.group_name, goal.request.allowed_planning_time) == ("panda_arm", 2.0)
    (constraints,) = goal.request.goal_constraints
    assert [c.position for c in constraints.joint_constraints] == [0.0, -0.9, 0.0, -2.1, 0.0, 1.4, 0.785]


def test_moveit_moves_the_tool_link_to_a_target(moveit: Cell) -> None:
    moveit.drivers.answer("/lab/move_group", moved(1))
    assert moveit.do(Target=moveit.add_target(Pose((1.0, 0.5, 0.6), DOWN))).state is State.Success
    (constraints,) = moveit.drivers.goals[0][1].request.goal_constraints
    (place,), (turn,) = constraints.position_constraints, constraints.orientation_constraints
    assert (place.link_name, turn.link_name, place.header.frame_id) == ("panda_tcp", "panda_tcp", "map")
    assert place.constraint_region.primitive_poses[0].position.y == 0.5
    assert turn.orientation.x == 1.0


def test_failure_of_moveit_names_its_code(moveit: Cell) -> None:
    moveit.drivers.answer("/lab/move_group", moved(-12, ABORTED))
    assert "MoveIt ended with error code -12" in moveit.why(Posture="home")
