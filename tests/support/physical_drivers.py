"""The drivers of a mobile manipulator in the simulated world, in this process and without ROS: skills meet physics.

The world is stepped by the test (`advance`), so that a test is the same each time, and as fast as the machine.
"""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from actionlib_msgs.msg import GoalStatus

from control_msgs.msg import FollowJointTrajectoryResult, GripperCommandResult
from controller_manager_msgs.srv import SwitchControllerResponse
from skiros2_motion.core.geometry import composed, inverted
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.arm_planning import ArmPlanning, PlanningGoal
from skiros2_sim.core.base_motion import BaseMotion
from skiros2_sim.core.cartesian_motion import CartesianGoal, CartesianMotion
from skiros2_sim.core.gripper import GripperMotion
from skiros2_sim.core.joint_motion import JointGoal, JointMotion, JointPoint
from skiros2_sim.core.perception import detect
from skiros2_sim.core.planning_scene import PlanningScene
from skiros2_sim.core.scene_reader import load_scene
from skiros2_sim.core.world import World
from skiros2_sim.ros.planning import plan_result
from skiros2_sim_msgs.msg import CartesianMotionResult, Detection
from skiros2_sim_msgs.srv import DetectResponse
from skiros2_std_reasoners.core import spatial_data as space
from support.stand_in_drivers import Answer, Client, StandInDrivers, pose_of


class PhysicalDrivers(StandInDrivers):
    """Actions and services of the first robot of a scene, with one arm.

    :param wmi: gets the poses of robot and gripper, as by tf.
    """

    def __init__(self, scene: Path, wmi: Any, **world: Any) -> None:
        super().__init__({})
        self.world = World(load_scene(scene, scene.parent), **world)
        self._wmi = wmi
        self._robot = next(iter(self.world.robots.values()))
        self._arm = next(iter(self._robot.arms.values()))
        self._controller = ArmController(self.world, self._robot, self._arm)
        self._running: dict[Client, Any] = {}
        self._scene: PlanningScene | None = None
        self._using = threading.Lock()  # services are called in threads of their own
        self._tell_poses()

    def advance(self, seconds: float) -> None:
        """Lets time pass in the world, and answers the goals that have come to their end."""
        with self._using:
            self.world.step(round(seconds * 240))
            ended = {client: motion for client, motion in self._running.items() if motion.outcome is not None}
            self._running = {c: m for c, m in self._running.items() if c not in ended}
        self._tell_poses()
        for client, motion in ended.items():
            client.end(_answer(motion))

    def start(self, client: Client, goal: Any) -> None:
        self.goals.append((client.name, goal))
        motion = self._motion(client.name.rpartition("/")[2], goal)
        with self._using:
            self.world.motions.add(motion)
            self._running[client] = motion

    def cancel(self, client: Client) -> None:
        super().cancel(client)
        motion = self._running.pop(client, None)
        if motion is not None:
            motion.cancel()

    def close(self) -> None:
        """Ends the world."""
        if self._scene is not None:
            self._scene.close()
        self.world.close()

    def _motion(self, kind: str, goal: Any) -> Any:
        if kind == "move_base":
            return BaseMotion.to_pose(self.world, self._robot, pose_of(goal.target_pose.pose))
        if kind == "gripper_action":
            return GripperMotion(self._arm.gripper, goal.command.position, goal.command.max_effort)
        if kind == "plan_motion":
            tool = pose_of(goal.target.pose) if goal.target.header.frame_id else None
            wanted = PlanningGoal(tuple(goal.joint_names), tuple(goal.positions), tool, clearance=goal.clearance)
            if self._scene is None:
                self._scene = PlanningScene(self.world.scene)
            return ArmPlanning(self._controller, wanted, self._scene)
        if kind == "follow_joint_trajectory":
            points = [
                JointPoint(p.time_from_start.to_sec(), tuple(p.positions), tuple(p.velocities))
                for p in goal.trajectory.points
            ]
            return JointMotion(self._controller, JointGoal(tuple(goal.trajectory.joint_names), tuple(points)))
        target = pose_of(goal.target.pose)
        if goal.target.header.frame_id != "map":  # the only other one that the skills use
            target = composed(self._arm.tool_pose(), target)
        line = CartesianGoal(target, speed=goal.speed, max_force=goal.max_force, contact_force=goal.contact_force)
        return CartesianMotion(self._controller, line)

    def _usual(self, name: str, goal: Any) -> Any:
        with self._using:
            if name.endswith("switch_controller"):
                self._controller.switch(goal.start_controllers[0])
                return SwitchControllerResponse(ok=True)
            response = DetectResponse(ok=True)
            for found in detect(self.world, goal.camera):
                detection = Detection(id=found.id, confidence=found.confidence)
                point, turn = detection.pose.pose.position, detection.pose.pose.orientation
                point.x, point.y, point.z = map(float, found.pose.position)
                turn.x, turn.y, turn.z, turn.w = map(float, found.pose.orientation)
                response.detections.append(detection)
            return response

    def _tell_poses(self) -> None:
        """Robot and gripper in the world model follow their frames."""
        mount = composed(self._robot.pose(), self._arm.spec.pose)
        gripper = self._arm.spec.gripper
        assert gripper is not None
        there = {self._robot.spec.id: self._robot.pose(), gripper.id: composed(inverted(mount), self._arm.tool_pose())}
        for eid, pose in there.items():
            element = self._wmi.get_element(eid)
            space.set_pose(element, pose)
            self._wmi.update_element_properties(element)


def _answer(motion: Any) -> Answer:
    state, text, code = motion.outcome
    result: Any = None
    if isinstance(motion, GripperMotion):
        result = GripperCommandResult(motion.width, motion.effort, motion.stalled, motion.reached_goal)
    elif isinstance(motion, JointMotion):
        result = FollowJointTrajectoryResult(error_code=code, error_string=text)
    elif isinstance(motion, CartesianMotion):
        result = CartesianMotionResult(error_code=code, error_string=text)
    elif isinstance(motion, ArmPlanning):
        result = plan_result(motion)
    return int(state) if state else GoalStatus.LOST, result, text
