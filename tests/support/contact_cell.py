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
from skiros2_motion.core.geometry import IDENTITY, Pose
from skiros2_sim.core.scene_spec import SceneSpec
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

    :ivar forces: the true force on the hand along z of the map at each step since the last start of a skill (N).
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
        world.motions.add(self)  # type: ignore[arg-type]

    def arm(self, wmi: Any, robot: Element, arm: Element) -> CompliantArm:
        """For `provided_arms`."""
        return self.compliant

    def update(self, dt: float) -> None:
        """Called before each step."""
        self.forces.append(math.hypot(*self.robot.arm.wrench()[:3]))

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

    def run(self, skill: str, seconds: float = 30.0, each: Callable[[], None] = lambda: None, **params: Any) -> Any:
        """Runs a skill to its end, or for a time. Returns its task."""
        self.forces.clear()
        task = self.skills.command(skill, Arm=self.element, **params)
        for _ in range(round(seconds * TICK_RATE)):
            if task.tick() not in (State.Running, State.Idle):
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
