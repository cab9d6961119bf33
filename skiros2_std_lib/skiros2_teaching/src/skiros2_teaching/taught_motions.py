"""Primitives that move an arm to taught poses and along taught paths, and its gripper."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.contact_primitive import ContactPrimitive, forces
from skiros2_contact_skills.core.part_poses import pose_on_arm
from skiros2_motion.core.arm_kinematics import distances
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.geometry import composed, inverted
from skiros2_motion.core.gripper import Gripper, GripperEvent
from skiros2_teaching import descriptions as described
from skiros2_teaching.core import taught_elements as taught
from skiros2_teaching.core.player import GRIPPER_FAILED, Player
from skiros2_teaching.core.timed_motion import Limits, Line, TimedMotion, sections
from skiros2_teaching.grippers import gripper_of

#: Progress codes of failures: the taught element cannot be used, its object has moved meanwhile.
UNUSABLE, OBJECT_MOVED = -150, -151

#: Period of the references (s of wall time).
_PERIOD = 0.01
#: Damping factors of the compliant controller: about critical damping with the inertia of an arm.
_DAMPING = (2.0,) * 6
#: Ratio of angular and linear acceleration (rad/m).
_TURN = 4.0
#: Distances by which the object may move during a motion (m, rad): a perception skill may measure it again.
_SHIFT, _SHIFT_TURN = 0.005, 0.03


class _Metronome:
    """Requests ticks at a rate above that of the skill manager: between two references the tool would move in jerks.

    :param wake: requests a tick, from any thread.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake, self._stopped = wake, threading.Event()
        threading.Thread(target=self._run, name="ticks of a taught motion", daemon=True).start()

    def stop(self) -> None:
        """Ends the requests."""
        self._stopped.set()

    def _run(self) -> None:
        while not self._stopped.wait(_PERIOD):
            self._wake()


class _TaughtMotion(ContactPrimitive):
    """Base of the motions relative to an object. The object must stand still meanwhile."""

    #: The parameter with the taught element.
    key = ""

    def __str__(self) -> str:
        return str(self.label)

    def check(self) -> None:
        """To override: checks the parameters before the arm is taken.

        :raises SkirosError: the taught element cannot be used.
        """

    def parts(self, state: ArmState) -> Sequence[TimedMotion | GripperEvent]:
        """To override: returns the motions and gripper events, in the base frame.

        :raises SkirosError: the taught element cannot be used.
        """
        raise NotImplementedError(f"{type(self).__name__} has to define parts")

    def onStart(self) -> bool:
        self._player: Player | None = None
        self._gripper: Gripper | None = None
        self._metronome: _Metronome | None = None
        try:
            self._owner = taught.owner_of(self.wmi, self.element(self.key))
            self._taught = self.wmi.get_element(self.element(self.key).id)
            self.check()
        except SkirosError as error:
            return self.startError(str(error), UNUSABLE)
        return super().onStart()

    def begin(self, state: ArmState) -> None:
        self._owner_on_arm = pose_on_arm(self.wmi, self.element("Arm"), self._owner)
        stiffness, rotational = self.value("Stiffness"), self.value("RotationalStiffness")
        parts = self.parts(state)
        if any(isinstance(part, GripperEvent) for part in parts):
            self._gripper = gripper_of(self.wmi, self.element("Robot"), self.element("Arm"))
        self.arm.set_stiffness((stiffness,) * 3, (rotational,) * 3)
        self.arm.set_damping(_DAMPING)
        self._player = Player(self.arm, self._gripper, parts, self.value("Tolerance"))
        self._metronome = _Metronome(self.wake)

    def move(self, state: ArmState, dt: float) -> State:
        player, name = self._player, self.label_of(self.key)
        assert player is not None
        owner = self.wmi.find_element(self._owner.id)
        if owner is None or self.wmi.find_element(self._taught.id) is None:
            return self.fail(f"{name!r} or its object {self._owner.label!r} was removed", UNUSABLE)
        off, turned = distances(pose_on_arm(self.wmi, self.element("Arm"), owner), self._owner_on_arm)
        if off > _SHIFT or turned > _SHIFT_TURN:
            text = f"{owner.label!r} has moved by {1000.0 * off:.0f} mm and {turned:.2f} rad during the motion"
            return self.fail(text, OBJECT_MOVED)
        player.update(state)
        if player.failure is not None:
            return self.fail(f"{name!r}: {player.failure.text} ({forces(state)})", player.failure.code)
        lag = f"{1000.0 * player.lag[0]:.1f} mm"
        if player.has_ended:
            return self.success(f"{name!r}: there, {lag} off ({forces(state)})")
        return self.step(f"{name!r}: {100.0 * player.progress:.0f} %, {lag} behind, {forces(state)}")

    def onEnd(self) -> bool:
        if self._metronome is not None:
            self._metronome.stop()
        if self._gripper is not None:
            self._gripper.close()
        return super().onEnd()

    def limits(self) -> Limits:
        """Returns the limits in the parameters."""
        strongest = self.value("Acceleration")
        return Limits(self.value("Speed"), self.value("AngularSpeed"), strongest, _TURN * strongest)


class move_to_taught_pose(_TaughtMotion):
    """Moves on straight lines, by the lifting pose if there is one."""

    key = "Pose"

    def createDescription(self) -> None:
        self.setDescription(described.MoveToTaughtPose(), self.__class__.__name__)

    def parts(self, state: ArmState) -> Sequence[TimedMotion]:
        lifting: Element | None = None
        if self.value("ViaLifting"):
            lifting = taught.lifting_pose_of(self.wmi, self._taught)
        arm, limits = self.element("Arm"), self.limits()
        poses = [state.pose, *(pose_on_arm(self.wmi, arm, e) for e in (lifting, self._taught) if e is not None)]
        return [Line(one, other, limits) for one, other in itertools.pairwise(poses)]


class replay_taught_path(_TaughtMotion):
    """Moves on a straight line to the start of the path, and along it."""

    key = "Path"

    def createDescription(self) -> None:
        self.setDescription(described.ReplayTaughtPath(), self.__class__.__name__)

    def check(self) -> None:
        taught.path_of(self._taught)

    def parts(self, state: ArmState) -> Sequence[TimedMotion | GripperEvent]:
        arm, limits = self.element("Arm"), self.limits()
        frame = pose_on_arm(self.wmi, arm, self._taught)
        path = taught.path_of(self._taught)
        goal = self.element("Goal")
        if goal is not None and not goal.isAbstract():
            path = path.adapted(goal=composed(inverted(frame), pose_on_arm(self.wmi, arm, goal)))
        if self.value("FromHere"):
            path = path.adapted(start=composed(inverted(frame), state.pose))
        path = path.transformed(frame)
        return [Line(state.pose, path.pose(0.0), limits), *sections(path, limits, self.value("Scaling"))]


class move_gripper(PrimitiveBase):
    """Sends one command to the gripper of the arm."""

    def createDescription(self) -> None:
        self.setDescription(described.MoveGripper(), self.__class__.__name__)

    def onStart(self) -> bool:
        arm = self.params["Arm"].value
        try:
            gripper = gripper_of(self.wmi, self.params["Robot"].value, arm)
            if gripper is None:
                raise Refused(f"{arm.label or arm.id} has no gripper")
        except SkirosError as error:
            return self.startError(str(error), GRIPPER_FAILED)
        self._gripper = gripper
        self._gripper.command(self.params["Width"].value, self.params["Effort"].value)
        return True

    def execute(self) -> State:
        result = self._gripper.result()
        if result is None:
            return self.step("Moving the fingers")
        return self.fail(result, GRIPPER_FAILED) if result else self.success("The fingers have stopped")

    def onEnd(self) -> bool:
        self._gripper.close()
        return True
