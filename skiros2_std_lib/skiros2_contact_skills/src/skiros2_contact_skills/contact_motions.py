"""Primitives of motions in contact: until contact, spiral search, insertion."""

from __future__ import annotations

import math

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.failure_kind import FailureKind
from skiros2_contact_skills.arms import finger_width
from skiros2_contact_skills.contact_primitive import (
    NO_CONTACT,
    NO_PROGRESS,
    NOT_FOUND,
    NOT_HELD,
    ContactPrimitive,
    axis_of,
    difference,
    dot,
    forces,
    moved,
    pressed,
)
from skiros2_contact_skills.core.evidence import Evidence, FloorTest, Judgement
from skiros2_contact_skills.core.pull_out import PullOut
from skiros2_contact_skills.descriptions import InsertPart, MoveUntilContact, SpiralSearch
from skiros2_contact_skills.fit import grip_width
from skiros2_contact_skills.held_parts import leave_where_it_was_lost
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.geometry import Pose, Quaternion, multiplied
from skiros2_motion.core.spiral import SpiralGoal
from skiros2_std_reasoners.core.scene_poses import parent_of
from skiros2_std_skills.core.devices import opening

#: Stiffness along the tool axis of motions until contact (N/m).
_APPROACH_STIFFNESS = 800.0
#: Stiffness along the tool axis of a search (N/m): it only damps, as the reference follows the tool.
_FOLLOWING_STIFFNESS = 800.0
#: A search ends after that many passes between the centre and the radius, and the time until the part is pressed (s).
_PASSES, _PRESSING_TIME = 2.0, 2.0
#: Lead of the reference with which a part is lifted after a search (m): up to 8 N.
_LIFT = 0.01
#: Stiffness along the tool axis of insertions (N/m).
_INSERTION_STIFFNESS = 2000.0
#: An insertion brakes within this time before its end (s), down to this speed (m/s).
_BRAKING_TIME, _SLOWEST = 0.4, 0.003
#: Distance from the wanted depth within which a part that has moved in this time is pushed with the friction and what
#: the damping takes up (m, s): more throws it at the floor when the friction ends. The reference never leads as far.
_NEAR_FLOOR, _MOVING_TIME = 0.01, 0.2
#: Maximum distance of the reference beyond the wanted depth (m).
_BEYOND = 0.005
#: Depth that counts as progress of an insertion (m).
_PROGRESS = 0.0005
#: Time constant with which the reference follows the tool across the axis during an insertion (s).
_FOLLOW_TIME = 0.3


class move_until_contact(ContactPrimitive):
    """Moves the reference along the tool axis at a constant speed until the measured force has grown enough."""

    def createDescription(self) -> None:
        self.setDescription(MoveUntilContact(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        self.set_stiffness(_APPROACH_STIFFNESS)
        self._speed = self.permitted(self.value("Speed"), axis_of(state), self.value("ContactForce"))
        self._travelled = 0.0

    def move(self, state: ArmState, dt: float) -> State:
        force = pressed(state) - pressed(self.start)
        if force >= self.value("ContactForce"):
            self.params["Surface"].values = list(state.pose.position)
            return self.success(f"Contact with {forces(state)} after {1000 * self._travelled:.1f} mm")
        if self._travelled > self.value("MaxDistance"):
            text = f"No contact within {1000 * self._travelled:.1f} mm ({forces(state)})"
            return self.fail(text, NO_CONTACT) if self.value("NeedsContact") else self.success(text)
        self._travelled += self._speed * dt
        position = moved(self.start.pose.position, axis_of(self.start), self._travelled)
        self.arm.set_reference(Pose(position, self.start.pose.orientation))
        return self.step(f"Moving until contact: {1000 * self._travelled:.1f} mm, {forces(state)}")


class spiral_search(ContactPrimitive):
    """Presses and lets the driver add a spiral to the reference, which follows the tool along its axis only."""

    # when a tick is late, nothing but the damping slows down a part that has dropped into the opening
    damping = (2.0, 2.0, 6.0, 2.0, 2.0, 2.0)

    def createDescription(self) -> None:
        self.setDescription(SpiralSearch(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        self.set_stiffness(_FOLLOWING_STIFFNESS)
        fit = self.fit()
        self._drop_depth = self.number("DropDepth", fit.drop_depth)
        self._radius = self.number("Radius", fit.search_radius)
        distance, velocity = self.value("PathDistance"), self.value("PathVelocity")
        self._before = self.number("Searched", 0.0)
        self._failed: PullOut | None = None
        self._time = min(self.value("SearchTime"), self.value("TotalTime") - self._before)
        if self._radius and distance and velocity:  # a driver refuses a spiral of a point
            self.arm.start_spiral(SpiralGoal(self._radius, distance, velocity, allow_decrease=True))
            self._time = min(self._time, _PASSES * math.pi * self._radius**2 / distance / velocity + _PRESSING_TIME)

    def move(self, state: ArmState, dt: float) -> State:
        if self._failed is not None:
            return self._lift(state, dt, self._failed)
        self.arm.set_wrench((0.0, 0.0, self.value("Force")))
        depth = self.depth(state)
        if depth >= self._drop_depth:
            self.params["Searched"].values = [0.0]
            return self.success(f"The opening is found, {1000 * depth:.1f} mm deep ({forces(state)})")
        passed = state.stamp - self.start.stamp
        self.params["Searched"].values = [self._before + passed]
        if passed > self._time:
            text = f"No opening within {1000 * self._radius:.1f} mm in {passed:.1f} s ({forces(state)})"
            self.arm.stop_overlay()
            self.arm.set_wrench((0.0, 0.0, 0.0))
            self.set_stiffness(_APPROACH_STIFFNESS)
            self._failed = PullOut(text, NOT_FOUND, "lifted", depth, state.stamp, _LIFT)
            return self.step(text)
        self.arm.set_reference(self._reference(state, 0.0))
        return self.step(f"Searching for the opening: {passed:.1f} s, {1000 * depth:.2f} mm deep, {forces(state)}")

    def _lift(self, state: ArmState, dt: float, failed: PullOut) -> State:
        """Lifts the part off the rim, and fails: it must not stay there."""
        depth = self.depth(state)
        if text := failed.result(depth, state.stamp):
            return self.fail(text, failed.code)
        self.arm.set_reference(self._reference(state, failed.ahead(depth, dt)))
        return self.step(f"Lifting the part: {1000 * depth:.1f} mm deep, {forces(state)}")

    def _reference(self, state: ArmState, ahead: float) -> Pose:
        """Returns the reference on the axis of the start, some distance ahead of the tool (m)."""
        axis = axis_of(self.start)
        along = dot(axis, difference(state.pose.position, self.start.pose.position))
        return Pose(moved(self.start.pose.position, axis, along + ahead), self.start.pose.orientation)


class insert_part(ContactPrimitive):
    """Pushes with a force profile. The tool yields across its axis, its reference follows it slowly, and its axis
    wobbles on a cone, which frees a jammed part."""

    # along the axis as in a search; with the default damping a soft tool would hardly wobble
    damping = (2.0, 2.0, 6.0, 0.5, 0.5, 0.5)

    def createDescription(self) -> None:
        self.setDescription(InsertPart(), self.__class__.__name__)

    def onStart(self) -> bool:
        part = self.optional_element("Part")
        holder = parent_of(self.wmi, part) if part is not None else None
        has_gripper = holder is not None and self.wmi.is_subclass(holder.type, "rparts:GripperEffector")
        self._gripper = holder if has_gripper else None
        self._width()  # connects to its driver
        return super().onStart()

    def begin(self, state: ArmState) -> None:
        self.set_stiffness(_INSERTION_STIFFNESS)
        self._slowest = self.permitted(_SLOWEST, axis_of(state))  # meets the floor
        self._damping = 2.0 * self.damping[2] * math.sqrt(_INSERTION_STIFFNESS)  # along the axis (N s/m)
        self._wanted = self.number("Depth", self.fit().depth)
        self._best = self._target = self.depth(state)
        self._best_at = state.stamp
        self._centre = state.pose.position
        self._test: FloorTest | None = None
        self._failed: PullOut | None = None
        part, gripper = self.optional_element("Part"), self._gripper
        width = grip_width(self.wmi, part) if part is not None else None
        self._evidence = Evidence(opening(gripper) if gripper is not None else math.inf, self._wanted, width)

    def move(self, state: ArmState, dt: float) -> State:
        if self._failed is not None:
            return self._pull_out(state, dt, self._failed)
        depth, wanted, evidence = self.depth(state), self._wanted, self._evidence
        evidence.see_fingers(self._width())
        evidence.tool_depth = depth
        if evidence.is_lost():
            return self._judge(state, Judgement.NOT_HELD, NOT_HELD)
        if depth > self._best + _PROGRESS:
            self._best, self._best_at = depth, state.stamp
        is_deep = depth >= wanted - self.value("Tolerance")
        is_stuck = state.stamp - self._best_at > self.value("Patience")
        if self._test is not None:
            return self._push(state, dt, self._test)
        if depth > wanted + _BEYOND:
            return self._judge(state, Judgement.SLIPPED, NOT_HELD)
        if is_deep and (is_stuck or pressed(state) >= self.value("SeatForce")):
            if self.value("SeatForce") == 0.0:  # the bore has no floor
                return self._judge(state, Judgement.INSERTED)
            excess = self._damping * self._slowest
            self._test = FloorTest(depth, state.stamp, self.value("Force"), _INSERTION_STIFFNESS, excess)
            return self._push(state, dt, self._test)
        if is_stuck:
            return self._judge(state, Judgement.JAMMED, NO_PROGRESS)
        force = self.value("EntryForce") if depth < self.value("EntryDepth") else self.value("Force")
        speed = min(self.value("Speed"), max(self._slowest, (wanted - depth) / _BRAKING_TIME))
        if depth > wanted - _NEAR_FLOOR and state.stamp - self._best_at < _MOVING_TIME:
            force = min(force, max(pressed(state), 0.0) + self._damping * speed)
        # the spring along the axis is stretched until it pulls with that force
        self._target = min(self._target + speed * dt, depth + force / _INSERTION_STIFFNESS, wanted + 2.0 * _BEYOND)
        self.arm.set_reference(self._reference(state, dt, self._target - depth))
        return self.step(f"Inserting: {1000 * depth:.1f} of {1000 * wanted:.1f} mm, {forces(state)}")

    def _push(self, state: ArmState, dt: float, test: FloorTest) -> State:
        """Pushes on what may be the floor."""
        depth = self.depth(state)
        if test.has_yielded(depth):
            self._test, self._target = None, depth
            self._best_at = state.stamp
        elif test.has_passed(pressed(state), state.stamp):
            self._evidence.see_floor(pressed(state))
            return self._judge(state, Judgement.INSERTED)
        elif state.stamp - test.started > self.value("Patience"):
            return self._judge(state, Judgement.NO_FLOOR, NO_PROGRESS)
        else:
            self.arm.set_reference(self._reference(state, dt, test.lead(pressed(state), depth, dt)))
        return self.step(f"Pushing {1000 * depth:.1f} mm deep, {forces(state)}")

    def _judge(self, state: ArmState, judgement: Judgement, code: int = 0) -> State:
        """Ends with a judgement, and its evidence."""
        evidence = self._evidence
        evidence.judgement = judgement
        self.params["Evidence"].values = [evidence.values()]
        depths = f"{1000 * evidence.tool_depth:.1f} of {1000 * self._wanted:.1f} mm deep"
        text = f"{judgement.capitalize()}, {depths}: {evidence.text()} ({forces(state)})"
        if not code:
            return self.success(text)
        if judgement is Judgement.NOT_HELD:
            if (part := self.optional_element("Part")) is not None and evidence.is_gone():
                text = f"{text}; {leave_where_it_was_lost(self.wmi, part)}"
            return self.fail(text, code, FailureKind.LOST)  # nobody knows where it is
        pull = self.value("Force") / _INSERTION_STIFFNESS
        self._failed = PullOut(text, code, "pulled out", self.depth(state), state.stamp, pull)
        return self.step(text)

    def _pull_out(self, state: ArmState, dt: float, failed: PullOut) -> State:
        """Pulls the part out of the bore after a failure, and fails: it must not stay jammed."""
        depth = self.depth(state)
        if text := failed.result(depth, state.stamp):
            return self.fail(text, failed.code)
        self.arm.set_reference(self._reference(state, dt, failed.ahead(depth, dt)))
        return self.step(f"Pulling the part out: {1000 * depth:.1f} mm deep, {forces(state)}")

    def _width(self) -> float | None:
        """Returns the distance between the fingers (m), if it is measured."""
        return finger_width(self.wmi, self.element("Robot"), self._gripper) if self._gripper is not None else None

    def _reference(self, state: ArmState, dt: float, ahead: float) -> Pose:
        """Returns the reference, some distance ahead of the tool along the axis (m)."""
        part = 1.0 - math.exp(-dt / _FOLLOW_TIME)
        off = difference(state.pose.position, self._centre)
        axis = axis_of(self.start)
        along = dot(axis, off)
        across = difference(off, moved((0.0, 0.0, 0.0), axis, along))
        self._centre = moved(moved(self._centre, across, part), axis, along)
        passed = state.stamp - self.start.stamp
        angle = math.radians(self.value("TiltAngle")) * min(1.0, passed)
        phase = 2.0 * math.pi * self.value("TiltFrequency") * passed
        ahead_of_tool = moved(self._centre, axis, ahead)
        return Pose(ahead_of_tool, multiplied(self.start.pose.orientation, _tilt(angle, phase)))


def _tilt(angle: float, direction: float) -> Quaternion:
    """Returns a rotation by an angle about an axis across z in a direction (rad)."""
    sine = math.sin(angle / 2.0)
    return sine * math.cos(direction), sine * math.sin(direction), 0.0, math.cos(angle / 2.0)
