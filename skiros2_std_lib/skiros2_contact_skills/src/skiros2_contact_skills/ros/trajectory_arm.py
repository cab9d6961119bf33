"""A compliant arm whose driver takes joint trajectories only: an admittance controller in small steps.

The equilibrium of the forces is searched in steps: with the error of the force

    f = F + W - K (x - x0)

with the commanded wrench F, the measured wrench W, the stiffness K, the commanded pose x and the reference x0, the next
step is f / (K + E), limited in length, where E is the assumed stiffness of the environment while the tool touches it
(Hogan, Impedance Control, 1985; the step is one of Newton's method). Each step is a goal of
`control_msgs/FollowJointTrajectory`; the next one is sent at the tick after its end. So the arm yields 5 to 10 times
per second: it is slow, and an impact is not softened.

The joints are stiff: a sensor that fails must not make the tool press on. With limits, a step is so short that it adds
at most what is missing to the limit, on an environment of the stiffness E; and each step needs a wrench that was
measured after the end of the one before, and differs from what it was then.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import actionlib
import numpy as np
import numpy.typing as npt
import rospy
from actionlib_msgs.msg import GoalStatus
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from control_msgs.msg import FollowJointTrajectoryAction, FollowJointTrajectoryGoal
from skiros2_common.core.errors import ConfigurationError, Refused
from skiros2_common.ros.connections import send_goal
from skiros2_contact_skills.ros.driver_calls import CONNECT_TIME, connected
from skiros2_contact_skills.ros.profiles import Profile
from skiros2_contact_skills.ros.topic_arm import TopicArm, without_zero
from skiros2_motion.core.arm_kinematics import difference
from skiros2_motion.core.compliant_arm import Wrench
from skiros2_motion.core.geometry import IDENTITY, Pose, conjugated, multiplied, normalized, rotated, rotation_of
from skiros2_motion.core.urdf_chain import read_chain
from skiros2_motion.core.wrench_guard import Limits

Array = npt.NDArray[np.float64]

#: Assumed stiffness of the environment (N/m, Nm/rad), and force from which the tool touches it (N).
_ENVIRONMENT, _TOUCH = np.array([20000.0] * 3 + [200.0] * 3), 2.0
#: Minimum stiffness of the admittance (N/m, Nm/rad).
_LEAST = np.array([50.0] * 3 + [5.0] * 3)
#: Maximum length of a step (m, rad); the tool is at the equilibrium within this (m, rad).
_STEP, _TURN = 0.005, 0.03
#: Part of the limit that a step may add to a force or torque that is near it: the tool must be able to yield.
_LEAST_PART = 0.25
_AT_REST, _TURNED = 0.00005, 0.0005
#: Minimum duration of a step (s), and fraction of the joints' maximum velocities.
_DURATION, _SPEED = 0.05, 0.3
_ACTIVE = (GoalStatus.PENDING, GoalStatus.ACTIVE)


class TrajectoryArm(TopicArm):
    """Adapter of `CompliantArm` to a profile without `reference`. `state` sends the steps.

    :raises ConfigurationError: there is no URDF with the links `base_frame` and `tool_frame`.
    """

    FORCE_RATE = 1.0 / _DURATION  # the arm takes a step in that time

    def __init__(self, profile: Profile, names: Mapping[str, str], mount: Pose = IDENTITY) -> None:
        super().__init__(profile, names, mount)
        parameter = self._name("description")
        try:
            self._chain = read_chain(str(rospy.get_param(parameter, "")), self._base, self._tool)
        except ConfigurationError as error:
            raise ConfigurationError(f"parameter {parameter}: {error}") from None
        self._client = actionlib.SimpleActionClient(self._name("action"), FollowJointTrajectoryAction)
        self._positions: dict[str, float] = {}
        self._joints = rospy.Subscriber(self._name("joint_states"), JointState, self._on_joints, queue_size=1)
        self._target: Pose | None = None
        self._commanded: Pose | None = None
        self._solution: Array | None = None
        #: The measured wrench after the end of the last step; None while it runs.
        self._wrench_then: Wrench | None = None

    def close(self) -> None:
        super().close()
        self._joints.unregister()
        self._client.action_client.stop()

    def _on_joints(self, message: JointState) -> None:
        with self._lock:
            self._positions.update(zip(message.name, message.position, strict=False))

    def _activate(self, takes_back: bool = True) -> None:
        if not self._client.wait_for_server(rospy.Duration.from_sec(CONNECT_TIME)):
            raise Refused(f"there is no action server {self._name('action')}")
        names = self._chain.joints
        if not connected(lambda: all(name in self._positions for name in names)):
            missing = [name for name in names if name not in self._positions]
            raise Refused(f"{self._name('joint_states')} has no {', '.join(missing)}")
        with self._lock:
            self._solution = np.array([self._positions[name] for name in self._chain.joints])
            self._commanded = self._target = self._chain.kinematics.forward(self._solution)
            self._reference = self._commanded
        self._await_states()

    def set_wrench_limits(self, force: float, torque: float, axes: Sequence[float] = ()) -> None:
        has_stopped = bool(self._stop)
        super().set_wrench_limits(force, torque, axes)
        if has_stopped:
            self._calls.request(self._activate)

    def _move_to(self, pose: Pose) -> None:
        with self._lock:
            self._target = pose
            stop = bool(self._stop)
            if stop:
                self._is_active = False
        if stop:
            self._client.cancel_goal()

    def _refresh(self, now: float) -> None:
        super()._refresh(now)
        with self._lock:
            if not self._is_active or self._reading is None:
                return
            if self._client.get_state() in _ACTIVE:
                self._wrench_then = None
                return
            before, self._wrench_then = self._wrench_then, self._reading.wrench
            if before not in (None, self._wrench_then):
                self._calls.later(self._step)

    def _step(self) -> None:
        """Sends the next step, if the tool is not at the equilibrium."""
        with self._lock:
            target, commanded, reading, start = self._target, self._commanded, self._reading, self._solution
            if not self._is_active or target is None or commanded is None or reading is None or start is None:
                return
            if self._client.get_state() in _ACTIVE:
                return
            wrench = np.array(without_zero(reading, self._zero))
            stiffness, most = np.maximum(np.array(self._stiffness), _LEAST), longest_step(wrench, self._limits)
        step = self._next_step(target, commanded, wrench, stiffness, most)
        if float(np.linalg.norm(step[:3])) < _AT_REST and float(np.linalg.norm(step[3:])) < _TURNED:
            return
        x, y, z = (a + b for a, b in zip(commanded.position, step[:3].tolist(), strict=True))
        turned = normalized(multiplied(rotation_of(step[3:].tolist()), commanded.orientation))
        solution = self._chain.kinematics.inverse(Pose((x, y, z), turned), start, restarts=0)
        if not solution.converged:
            raise Refused(f"the next pose is out of reach: off by {solution.off:.3f} m, {solution.turned:.3f} rad")
        change = np.abs(solution.positions - start) / (_SPEED * np.array(self._chain.velocities))
        point = JointTrajectoryPoint(
            positions=solution.positions.tolist(),
            velocities=[0.0] * len(self._chain.joints),
            time_from_start=rospy.Duration.from_sec(max(_DURATION, float(change.max()))),
        )
        with self._lock:
            self._commanded, self._solution = Pose((x, y, z), turned), solution.positions
        trajectory = JointTrajectory(joint_names=list(self._chain.joints), points=[point])
        send_goal(self._client, FollowJointTrajectoryGoal(trajectory=trajectory), done_cb=self._on_done)

    def _on_done(self, state: int, result: Any) -> None:
        if state in (GoalStatus.ABORTED, GoalStatus.REJECTED, GoalStatus.LOST):
            with self._lock:
                reason = getattr(result, "error_string", "") or self._client.get_goal_status_text() or "no reason"
                self._calls.problem, self._is_active = f"{self._name('action')}: {reason}", False

    @staticmethod
    def _next_step(
        target: Pose, commanded: Pose, wrench: Array, stiffness: Array, longest: tuple[float, float]
    ) -> Array:
        """Returns the next step along the axes of the base (m, rad). The stiffness is along those of the tool."""
        to_tool = conjugated(commanded.orientation)
        away = -difference(target, commanded)

        def turned(vector: Array, rotation: Any) -> Array:
            return np.array([*rotated(rotation, vector[:3].tolist()), *rotated(rotation, vector[3:].tolist())])

        force = turned(wrench, to_tool) - stiffness * turned(away, to_tool)
        touches = float(np.linalg.norm(wrench[:3])) > _TOUCH
        step = turned(force / (stiffness + (_ENVIRONMENT if touches else 0.0)), commanded.orientation)
        for part, most in zip((slice(0, 3), slice(3, 6)), longest, strict=True):
            length = float(np.linalg.norm(step[part]))
            if length > most:
                step[part] *= most / length
        return step


def longest_step(wrench: Sequence[float], limits: Limits) -> tuple[float, float]:
    """Returns the largest length and rotation of a step (m, rad) after which a tool that meets the assumed environment
    exerts at most the limits, also that of the weakest axis.

    :param wrench: measured (N, Nm).
    """
    found = []
    kinds = ((0, limits.force, _STEP), (3, limits.torque, _TURN))
    for first, limit, most in kinds:
        part = slice(first, first + 3)
        least = min(filter(None, (limit, *limits.axes[part])), default=0.0)
        rest = max(least - math.hypot(*wrench[part]), _LEAST_PART * least) / float(_ENVIRONMENT[first])
        found.append(min(most, rest) if least else most)
    return found[0], found[1]
