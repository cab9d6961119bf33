"""Insertions in physics in this process, without ROS: for benchmarks, learning and tests.

One run is a function of its seed, errors and parameters, and is the same bit by bit each time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
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
from skiros2_sim.core.gripper import Gripper
from skiros2_sim.core.scene_reader import load_scene
from skiros2_sim.core.scene_spec import SceneSpec
from skiros2_sim.core.simulated_arm import SimulatedArm
from skiros2_sim.core.world import World
from skiros2_sim.core.wrist_sensor import EXACT, SensorModel
from skiros2_skill.testing import BenchTask, SkillBench
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.places import move_in_world_model
from skiros2_std_reasoners.core.scene_poses import size_of

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
#: Tolerance of the depth of a successful insertion, and distance of the open fingers (m).
_DEEP, _OPEN = 0.001, 0.03
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
    :param reported: whether the task has succeeded, whatever is true.
    :param evidence: the result `Evidence` of the insertion; empty without one.
    """

    success: bool
    depth: float
    tilt: float
    max_force: float
    time: float
    why: str = ""
    profile: tuple[tuple[float, float, float], ...] = field(default=(), repr=False)
    reported: bool = False
    evidence: dict[str, Any] = field(default_factory=dict)


class InsertionStudy:
    """A world with an arm that holds a part above a bore. A context manager.

    :param scene: Turtle file; ontologies and models are in its folder.
    :param arm: id of an arm with a gripper, which starts in its posture `start` or that of its model. Other arms are
        not simulated.
    :param bore: id of a bore of a body.
    :param part: id of a part with a grasping pose. Other movable things are not simulated.
    :param sensor: errors of the force/torque sensor.
    :raises UnknownName: the scene has no such arm, or the arm has no model.
    """

    def __init__(
        self,
        scene: Path = SCENE,
        arm: str = ARM,
        bore: str = BORE,
        *,
        part: str = PISTON,
        sensor: SensorModel = EXACT,
    ) -> None:
        self._scene, self._arm, self._bore, self._part = scene, arm, bore, part
        spec = load_scene(scene, scene.parent)
        with SkillBench(scene) as bench:
            (owner,) = bench.wmi.get_element(bore).getRelations("", "skiros:hasA", "-1")
            self._owner = str(owner["src"])
            (self._grasp,) = (e.id for e in bench.wmi.get_branch(part) if e.type == "skiros:GraspingPose")
            self._rim = space.pose_of(bench.wmi.get_element(bore)) or IDENTITY
        self.world = World(_only_needed(spec, arm, self._owner, part), rate=RATE, sensor=sensor)
        if arm not in self.world.arms or self.world.arms[arm].gripper is None:
            known = ", ".join(self.world.arms) or "; ".join(map(str, self.world.problems))
            raise UnknownName(f"{scene}: expected an arm with a gripper, got {arm}: {known}")

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
        disturb: Callable[[InsertionStudy, float], None] | None = None,
    ) -> InsertionRun:
        """Runs one insertion from the start.

        :param seed: of the directions of the errors and of the noise of the sensor.
        :param position_error: between the estimated and the true position of the bore, across its axis (m).
        :param angle_error: between the estimated and the true axis of the bore (rad).
        :param skill: implementation of `skiros:InsertIntoBore`.
        :param parameters: values by implementation and key, in place of defaults: {"insert_part": {"Force": 15.0}}.
        :param time_limit: simulated time after which the run ends (s).
        :param disturb: called after each tick with the study and the time since the start (s).
        :raises Refused: the arm does not reach the start.
        """
        world = self.world
        world.reset(seed)
        arm = world.arms[self._arm]
        controller = ArmController(world, next(iter(world.robots.values())), arm)
        compliant = SimulatedArm(controller)
        gripper = arm.gripper
        assert gripper is not None
        with SkillBench(self._scene) as bench, provided_arms(_OneArm(compliant, gripper)):
            bench.load(*insertion_skills(skill, parameters))
            self._hold_part(controller, gripper, bench.wmi)
            self._misplace(bench.wmi, np.random.default_rng(seed), position_error, angle_error)
            recorder = _Recorder(self)
            task = bench.command(
                "InsertIntoBore",
                skill,
                Arm=bench.wmi.get_element(self._arm),
                Part=bench.wmi.get_element(self._part),
                Bore=bench.wmi.get_element(self._bore),
            )
            began = world.time
            compliant.begin()
            compliant.zero_sensor()
            world.motions.add(recorder)
            (signal,) = (Signal.of(e) for e in bench.wmi.get_branch(self._arm) if e.type == "skiros:WristForce")
            while task.state in (State.Running, State.Idle) and world.time < began + time_limit:
                bench.signals.publish(signal.topic, _message(arm.measured_wrench()))
                task.tick()
                world.step(RATE // TICK_RATE)
                recorder.note()
                if disturb is not None:
                    disturb(self, world.time - began)
            ended = world.time - began
            world.motions.remove(recorder)
            depth, tilt = self.part_in_bore()
            wanted = float(bench.wmi.get_element(self._bore).value_of("skiros:Depth"))
            has_succeeded = task.state is State.Success
            why = ""
            if task.state in (State.Running, State.Idle):
                why = f"not finished after {time_limit:g} s"
            elif not has_succeeded:
                why = "\n".join(map(str, task.explanations()))
            return InsertionRun(
                has_succeeded and depth > wanted - _DEEP,
                depth,
                tilt,
                recorder.max_force,
                ended,
                why,
                tuple(recorder.profile),
                has_succeeded,
                _evidence(task),
            )

    def part_in_bore(self) -> tuple[float, float]:
        """Returns the true depth of the lower end of the part below the rim (m), and its tilt in the bore (rad)."""
        size = self.world.bodies[self._part].spec.size
        assert size is not None
        return depth_and_tilt(self.rim_pose(), self.world.pose_of(self._part), size[2])

    def rim_pose(self) -> Pose:
        """Returns the true pose of the rim of the bore, in the map."""
        return composed(self.world.pose_of(self._owner), self._rim)

    def _hold_part(self, controller: ArmController, gripper: Gripper, wmi: WorldModelPort) -> None:
        """Moves the tool above the bore and puts the part between the fingers, also in the world model."""
        world, part, arm = self.world, self._part, controller.arm
        grasp = space.pose_of(wmi.get_element(self._grasp)) or IDENTITY
        lower = Pose((0.0, 0.0, -size_of(wmi.get_element(part))[2] / 2.0), IDENTITY.orientation)
        tool = aligned_tool(arm.tool_pose(), composed(inverted(grasp), lower), self.rim_pose(), _START_HEIGHT)
        gripper.drive(_OPEN)
        motion = CartesianMotion(controller, CartesianGoal(tool, speed=0.5))
        world.motions.add(motion)
        while motion.outcome is None:
            world.step()
        if motion.outcome.state is not MotionState.SUCCEEDED:
            raise Refused(f"the arm cannot hold the part above the bore: {motion.outcome.text}")
        gripper.drive(0.0)
        for _ in range(round(_GRIP_TIME * RATE)):
            world.set_pose(part, composed(arm.tool_pose(), inverted(grasp)))
            world.step()
        world.step(round(_GRIP_TIME * RATE))
        held = composed(inverted(arm.tool_pose()), world.pose_of(part))
        move_in_world_model(wmi, wmi.get_element(part), wmi.get_element(gripper.id), held)

    def _misplace(self, wmi: WorldModelPort, random: np.random.Generator, far: float, turn: float) -> None:
        """Gives the owner of the bore in the world model a wrong pose: the rim is displaced across its axis, which is
        tilted."""
        across, about = random.uniform(0.0, 2.0 * math.pi, 2)
        owner = wmi.get_element(self._owner)
        pose = space.pose_of(owner)
        assert pose is not None
        half = math.sin(turn / 2.0)
        tilt = (half * math.cos(about), half * math.sin(about), 0.0, math.cos(turn / 2.0))
        true_rim = composed(pose, self._rim)
        x, y, z = true_rim.position
        off = far * math.cos(across), far * math.sin(across)
        wrong = Pose((x + off[0], y + off[1], z), multiplied(tilt, true_rim.orientation))
        space.set_pose(owner, composed(wrong, inverted(self._rim)))
        wmi.update_element_properties(owner)


def _evidence(task: BenchTask) -> dict[str, Any]:
    """Returns the evidence of the last insertion of a task."""
    found = [node.params["Evidence"].values for node in task.nodes() if "Evidence" in node.params]
    return dict(found[-1][0]) if found and found[-1] else {}


class _OneArm:
    """The arm of the study, with its fingers."""

    def __init__(self, arm: SimulatedArm, gripper: Gripper) -> None:
        self._arm, self._gripper = arm, gripper

    def width(self, wmi: WorldModelPort, robot: Element, gripper: Element) -> float | None:
        return self._gripper.width()

    def arm(self, wmi: WorldModelPort, robot: Element, arm: Element) -> SimulatedArm:
        return self._arm


class _Recorder:
    """Measures the force at the wrist after each step, and notes depth and maximum force since the last note."""

    outcome = None

    def __init__(self, study: InsertionStudy) -> None:
        self._study = study
        (self._arm,) = study.world.arms.values()
        self.max_force = 0.0
        self.profile: list[tuple[float, float, float]] = []
        self._start = study.world.time
        self._force = 0.0

    def update(self, dt: float) -> None:
        """Called before each step."""
        self._force = max(self._force, math.hypot(*self._arm.measured_wrench()[:3]))
        self.max_force = max(self.max_force, self._force)

    def note(self) -> None:
        """Notes the present depth and force."""
        self.profile.append((self._study.world.time - self._start, self._study.part_in_bore()[0], self._force))
        self._force = 0.0


def _message(wrench: Sequence[float]) -> SimpleNamespace:
    """Returns what a driver publishes: an object like `geometry_msgs/WrenchStamped`."""
    force, torque = (SimpleNamespace(x=v[0], y=v[1], z=v[2]) for v in (wrench[:3], wrench[3:]))
    return SimpleNamespace(wrench=SimpleNamespace(force=force, torque=torque))


def _only_needed(scene: SceneSpec, arm: str, owner: str, part: str) -> SceneSpec:
    """Returns the scene with what stands fixed, the owner of the bore, the part and one arm; the rest costs time."""
    bodies = tuple(
        replace(body, movable=body.id == part)
        for body in scene.bodies
        if body.id in (owner, part) or body.type == "skiros:Location"
    )
    robots = tuple(replace(r, arms=tuple(a for a in r.arms if a.id == arm)) for r in scene.robots)
    return replace(scene, bodies=bodies, robots=tuple(r for r in robots if r.arms))


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
