"""Primitives of compliant motions that end at a pose."""

from __future__ import annotations

import math

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills.contact_primitive import NOT_REACHED, RETRACTED, ContactPrimitive, difference, forces
from skiros2_contact_skills.core.part_poses import aligned_tool, held_frame, pose_on_arm
from skiros2_contact_skills.descriptions import ApproachGrasp, ApproachTarget, RetractAfterFailure, RetractTool
from skiros2_contact_skills.never_regions import check_outside
from skiros2_motion.core.arm_kinematics import distances
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.geometry import IDENTITY, Pose, between, composed
from skiros2_motion.core.time_scaling import PEAK_SPEED, minimum_jerk

#: Ratio of angular and linear speed of a motion (rad/m), and time to settle at its end (s).
_TURN, _SETTLING_TIME = 4.0, 2.0
#: Height above a target from which on a contact is expected (m), and deceleration before it (m/s2).
_NEAR, _BRAKING = 0.01, 0.5


class _CompliantLine(ContactPrimitive):
    """Moves the reference on a straight line to a goal, with a minimum-jerk profile; slowly where it nears a target."""

    nears_target = True

    def goal(self, state: ArmState) -> Pose:
        """To override: returns the goal of the tool, in the base frame."""
        raise NotImplementedError(f"{type(self).__name__} has to define goal")

    def begin(self, state: ArmState) -> None:
        across = self.value("Stiffness")
        self.set_stiffness(across)
        self._goal = self.goal(state)
        check_outside(self.regions, "the goal", self._goal.position)
        self._has_to_zero = self.value("ZeroSensor")
        length, turn = distances(state.pose, self._goal)
        self._passed = 0.0
        self._length = length
        self._slow_length = max(0.0, _NEAR - self.value("Height")) if self.nears_target else 0.0
        self._permitted = math.inf
        if self._slow_length and length:
            way = difference(self._goal.position, state.pose.position)
            x, y, z = (value / length for value in way)
            self._permitted = self.permitted(self.value("Speed"), (x, y, z))
        self._duration = max(0.1, PEAK_SPEED * max(length, turn / _TURN) / self.value("Speed"))

    def move(self, state: ArmState, dt: float) -> State:
        part = self._advance(dt)
        self.arm.set_reference(between(self.start.pose, self._goal, part))
        off, turned = distances(state.pose, self._goal)
        if part == 1.0 and off <= self.value("Tolerance"):
            if self._has_to_zero:
                self._has_to_zero = False
                self.arm.zero_sensor()
                return self.step("Zeroing the sensor")
            return self.success(f"There, {1000 * off:.1f} mm and {turned:.3f} rad off ({forces(state)})")
        if self._passed > self._duration + _SETTLING_TIME:
            return self.fail(f"{1000 * off:.1f} mm and {turned:.3f} rad from the goal ({forces(state)})", NOT_REACHED)
        return self.step(f"Approaching: {1000 * off:.0f} mm to go, {forces(state)}")

    def _advance(self, dt: float) -> float:
        """Returns the completed fraction of the line after `dt` seconds, slower where a contact is expected."""
        before = minimum_jerk(self._passed, self._duration)
        step = self._length * (minimum_jerk(self._passed + dt, self._duration) - before)
        free = max(0.0, self._length * (1.0 - before) - self._slow_length)
        most = dt * math.sqrt(self._permitted**2 + 2.0 * _BRAKING * free)
        self._passed += dt * min(1.0, most / step) if step > 0.0 else dt
        return minimum_jerk(self._passed, self._duration)


class approach_target(_CompliantLine):
    """Moves above the target where the world model has it, the lower end of the part first."""

    def createDescription(self) -> None:
        self.setDescription(ApproachTarget(), self.__class__.__name__)

    def goal(self, state: ArmState) -> Pose:
        end = held_frame(self.wmi, self.optional_element("Part"), self.optional_element("Feature"))
        target = pose_on_arm(self.wmi, self.element("Arm"), self.element("Target"))
        self.params["Surface"].values = list(aligned_tool(state.pose, end, target, 0.0).position)
        return aligned_tool(state.pose, end, target, self.value("Height"))


class approach_grasp(_CompliantLine):
    """Moves the tool to where the world model has the grasping pose."""

    def createDescription(self) -> None:
        self.setDescription(ApproachGrasp(), self.__class__.__name__)

    def goal(self, state: ArmState) -> Pose:
        return _behind(pose_on_arm(self.wmi, self.element("Arm"), self.element("Grasp")), self.value("Height"))


class retract_tool(_CompliantLine):
    """Moves straight back from where the tool is."""

    nears_target = False

    def createDescription(self) -> None:
        self.setDescription(RetractTool(), self.__class__.__name__)

    def goal(self, state: ArmState) -> Pose:
        return _behind(state.pose, self.value("Height"))


class retract_after_failure(retract_tool):
    """Moves back after a failure, which is explained by the node that failed first."""

    fails_late = True

    def createDescription(self) -> None:
        self.setDescription(RetractAfterFailure(), self.__class__.__name__)

    def move(self, state: ArmState, dt: float) -> State:
        moved = super().move(state, dt)
        return self.fail("Retracted after a failure", RETRACTED) if moved is State.Success else moved


def _behind(tool: Pose, distance: float) -> Pose:
    """Returns a tool pose that is moved back along its axis (m)."""
    return composed(tool, Pose((0.0, 0.0, -distance), IDENTITY.orientation))
