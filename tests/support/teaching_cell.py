"""A compliant arm and a block in physics, in one process: a scripted hand teaches, skills replay."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_contact_skills.arms import provided_arms
from skiros2_motion.core.arm_kinematics import difference
from skiros2_motion.core.geometry import Pose, composed, inverted
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.scene_reader import load_scene
from skiros2_sim.core.simulated_arm import SimulatedArm
from skiros2_sim.core.simulated_gripper import SimulatedGripper
from skiros2_sim.core.world import World
from skiros2_skill.testing import FakeClock, SkillBench
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_teaching import taught_motions, teach
from skiros2_teaching.grippers import provided_grippers
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel

SCENE = Path(__file__).parents[2] / "skiros2_std_lib" / "skiros2_teaching" / "scene" / "teaching_scene.ttl"
ARM, GRIPPER, BLOCK = "rparts:ArmDevice-2", "rparts:GripperEffector-3", "skiros:Part-5"
SKILLS = (
    teach.teach_release,
    teach.teach_end,
    teach.teach_pose,
    teach.teach_lifting_pose,
    teach.teach_path,
    teach.teach_undo,
    taught_motions.move_to_taught_pose,
    taught_motions.replay_taught_path,
    taught_motions.move_gripper,
)
#: Steps of the world per second, and per tick.
RATE, PER_TICK = 1000, 40


class Hand:
    """Pulls the tool towards a pose that changes over time, with a spring and a damper at the tool."""

    outcome = None

    def __init__(self, world: World, wanted: Callable[[float], Pose]) -> None:
        self._world, self._wanted, self._began = world, wanted, world.time

    def update(self, dt: float) -> None:
        tool, (speed, turn) = self._world.pose_of(GRIPPER), self._world.velocity_of(GRIPPER)
        off = difference(self._wanted(self._world.time - self._began), tool)
        force = np.clip(400.0 * off[:3] - 40.0 * np.array(speed), -40.0, 40.0)
        torque = np.clip(10.0 * off[3:] - np.array(turn), -5.0, 5.0)
        self._world.push(GRIPPER, (*map(float, force),), (*map(float, torque),))


class TeachingCell(SkillBench):
    """The scene with physics, the teaching skills, and a journal for the history."""

    def __init__(self, folder: Path, clock: FakeClock | None = None) -> None:
        self._ends = ExitStack()
        journal = Journal(folder / "wm.journal")
        self._ends.callback(journal.close)
        model = WorldModel(source_ontologies(), SCENE.parent, journal=journal)
        model.load_initial(SCENE.name)
        super().__init__(wmi=LocalWorldModel("teacher", model), clock=clock)
        self.load(*SKILLS)
        self.world = self._ends.enter_context(World(load_scene(SCENE, SCENE.parent), rate=RATE))
        self.controller = ArmController(self.world, next(iter(self.world.robots.values())), self.world.arms[ARM])
        self.driver = SimulatedArm(self.controller)
        self._commands: list[Any] = []
        self._ends.enter_context(provided_arms(self))
        self._ends.enter_context(provided_grippers(self))
        self._running: list[Any] = []

    def close(self) -> None:
        for task in self._running:
            task.preempt()
        self.advance(0.2)
        super().close()
        self._ends.close()

    def arm(self, wmi: WorldModelPort, robot: Element, arm: Element) -> SimulatedArm:
        return self.driver

    def gripper(self, robot: Element, arm: Element, gripper: Element) -> SimulatedGripper:
        return SimulatedGripper(self.world, self.world.grippers[GRIPPER], self._commands)

    # -- the scene ---------------------------------------------------------------------------------------------

    @property
    def block(self) -> Element:
        return self.wmi.get_element(BLOCK)

    def move_block(self, pose: Pose) -> None:
        """Moves the block, in the world and in the world model."""
        self.world.set_pose(BLOCK, pose)
        element = self.block
        space.set_pose(element, pose)
        self.wmi.update_element(element)

    def tool_on_block(self) -> Pose:
        """The true pose of the tool relative to the block."""
        return composed(inverted(self.world.pose_of(BLOCK)), self.world.pose_of(GRIPPER))

    # -- time --------------------------------------------------------------------------------------------------

    def start(self, skill: str, **params: Any) -> Any:
        """Starts a task that `advance` ticks."""
        if skill not in ("TeachUndo",):
            params.setdefault("Arm", self.wmi.get_element(ARM))
        task = self.command(skill, **params)
        self._running.append(task)
        return task

    def advance(self, seconds: float, after_tick: Callable[[], None] = lambda: None) -> None:
        """Lets time pass; ticks all running tasks."""
        for _ in range(round(seconds * RATE / PER_TICK)):
            for task in list(self._running):
                if task.tick() is not State.Running:
                    self._running.remove(task)
            self.world.step(PER_TICK)
            after_tick()

    def end(self, task: Any) -> Any:
        """Stops a task."""
        task.preempt()
        self.advance(0.2)
        assert task.state is State.Failure
        return task

    def done(self, skill: str, after_tick: Callable[[], None] = lambda: None, **params: Any) -> Any:
        """Runs a task to its end, beside the other tasks."""
        task = self.start(skill, **params)
        for _ in range(2000):
            self.advance(PER_TICK / RATE, after_tick)
            if task not in self._running:
                return task
        raise AssertionError(f"{skill} does not end: {task.skill.progress_msg}")

    def taught(self, skill: str, after_tick: Callable[[], None] = lambda: None, **params: Any) -> str:
        """Runs a task, which must succeed, and returns its last message."""
        task = self.done(skill, after_tick, **params)
        assert task.state is State.Success, task.why
        return str(task.skill.progress_msg)

    def refused(self, skill: str, **params: Any) -> str:
        """Runs a task, which must fail, and returns the reason."""
        task = self.done(skill, **params)
        assert task.state is State.Failure
        return str(task.skill.progress_msg)

    def guide(self, wanted: Callable[[float], Pose], seconds: float) -> list[Pose]:
        """Guides the tool by hand for some time. Returns its true poses relative to the block, one for each tick.

        :param wanted: the pose of the tool in the map over time (s).
        """
        hand, poses = Hand(self.world, wanted), [self.tool_on_block()]
        self.world.motions.add(hand)
        self.advance(seconds, lambda: poses.append(self.tool_on_block()))
        self.world.motions.remove(hand)
        return poses


def deviation(poses: list[Pose], others: list[Pose]) -> float:
    """Largest distance from one of the poses to the line through the others (m)."""
    points = np.array([pose.position for pose in others])
    fine = np.linspace(0.0, len(points) - 1.0, 20 * len(points))
    line = np.column_stack([np.interp(fine, np.arange(len(points)), column) for column in points.T])
    return max(float(np.min(np.linalg.norm(line - pose.position, axis=1))) for pose in poses)
