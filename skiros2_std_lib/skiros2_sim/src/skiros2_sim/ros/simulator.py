"""The simulator node: the simulated world with the interfaces of real robots."""

from __future__ import annotations

import logging
from pathlib import Path

import rospy
from move_base_msgs.msg import MoveBaseAction, MoveBaseResult

from control_msgs.msg import FollowJointTrajectoryAction, GripperCommandAction, GripperCommandResult
from skiros2_common.core.errors import Refused
from skiros2_common.core.operations import SCENE
from skiros2_common.ros.node import spin
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.planning_scene import PlanningScene
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.scene_reader import read_scene
from skiros2_sim.core.scene_spec import SceneSpec
from skiros2_sim.core.stepper import Stepper
from skiros2_sim.core.world import World
from skiros2_sim.ros.compliant import CompliantArm
from skiros2_sim.ros.controllers import Controllers
from skiros2_sim.ros.device_server import Device, DeviceServer
from skiros2_sim.ros.frames import Frames
from skiros2_sim.ros.jobs import (
    BaseJob,
    CartesianJob,
    GripperJob,
    JointJob,
    TrajectoryJob,
    refused_motion,
    refused_reference_motion,
    refused_trajectory,
)
from skiros2_sim.ros.options import Options, read_options
from skiros2_sim.ros.planning import PlanningJob, refused_plan
from skiros2_sim.ros.publishers import Cameras, SimulatedClock, StatePublisher
from skiros2_sim.ros.services import Services
from skiros2_sim_msgs.msg import CartesianMotionAction, CartesianTrajectoryAction, PlanMotionAction
from skiros2_std_skills.core import driver_names as names
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.ros.ontology_server import ontology_folder

log = logging.getLogger(__name__)


class Simulator:
    """A stepped world with its ROS interfaces.

    :param world: owned by the simulator.
    :param stepper: steps the world; not started yet.
    :param ontology: knows the classes of bodies.
    """

    def __init__(self, world: World, stepper: Stepper, ontology: Ontology, options: Options) -> None:
        self._world = world
        self._stepper = stepper
        self._clock = SimulatedClock(stepper)
        self._frames = Frames(world)
        self._arms: dict[str, ArmController] = {}
        self._make_controllers(world)
        self._planning_scene = PlanningScene(world.scene)
        self._devices = {arm: Device(f"arm {arm}") for arm in world.arms}
        self._servers = [server for robot in world.robots.values() for server in self._servers_of(robot)]
        self._controllers = [
            Controllers(robot.spec, stepper, self._arms, self._devices) for robot in world.robots.values()
        ]
        self._compliant_arms = [
            CompliantArm(
                robot.spec,
                arm,
                stepper,
                self._clock,
                self._frames,
                self._arms,
                self._devices[arm.id],
                options.wrench_timeout,
            )
            for robot in world.robots.values()
            for arm in robot.spec.arms
            if arm.id in robot.arms
        ]
        self._state_publisher = StatePublisher(world, stepper, self._clock, self._frames)
        self._cameras = Cameras(world, stepper, self._clock, self._frames, options.camera_rate, options.depth_noise)
        stepper.add_hook(self._state_publisher.after_step)
        stepper.add_hook(self._cameras.after_step)
        for arm in self._compliant_arms:
            stepper.add_hook(arm.after_step)
            stepper.add_idle_hook(arm.while_paused)
        self._services = Services(
            stepper,
            self._clock,
            self._frames,
            ontology,
            options.detection,
            options.noise,
            self._reset,
            self._state_publisher.publish_all,
        )

    def start(self) -> None:
        """Starts stepping and accepting goals."""
        for robot in self._world.robots.values():
            rospy.set_param(f"/{robot.name}/robot_description", robot.urdf)
            rospy.set_param(f"/{robot.name}/tf_prefix", robot.name)
        self._state_publisher.publish_all()
        self._stepper.start()
        for server in self._servers:
            server.start()
        self._services.start()  # last: clients that wait for a service find everything

    def close(self) -> None:
        """Stops the world; active goals are aborted."""
        self._services.close()
        for interface in (*self._controllers, *self._compliant_arms):
            interface.close()
        self._stepper.close()
        for server in self._servers:
            server.close()
        self._planning_scene.close()

    def _make_controllers(self, world: World) -> None:
        for robot in world.robots.values():
            for eid, arm in robot.arms.items():
                self._arms[eid] = ArmController(world, robot, arm)

    def _servers_of(self, robot: Robot) -> list[DeviceServer]:
        servers = []
        spec, stepper, clock, frames = robot.spec, self._stepper, self._clock, self._frames
        if robot.mobile:
            servers.append(
                DeviceServer(
                    spec.move_action,
                    MoveBaseAction,
                    stepper,
                    Device(f"base of {robot.id}"),
                    lambda goal: BaseJob(goal, robot.id, clock, frames),
                    lambda text: MoveBaseResult(),
                )
            )
        for eid in robot.arms:
            servers += self._servers_of_arm(robot, eid)
        return servers

    def _servers_of_arm(self, robot: Robot, eid: str) -> list[DeviceServer]:
        stepper, clock, frames, arms = self._stepper, self._clock, self._frames, self._arms
        spec, device = robot.arms[eid].spec, self._devices[eid]
        servers = [
            DeviceServer(
                spec.trajectory_action,
                FollowJointTrajectoryAction,
                stepper,
                device,
                lambda goal: JointJob(goal, eid, arms, clock),
                refused_trajectory,
            ),
            DeviceServer(
                spec.cartesian_action,
                CartesianMotionAction,
                stepper,
                device,
                lambda goal: CartesianJob(goal, eid, arms, clock, frames),
                refused_motion,
            ),
        ]
        servers.append(
            DeviceServer(
                f"{names.controller_topics(robot.name, spec.name, spec.compliant_controller)}/cartesian_trajectory",
                CartesianTrajectoryAction,
                stepper,
                device,
                lambda goal: TrajectoryJob(goal, eid, arms, frames),
                refused_reference_motion,
            )
        )
        if spec.planning_action:
            servers.append(
                DeviceServer(
                    spec.planning_action,
                    PlanMotionAction,
                    stepper,
                    Device(f"planner of arm {eid}"),
                    lambda goal: PlanningJob(goal, eid, arms, self._planning_scene, frames),
                    refused_plan,
                )
            )
        gripper = spec.gripper
        if gripper is not None and gripper.id in self._world.grippers:
            servers.append(
                DeviceServer(
                    gripper.action,
                    GripperCommandAction,
                    stepper,
                    Device(f"gripper {gripper.id}"),
                    lambda goal: GripperJob(goal, gripper.id),
                    lambda text: GripperCommandResult(),
                )
            )
        return servers

    def _reset(self, world: World, seed: int | None) -> None:
        """Resets the world; active goals are aborted. Called in the stepping thread."""
        for server in self._servers:
            server.abandon("the simulated world was reset")
        world.reset(seed)
        self._make_controllers(world)
        self._stepper.recover()
        self._state_publisher.publish_all()
        log.info("the simulated world was reset, seed %d", world.seed)


def main() -> None:
    """Runs the node until ROS shuts down.

    :raises ConfigurationError: a parameter or the scene is invalid.
    """
    options = read_options(rospy.get_param)
    folder = Path(options.workspace).expanduser() if options.workspace else ontology_folder()
    initial = [(SCENE, options.scene)] if options.scene else []
    model = WorldModel(ontology_folder(), folder, initial=initial)
    elements = LocalWorldModel("simulator", model).get_scene_elements()
    scene = read_scene(elements, model.ontology.is_subclass, (folder,))
    world = _create_world(scene, options)
    for problem in world.problems:
        log.warning("%s", problem)
    if rospy.is_shutdown():  # shut down while the world was created
        return
    simulator = Simulator(world, Stepper(world, options.rate, options.paused), model.ontology, options)
    rospy.on_shutdown(simulator.close)
    simulator.start()
    robots = ", ".join(robot.name for robot in world.robots.values()) or "none"
    log.info("the simulated world is ready: %d bodies, robots: %s", len(world.bodies), robots)
    spin()


def _create_world(scene: SceneSpec, options: Options) -> World:
    """Creates the world; without a window if none can be opened."""
    settings = (options.position_noise, options.yaw_noise, options.step_rate, options.sensor)
    if options.gui:
        try:
            return World(scene, options.seed, True, *settings)
        except Refused as error:
            log.warning("%s: the simulator continues without a window", error)
    return World(scene, options.seed, False, *settings)
