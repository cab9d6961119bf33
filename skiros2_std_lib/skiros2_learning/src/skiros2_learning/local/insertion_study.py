"""Insertions in physics in this process, without ROS: for benchmarks, learning and tests.

One run is a function of its seed, errors and parameters, and is the same bit by bit each time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace, TracebackType
from typing import Any

import numpy as np

import skiros2_contact_skills
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, UnknownName
from skiros2_common.core.signals import Signal
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_contact_skills import contact_motions, free_motions, insertion
from skiros2_contact_skills.arms import provided_arms
from skiros2_contact_skills.core.part_poses import aligned_tool, depth_and_tilt
from skiros2_motion.core.geometry import IDENTITY, Pose, composed, inverted, multiplied
from skiros2_motion.core.motion import State as MotionState
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.cartesian_motion import CartesianGoal, CartesianMotion
from skiros2_sim.core.scene_reader import load_scene
from skiros2_sim.core.scene_spec import SceneSpec
from skiros2_sim.core.simulated_arm import SimulatedArm
from skiros2_sim.core.world import World
from skiros2_sim.core.wrist_sensor import EXACT, SensorModel
from skiros2_skill.testing import SkillBench
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.places import move_in_world_model

#: Of the sources, or else of the installed package.
SCENE = next(
    file
    for folder in Path(skiros2_contact_skills.__file__).parents
    for place in ("demos/piston", "share/skiros2_piston_demo")
    if (file := folder / place / "scene/piston_scene.ttl").exists()
)
ROBOT, ARM, GRIPPER = "cora:Robot-1", "rparts:ArmDevice-3", "rparts:GripperEffector-5"
BLOCK, PISTON, GRASP = "piston:EngineBlock-11", "piston:Piston-20", "skiros:GraspingPose-21"
BORES = ("skiros:Bore-12", "skiros:Bore-13", "skiros:Bore-14", "skiros:Bore-15")
BORE, BENCH = BORES[1], "skiros:Location-10"

#: Steps of the world per second, and ticks of the tree.
RATE, TICK_RATE = 1000, 25
#: Height of the piston above the rim at the start (m), and the longest run (s).
_START_HEIGHT, _LONGEST = 0.02, 60.0
#: Time for closing the fingers, and for settling (s).
_GRIP_TIME = 0.3
_MODULES = (free_motions, contact_motions, insertion)


@dataclass(frozen=True)
class InsertionRun:
    """The result of one insertion, by the simulator's truth.

    :param success: whether the piston is as deep as wanted, within 1 mm, and the task has succeeded.
    :param depth: of the lower end of the piston below the rim (m).
    :param tilt: between the axes of piston and bore (rad).
    :param max_force: largest force measured at the wrist (N).
    :param time: simulated duration (s).
    :param why: why the task failed.
    :param profile: time (s), depth (m), and maximum force since the last tick (N), at each tick.
    """

    success: bool
    depth: float
    tilt: float
    max_force: float
    time: float
    why: str = ""
    profile: tuple[tuple[float, float, float], ...] = field(default=(), repr=False)


class InsertionStudy:
    """A world with an arm that holds a piston above a bore. A context manager.

    :param sensor: errors of the force/torque sensor.
    """

    def __init__(self, sensor: SensorModel = EXACT) -> None:
        self.world = World(_only_needed(load_scene(SCENE, SCENE.parent)), rate=RATE, sensor=sensor)

    def __enter__(self) -> InsertionStudy:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.world.close()

    def run(
        self,
        seed: int,
        position_error: float = 0.0,
        angle_error: float = 0.0,
        skill: str = "insert_into_bore",
        parameters: dict[str, dict[str, Any]] | None = None,
        time_limit: float = _LONGEST,
    ) -> InsertionRun:
        """Runs one insertion from the start.

        :param seed: of the directions of the errors and of the noise of the sensor.
        :param position_error: between the estimated and the true position of the bore, across its axis (m).
        :param angle_error: between the estimated and the true axis of the bore (rad).
        :param skill: implementation of `skiros:InsertIntoBore`.
        :param parameters: values by implementation and key, in place of defaults: {"insert_part": {"Force": 15.0}}.
        :param time_limit: simulated time after which the run ends (s).
        """
        world = self.world
        world.reset(seed)
        arm = world.arms[ARM]
        controller = ArmController(world, world.robots[ROBOT], arm)
        compliant = SimulatedArm(controller)
        with SkillBench(SCENE) as bench, provided_arms(_OneArm(compliant)):
            bench.load(*insertion_skills(skill, parameters))
            _hold_piston(world, controller, bench.wmi)
            _misplace(bench.wmi, np.random.default_rng(seed), position_error, angle_error)
            recorder = _Recorder(world)
            task = bench.command(
                "InsertIntoBore",
                skill,
                Arm=bench.wmi.get_element(ARM),
                Part=bench.wmi.get_element(PISTON),
                Bore=bench.wmi.get_element(BORE),
            )
            began = world.time
            compliant.begin()
            compliant.zero_sensor()
            world.motions.add(recorder)
            (signal,) = (Signal.of(e) for e in bench.wmi.get_branch(ARM) if e.type == "skiros:WristForce")
            while task.state in (State.Running, State.Idle) and world.time < began + time_limit:
                bench.signals.publish(signal.topic, _message(arm.measured_wrench()))
                task.tick()
                world.step(RATE // TICK_RATE)
                recorder.note()
            ended = world.time - began
            world.motions.remove(recorder)
            depth, tilt = piston_in_bore(world)
            wanted = float(bench.wmi.get_element(BORE).value_of("skiros:Depth"))
            success = task.state is State.Success and depth > wanted - 0.001
            why = ""
            if task.state in (State.Running, State.Idle):
                why = f"not finished after {time_limit:g} s"
            elif task.state is not State.Success:
                why = "\n".join(map(str, task.explanations()))
            return InsertionRun(success, depth, tilt, recorder.max_force, ended, why, tuple(recorder.profile))


def piston_in_bore(world: World, piston: str = PISTON, bore: str = BORE) -> tuple[float, float]:
    """Returns the true depth of the lower end of the piston below the rim (m), and its tilt in the bore (rad).

    :raises UnknownName: one of them is not in the world.
    """
    return depth_and_tilt(rim_pose(world, bore), world.pose_of(piston), _piston_size(world, piston)[2])


def rim_pose(world: World, bore: str) -> Pose:
    """Returns the true pose of the rim of a bore of the engine block, in the map."""
    spec = world.bodies[BLOCK].spec
    number = int(bore.rpartition("-")[2]) - int(BORES[0].rpartition("-")[2])
    hole, size = spec.bores[number], spec.size
    assert size is not None
    return composed(world.pose_of(BLOCK), Pose((hole.x, hole.y, size[2] / 2.0), IDENTITY.orientation))


class _OneArm:
    """The arm of the study."""

    def __init__(self, arm: SimulatedArm) -> None:
        self._arm = arm

    def arm(self, wmi: WorldModelPort, robot: Element, arm: Element) -> SimulatedArm:
        return self._arm


class _Recorder:
    """Measures the force at the wrist after each step, and notes depth and maximum force since the last note."""

    outcome = None

    def __init__(self, world: World) -> None:
        self._world = world
        self.max_force = 0.0
        self.profile: list[tuple[float, float, float]] = []
        self._start = world.time
        self._force = 0.0

    def update(self, dt: float) -> None:
        """Called before each step."""
        self._force = max(self._force, math.hypot(*self._world.arms[ARM].measured_wrench()[:3]))
        self.max_force = max(self.max_force, self._force)

    def note(self) -> None:
        """Notes the present depth and force."""
        self.profile.append((self._world.time - self._start, piston_in_bore(self._world)[0], self._force))
        self._force = 0.0


def _message(wrench: Sequence[float]) -> SimpleNamespace:
    """Returns what a driver publishes: an object like `geometry_msgs/WrenchStamped`."""
    force, torque = (SimpleNamespace(x=v[0], y=v[1], z=v[2]) for v in (wrench[:3], wrench[3:]))
    return SimpleNamespace(wrench=SimpleNamespace(force=force, torque=torque))


def _only_needed(scene: SceneSpec) -> SceneSpec:
    """Returns the scene with bench, block, piston and one arm; what is not needed costs time."""
    bodies = tuple(
        replace(body, movable=body.id == PISTON) for body in scene.bodies if body.id in (BENCH, BLOCK, PISTON)
    )
    robots = tuple(replace(r, arms=tuple(a for a in r.arms if a.id == ARM)) for r in scene.robots)
    return replace(scene, bodies=bodies, robots=robots)


def _hold_piston(world: World, controller: ArmController, wmi: WorldModelPort) -> None:
    """Moves the tool above the bore and puts the piston between the fingers, also in the world model."""
    grasp = space.pose_of(wmi.get_element(GRASP)) or IDENTITY
    end = composed(inverted(grasp), Pose((0.0, 0.0, -0.05), IDENTITY.orientation))
    tool = aligned_tool(world.arms[ARM].tool_pose(), end, rim_pose(world, BORE), _START_HEIGHT)
    gripper = world.grippers[GRIPPER]
    gripper.drive(0.03)
    motion = CartesianMotion(controller, CartesianGoal(tool, speed=0.5))
    world.motions.add(motion)
    while motion.outcome is None:
        world.step()
    if motion.outcome.state is not MotionState.SUCCEEDED:
        raise Refused(f"the arm cannot hold the piston above the bore: {motion.outcome.text}")
    gripper.drive(0.0)
    for _ in range(round(_GRIP_TIME * RATE)):
        world.set_pose(PISTON, composed(world.arms[ARM].tool_pose(), inverted(grasp)))
        world.step()
    world.step(round(_GRIP_TIME * RATE))
    held = composed(inverted(world.arms[ARM].tool_pose()), world.pose_of(PISTON))
    move_in_world_model(wmi, wmi.get_element(PISTON), wmi.get_element(GRIPPER), held)


def _misplace(wmi: WorldModelPort, random: np.random.Generator, far: float, turn: float) -> None:
    """Gives the engine block in the world model a wrong pose: the rim is displaced across its axis, which is tilted."""
    across, about = random.uniform(0.0, 2.0 * math.pi, 2)
    block = wmi.get_element(BLOCK)
    rim = space.pose_of(wmi.get_element(BORE))
    pose = space.pose_of(block)
    assert rim is not None and pose is not None
    half = math.sin(turn / 2.0)
    tilt = (half * math.cos(about), half * math.sin(about), 0.0, math.cos(turn / 2.0))
    true_rim = composed(pose, rim)
    x, y, z = true_rim.position
    wrong = Pose((x + far * math.cos(across), y + far * math.sin(across), z), multiplied(tilt, true_rim.orientation))
    space.set_pose(block, composed(wrong, inverted(rim)))
    wmi.update_element_properties(block)


def insertion_skills(
    skill: str = "insert_into_bore", parameters: dict[str, dict[str, Any]] | None = None
) -> list[type]:
    """Returns the implementations of an insertion, with other defaults where parameters are given.

    :param skill, parameters: as of `InsertionStudy.run`.
    :raises UnknownName: there are parameters of another skill.
    """
    parameters = parameters or {}
    names = [skill, "approach_target", "move_until_contact", "spiral_search", "insert_part"]
    known = {name: getattr(module, name) for name in names for module in _MODULES if hasattr(module, name)}
    if unknown := sorted(set(parameters) - set(known)):
        raise UnknownName(f"parameters of {', '.join(unknown)}: the skills are {', '.join(known)}")
    return [_with_defaults(cls, parameters.get(name, {})) for name, cls in known.items()]


def _with_defaults(cls: type, values: dict[str, Any]) -> type:
    def declare(self: Any) -> None:
        cls.createDescription(self)  # type: ignore[attr-defined]
        for key, value in values.items():
            self.specifyParamDefault(key, value)

    return type(cls.__name__, (cls,), {"createDescription": declare}) if values else cls


def _piston_size(world: World, piston: str) -> tuple[float, float, float]:
    size = world.bodies[piston].spec.size
    assert size is not None
    return size
