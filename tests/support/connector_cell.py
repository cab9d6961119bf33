"""The connector cell in physics in this process: one arm holds the housing on the work place, the other one the plug
above its socket."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_contact_skills import contact_motions, force_motions, free_motions, plugging
from skiros2_contact_skills.core.part_poses import aligned_tool, depth_and_tilt
from skiros2_motion.core.geometry import IDENTITY, Pose, composed, inverted
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.cartesian_motion import CartesianGoal, CartesianMotion
from skiros2_sim.core.scene_reader import load_scene
from skiros2_sim.core.scene_spec import SceneSpec
from skiros2_sim.core.simulated_arm import SimulatedArm
from skiros2_sim.core.world import World
from skiros2_skill.testing import SkillBench
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.places import move_in_world_model

SCENE = Path(__file__).parents[2] / "skiros2_std_lib/demos/connector/scene/connector_scene.ttl"
LEFT, RIGHT = "rparts:ArmDevice-2", "rparts:ArmDevice-3"
PLUG, HOUSING, SOCKET, PLACE = "connector:Plug-20", "connector:Housing-22", "skiros:Bore-23", "connector:WorkPlace-11"
#: Steps of the world per second, and ticks of the trees.
RATE, TICK_RATE = 1000, 25
#: Height of the plug above the socket at the start (m), and opening of the fingers before they grip (m).
_ABOVE, _OPEN = 0.02, 0.06


class ConnectorCell:
    """World, world model and skills. The world is reset; what is gripped is gripped in the world model, too."""

    def __init__(self, world: World, bench: SkillBench) -> None:
        world.reset(0)
        self.world, self.bench, self.wmi = world, bench, bench.wmi
        self._arms = {arm: ArmController(world, world.robots["cora:Robot-1"], world.arms[arm]) for arm in (LEFT, RIGHT)}
        self._compliant = {arm: SimulatedArm(controller) for arm, controller in self._arms.items()}
        for module in (contact_motions, force_motions, free_motions, plugging):
            skills = [value for name, value in vars(module).items() if name.islower() and _is_skill(value)]
            bench.load(*(skill for skill in skills if skill is not plugging.connect_plug))
        self._grip(HOUSING, LEFT, "skiros:GraspingPose-24", self._on_place())
        rim = composed(self._on_place(), space.pose_of(self.wmi.get_element(SOCKET)) or IDENTITY)
        grasp = space.pose_of(self.wmi.get_element("skiros:GraspingPose-21")) or IDENTITY
        end = composed(inverted(grasp), Pose((0.0, 0.0, -0.045), IDENTITY.orientation))
        tool = aligned_tool(world.arms[RIGHT].tool_pose(), end, rim, _ABOVE)
        self._grip(PLUG, RIGHT, "skiros:GraspingPose-21", composed(tool, inverted(grasp)))
        self.most = {LEFT: 0.0, RIGHT: 0.0}

    def arm(self, wmi: WorldModelPort, robot: Element, arm: Element) -> SimulatedArm:
        return self._compliant[arm.id]

    def command(self, skill: str, arm: str = RIGHT, **params: Any) -> Any:
        return self.bench.command(skill, Arm=self.wmi.get_element(arm), **params)

    def plug_into_socket(self) -> Any:
        self._compliant[RIGHT].begin()
        self._compliant[RIGHT].zero_sensor()
        parts = {"Part": self.wmi.get_element(PLUG), "Socket": self.wmi.get_element(SOCKET)}
        return self.command("PlugIntoSocket", **parts)

    def hold(self) -> Any:
        """Returns the task of the other arm."""
        return self.command("HoldPose", LEFT, **plugging.HOLD)

    def run(self, *tasks: Any, seconds: float = 20.0) -> Any:
        """Ticks until the first task ends; returns it."""
        for _ in range(round(seconds * TICK_RATE)):
            for task in tasks:
                task.tick()
            if tasks[0].state is not State.Running:
                break
            for _ in range(RATE // TICK_RATE // 4):
                self.world.step(4)
                for arm in self.most:
                    self.most[arm] = max(self.most[arm], force(self.world.arms[arm].measured_wrench()))
        return tasks[0]

    def depth(self) -> float:
        """Returns the true depth of the plug below the rim of the socket (m)."""
        rim = composed(self.world.pose_of(HOUSING), space.pose_of(self.wmi.get_element(SOCKET)) or IDENTITY)
        return depth_and_tilt(rim, self.world.pose_of(PLUG), 0.09)[0]

    def misplace(self, x: float, y: float) -> None:
        """Displaces the housing in the world model (m); the true one stays."""
        housing = self.wmi.get_element(HOUSING)
        (px, py, pz), orientation = space.pose_of(housing) or IDENTITY
        space.set_pose(housing, Pose((px + x, py + y, pz), orientation))
        self.wmi.update_element_properties(housing)

    def _on_place(self) -> Pose:
        return composed(self.world.pose_of(PLACE), Pose((0.0, 0.0, 0.045), IDENTITY.orientation))

    def _grip(self, part: str, arm: str, grasp: str, at: Pose) -> None:
        """Puts a part somewhere and grips it there."""
        world, on_part = self.world, space.pose_of(self.wmi.get_element(grasp)) or IDENTITY
        gripper = world.arms[arm].gripper
        assert gripper is not None
        gripper.drive(_OPEN)
        motion = CartesianMotion(self._arms[arm], CartesianGoal(composed(at, on_part), speed=0.5))
        world.motions.add(motion)
        while motion.outcome is None:
            world.step()
        assert not motion.outcome.text, motion.outcome
        gripper.drive(0.0, 40.0)
        for _ in range(RATE // 3):
            world.set_pose(part, at)
            world.step()
        world.step(RATE // 3)
        hand = self.wmi.get_element(gripper.id)  # on a robot, tf moves it
        space.set_pose(hand, composed(inverted(world.pose_of(arm)), world.arms[arm].tool_pose()))
        self.wmi.update_element_properties(hand)
        held = composed(inverted(world.arms[arm].tool_pose()), world.pose_of(part))
        move_in_world_model(self.wmi, self.wmi.get_element(part), hand, held)


def connector_scene(**latch: float) -> SceneSpec:
    """Returns the scene.

    :param latch: numbers of `Latch` that the true latch has, in place of those in the world model.
    """
    scene = load_scene(SCENE, SCENE.parent)

    def changed(bore: Any) -> Any:
        return replace(bore, latch=replace(bore.latch, **latch)) if bore.latch else bore

    bodies = tuple(replace(body, bores=tuple(map(changed, body.bores))) for body in scene.bodies)
    return replace(scene, bodies=bodies)


def force(wrench: Sequence[float]) -> float:
    return float(sum(part * part for part in wrench[:3]) ** 0.5)


def _is_skill(value: Any) -> bool:
    return isinstance(value, type) and hasattr(value, "setDescription")
