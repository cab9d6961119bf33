"""A simulated arm above a surface, whose contact skills run in this process. The judge is the sum of the engine's
contact forces on the hand, not the sensor of the skills."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.arms import provided_arms
from skiros2_motion.core.compliant_arm import CompliantArm
from skiros2_motion.core.geometry import IDENTITY, Pose, from_euler
from skiros2_sim.core.scene_spec import BodySpec, SceneSpec
from skiros2_sim.core.simulated_arm import SimulatedArm
from skiros2_sim.core.world import World
from skiros2_sim.core.wrist_sensor import EXACT, SensorModel
from skiros2_skill.testing import SkillBench
from skiros2_std_reasoners.core import spatial_data as space
from support.moved_robot import DOWN, MovedRobot

RATE, TICK_RATE = 1000, 25
#: Height of the table of the `bench` (m).
TABLE_TOP = 0.4


class ContactCell:
    """An arm whose tool points down, and the skills that command it.

    :ivar forces: the true force on the hand at each step since the last start of a skill (N).
    :ivar pressed: the part of it along the tool axis.
    :ivar torques: the true torque about that (Nm).
    """

    outcome = None

    def __init__(self, world: World, skills: SkillBench) -> None:
        self.world, self.skills = world, skills
        self.robot = MovedRobot(world)
        self.compliant: CompliantArm = SimulatedArm(self.robot.controller)
        self.element: Element = skills.add("rparts:ArmDevice", "arm", skills.robot, "skiros:hasA")
        for element, pose in ((skills.robot, IDENTITY), (self.element, self.robot.arm.spec.pose)):
            space.set_pose(element, pose)
            skills.wmi.update_element_properties(element)
        self.forces: list[float] = []
        self.pressed: list[float] = []
        self.torques: list[float] = []
        world.motions.add(self)  # type: ignore[arg-type]

    def arm(self, wmi: Any, robot: Element, arm: Element) -> CompliantArm:
        """For `provided_arms`."""
        return self.compliant

    def update(self, dt: float) -> None:
        """Called before each step."""
        wrench = self.robot.arm.wrench()
        self.forces.append(math.hypot(*wrench[:3]))
        self.pressed.append(-wrench[2])
        self.torques.append(wrench[5])

    def place(self, position: Sequence[float]) -> None:
        """Puts the compliant arm at rest with its tool there, pointing down."""
        robot = self.robot
        robot.controller.switch("position")
        x, y, z = position
        solution = robot.controller.kinematics.inverse(Pose((x, y, z), DOWN), np.array(robot.arm.rest))
        assert solution.converged
        for joint, value in zip(robot.arm.joints, solution.positions, strict=True):
            robot.world.physics.set_joint(robot.arm.body, joint.index, value)
        robot.controller.hold()
        robot.controller.switch("compliant")
        self.world.step(200)

    def add_friction(self, torque: float) -> None:
        """Gives each joint Coulomb friction (Nm), which the controller does not know."""
        joints = [joint.index for joint in self.robot.arm.joints]
        none = [0.0] * len(joints)
        self.world.physics.drive_velocities(self.robot.arm.body, joints, none, [torque] * len(joints))

    def run(
        self,
        skill: str,
        seconds: float = 30.0,
        each: Callable[[], None] = lambda: None,
        is_done: Callable[[], bool] = lambda: False,
        **params: Any,
    ) -> Any:
        """Runs a skill to its end, for a time, or until a condition holds after a tick. Returns its task."""
        self.forces.clear()
        self.pressed.clear()
        self.torques.clear()
        task = self.task = self.skills.command(skill, Arm=self.element, **params)
        for _ in range(round(seconds * TICK_RATE)):
            if task.tick() not in (State.Running, State.Idle) or is_done():
                break
            each()
            self.world.step(RATE // TICK_RATE)
        if task.state in (State.Running, State.Idle):
            task.preempt()
            task.tick()
        return task

    @property
    def peak(self) -> float:
        """The largest true force of the last run (N)."""
        return max(self.forces, default=0.0)


@contextmanager
def contact_cell(scene: SceneSpec, *skills: type, sensor: SensorModel = EXACT) -> Iterator[ContactCell]:
    """A cell with these skills, inside the `with` block."""
    with World(scene, rate=RATE, sensor=sensor) as world, SkillBench() as bench:
        bench.load(*skills)
        cell = ContactCell(world, bench)
        with provided_arms(cell):
            yield cell


def slopes(x: float, angles: Sequence[float], length: float, height: float = 0.03) -> list[BodySpec]:
    """Returns fixed plates that follow each other along x on the table, with slopes (rad) and the friction of a cloth.

    :param x: where they begin.
    :param length: of each (m).
    :param height: of the first edge above the table (m).
    """
    z, plates = TABLE_TOP + height, []
    for number, angle in enumerate(angles):
        # ends in a hollow are within the neighbour: a tool would hit them
        before, after = (
            0.004 if 0 <= other < len(angles) and (angles[other] - angle) * way > 0.0 else 0.0
            for other, way in ((number - 1, -1.0), (number + 1, 1.0))
        )
        along = (length + after - before) / 2.0
        dx, dz = math.cos(angle), math.sin(angle)
        middle = (x + along * dx + 0.01 * dz, 0.0, z + along * dz - 0.01 * dx)
        pose, size = Pose(middle, from_euler(0.0, -angle, 0.0)), (length + before + after, 0.3, 0.02)
        plates.append(
            BodySpec(f"demo:Plate-{100 + number}", "demo:Plate", "plate", pose=pose, size=size, friction=0.25)
        )
        x, z = x + length * dx, z + length * dz
    return plates


class Button:
    """A button on the table: its cap, under both open fingers, is moved down against a spring.

    :param stiffness: of the spring (N/m).
    """

    outcome = None
    #: Height of the cap above the table, its travel (m), and the force of the spring at the top (N).
    HEIGHT, TRAVEL, PRELOAD = 0.02, 0.012, 1.0

    def __init__(self, world: World, position: Sequence[float], stiffness: float) -> None:
        self._physics, self._stiffness = world.physics, stiffness
        x, y = position
        text = _BUTTON.format(half=self.HEIGHT / 2.0, travel=self.TRAVEL)
        self.body = self._physics.load_urdf(text, Pose((x, y, TABLE_TOP), IDENTITY.orientation), fixed=True)
        self._physics.drive_velocities(self.body, [0], [0.0], [0.0])
        world.motions.add(self)  # type: ignore[arg-type]

    def update(self, dt: float) -> None:
        """Called before each step: the spring and its damping."""
        (state,) = self._physics.joint_states(self.body, [0])
        force = self.PRELOAD - self._stiffness * state.position - 2.0 * state.velocity
        self._physics.drive_torques(self.body, [0], [force])


_INERTIA = (
    '<inertial><mass value="0.05"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
)
_BUTTON = f"""<robot name="button"><link name="base">{_INERTIA}</link>
<link name="cap">{_INERTIA}<collision><origin xyz="0 0 {{half}}"/><geometry><box size="0.2 0.2 {{half}}"/></geometry>
</collision></link>
<joint name="spring" type="prismatic"><parent link="base"/><child link="cap"/><axis xyz="0 0 1"/>
<origin xyz="0 0 {{half}}"/><limit lower="-{{travel}}" upper="0" effort="100" velocity="10"/></joint></robot>"""


class Nut:
    """A nut on the table, which both open fingers turn by a wing each, and which a torque resists.

    :param resistance: Nm.
    """

    def __init__(self, world: World, position: Sequence[float], resistance: float) -> None:
        self._physics = world.physics
        x, y = position
        self.body = self._physics.load_urdf(_NUT, Pose((x, y, TABLE_TOP), IDENTITY.orientation), fixed=True)
        self._physics.drive_velocities(self.body, [0], [0.0], [resistance])

    def angle(self) -> float:
        """How far it was turned (rad)."""
        return float(self._physics.joint_states(self.body, [0])[0].position)


_WING = '<collision><origin xyz="{x} {y} 0.035"/><geometry><box size="0.01 0.04 0.05"/></geometry></collision>'
_NUT = f"""<robot name="nut"><link name="base">{_INERTIA}</link>
<link name="nut">{_INERTIA}<collision><origin xyz="0 0 0.005"/><geometry><box size="0.15 0.15 0.01"/></geometry>
</collision>{_WING.format(x=0.03, y=0.05)}{_WING.format(x=-0.03, y=-0.05)}</link>
<joint name="thread" type="continuous"><parent link="base"/><child link="nut"/><axis xyz="0 0 1"/></joint></robot>"""
