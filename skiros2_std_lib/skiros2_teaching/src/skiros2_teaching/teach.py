"""Primitives that teach: an arm is released, guided by hand, and its poses and paths are stored in the world model.

The skills of one arm run in one process, as tasks of its skill manager: `teach_release` moves the reference of the arm,
the others only read its state.
"""

from __future__ import annotations

import logging
import time
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.arms import give_back, take_arm
from skiros2_contact_skills.contact_primitive import ContactPrimitive
from skiros2_contact_skills.core.part_poses import pose_on_arm
from skiros2_motion.core.compliant_arm import STALE, ArmState, CompliantArm
from skiros2_motion.core.geometry import Pose, composed, inverted
from skiros2_motion.core.gripper import Gripper
from skiros2_std_reasoners.core.places import above
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from skiros2_teaching import descriptions as described
from skiros2_teaching.core import taught_elements as taught
from skiros2_teaching.core.recording import Recording
from skiros2_teaching.grippers import gripper_of
from skiros2_teaching.guiding import (
    Guiding,
    guiding_of,
    start_guiding,
    start_recording,
    stop_guiding,
    stop_recording,
)

log = logging.getLogger(__name__)

#: Progress codes of failures: teaching is refused, there is no state of the arm, preempted, not ended in time.
REFUSED, NO_STATE, STOPPED, TOO_LONG = -140, -141, -142, -143

#: Stiffness of an arm that is held after its release (N/m, Nm/rad).
_HOLDING, _HOLDING_TURN = 600.0, 40.0
#: Time in which the driver has to send a state, and skills have to end (s), by the arm's clock and by the wall clock:
#: simulated time stands still when its simulator has died.
_PATIENCE, _WALL_PATIENCE = 5.0, 15.0


class _Waiting:
    """Time since the start of waiting for an arm."""

    def __init__(self, arm: CompliantArm) -> None:
        self._arm, self._began, self._began_wall = arm, arm.now(), time.monotonic()

    def is_over(self) -> bool:
        """Whether it has lasted too long."""
        wall = time.monotonic() - self._began_wall
        return self._arm.now() - self._began > _PATIENCE or wall > _WALL_PATIENCE


def _is_known(state: ArmState | None) -> bool:
    """Whether the pose of a state is that of now: the adapter has found neither that it is late nor that it is wrong. A
    stop for another reason, or an inactive controller, does not matter."""
    return state is not None and not (state.stopped and state.kind is FailureKind.SENSOR)


class teach_release(ContactPrimitive):
    """The reference follows the tool: the stiffness only damps."""

    def createDescription(self) -> None:
        self.setDescription(described.TeachRelease(), self.__class__.__name__)

    def __str__(self) -> str:
        return str(self.label)

    def begin(self, state: ArmState) -> None:
        stiffness, rotational = self.value("Stiffness"), self.value("RotationalStiffness")
        self.arm.set_stiffness((stiffness,) * 3, (rotational,) * 3)
        self._guiding = start_guiding(self.element("Arm"), self.arm)

    def move(self, state: ArmState, dt: float) -> State:
        assert self._guiding is not None
        self.arm.set_reference(state.pose)
        if self._guiding.ends and not self._guiding.is_recorded:
            return self.success(f"{self.label_of('Arm')} holds its pose")
        recorded = ", and recorded" if self._guiding.is_recorded else ""
        return self.step(f"{self.label_of('Arm')} is guided by hand{recorded}")

    def onStart(self) -> bool:
        self._guiding: Guiding | None = None
        return super().onStart()

    def onPreempt(self) -> State:
        return self.fail(f"Stopped; {self.label_of('Arm')} holds its pose", STOPPED)

    def onEnd(self) -> bool:
        if self._guiding is not None:
            stop_guiding(self.element("Arm"), self._guiding)
            self.arm.set_stiffness((_HOLDING,) * 3, (_HOLDING_TURN,) * 3)
        return super().onEnd()


class _Teaching(PrimitiveBase):
    """Base of the primitives that edit taught elements. Refusals are failures with their reason."""

    def __str__(self) -> str:
        return str(self.label)

    def element(self, key: str) -> Element:
        """Returns the element in a parameter."""
        found: Element = self.params[key].value
        return found

    def value(self, key: str) -> Any:
        """Returns the value of a parameter."""
        return self.params[key].value

    def label_of(self, key: str) -> str:
        """Returns the name of the element in a parameter."""
        element = self.element(key)
        return str(element.label or element.id)

    def existing(self, kind: str) -> Element | None:
        """Returns the taught element that is to be replaced; None for a new one.

        :param kind: its class.
        :raises Refused: it exists, and is not to be replaced, or is of another class.
        :raises UnknownName: the object is not in the scene.
        """
        name, owner = self.value("Name"), self.element("Object")
        there = next((e for e in taught.taught_elements(self.wmi, owner) if e.label == name), None)
        if there is None:
            return None
        if not self.value("Replace"):
            raise Refused(f"{owner.label!r} has a taught element {name!r}: {there.id}. Set Replace to teach it again")
        if not self.wmi.is_subclass(there.type, kind):
            raise Refused(f"{there.id} of the name {name!r} is a {there.type}: expected a {kind}")
        return there

    def object_on_arm(self) -> Pose:
        """Returns the pose of the object in the base frame of the arm.

        :raises WrongValue: one of them has no pose.
        """
        return pose_on_arm(self.wmi, self.element("Arm"), self.wmi.get_element(self.element("Object").id))


class _PoseReader(_Teaching):
    """Base of the primitives that store one pose of the tool."""

    def store(self, tool: Pose) -> str:
        """To override: stores the pose, and returns what was done.

        :param tool: pose of the tool in the base frame.
        :raises SkirosError: the pose cannot be stored.
        """
        raise NotImplementedError(f"{type(self).__name__} has to define store")

    def onStart(self) -> bool:
        self._waiting: _Waiting | None = None
        arm = self.element("Arm")
        try:
            guiding = guiding_of(arm)
            self._arm = guiding.arm if guiding is not None else take_arm(self.wmi, self.element("Robot"), arm, self)
        except SkirosError as error:
            return self.startError(f"{self.label_of('Arm')}: {error}", REFUSED)
        return True

    def execute(self) -> State:
        try:
            now, state = self._arm.now(), self._arm.state()
            if self._waiting is None:
                self._waiting = _Waiting(self._arm)
            if state is not None and _is_known(state) and now - state.stamp <= STALE:
                return self.success(self.store(state.pose))
            if not self._waiting.is_over():
                return self.step("Waiting for a state of the arm")
            why = f": {state.stopped}" if state is not None and state.stopped else ""
            return self.fail(f"{self.label_of('Arm')} has sent no state for {_PATIENCE:g} s{why}", NO_STATE)
        except SkirosError as error:
            return self.fail(str(error), REFUSED)

    def onEnd(self) -> bool:
        give_back(self)
        return True


class teach_pose(_PoseReader):
    """Stores the pose of the tool."""

    def createDescription(self) -> None:
        self.setDescription(described.TeachPose(), self.__class__.__name__)

    def store(self, tool: Pose) -> str:
        name, owner = self.value("Name"), self.element("Object")
        there, pose = self.existing(taught.POSE), composed(inverted(self.object_on_arm()), tool)
        if there is None:
            self.wmi.transact(taught.new_pose(self.wmi, owner, name, pose))
        else:
            self.wmi.transact(taught.with_pose(self.wmi, there, pose))
        return f"Taught pose {name!r} of {owner.label!r}"


class teach_lifting_pose(_PoseReader):
    """Stores the lifting pose of a taught pose."""

    def createDescription(self) -> None:
        self.setDescription(described.TeachLiftingPose(), self.__class__.__name__)

    def store(self, tool: Pose) -> str:
        pose = self.element("Pose")
        taught.owner_of(self.wmi, pose)
        _, at = pose_in_scene(self.wmi, self.wmi.get_element(pose.id))
        if self.value("Height") > 0.0:
            lifted = above(at, self.value("Height"))
        else:
            lifted = composed(pose_in_scene(self.wmi, self.element("Arm"))[1], tool)
        self.wmi.transact(taught.with_lifting_pose(self.wmi, pose, composed(inverted(at), lifted)))
        return f"Taught lifting pose of {pose.label!r}"


class teach_path(_Teaching):
    """Takes a sample at each tick, and the commands that the gripper gets from whatever client."""

    def createDescription(self) -> None:
        self.setDescription(described.TeachPath(), self.__class__.__name__)

    def onStart(self) -> bool:
        arm = self.element("Arm")
        self._guiding: Guiding | None = None
        self._gripper: Gripper | None = None
        self._recording = Recording()
        try:
            self.existing(taught.PATH)
            self._guiding = start_recording(self.wmi, self.element("Robot"), arm, self)
            self._was_released = self._guiding.is_released
            self._gripper = gripper_of(self.wmi, self.element("Robot"), arm)
        except SkirosError as error:
            self.onEnd()
            return self.startError(str(error), REFUSED)
        self._began, self._waiting = self._guiding.arm.now(), _Waiting(self._guiding.arm)
        return True

    def execute(self) -> State:
        guiding = self._guiding
        assert guiding is not None
        try:
            state = guiding.arm.state()
            if self._was_released and guiding_of(self.element("Arm")) is not guiding:
                return self.fail(f"{self.label_of('Arm')} is no longer released: the path is discarded", REFUSED)
            if state is not None and not _is_known(state):
                return self.fail(f"{self.label_of('Arm')}: {state.stopped}", NO_STATE, state.kind)
            if state is not None:
                self._recording.add(state)
            elif not len(self._recording) and self._waiting.is_over():
                return self.fail(f"{self.label_of('Arm')} has sent no state for {_PATIENCE:g} s", NO_STATE)
            late = guiding.arm.now() - (state.stamp if state is not None else self._began)
            if late > (STALE if len(self._recording) else _PATIENCE):
                return self.fail(f"{self.label_of('Arm')} has sent no state for {late:.1f} s", NO_STATE)
            if guiding.ends_recording or guiding.ends:
                return self._store()
        except SkirosError as error:
            return self.fail(str(error), REFUSED)
        longest = self.value("MaxDuration")
        if self._recording.duration > longest:
            return self.fail(f"The recording is longer than {longest:g} s", TOO_LONG)
        events = f", {len(self._gripper.commands())} gripper commands" if self._gripper is not None else ""
        return self.step(f"Recording: {self._recording.duration:.1f} s, {len(self._recording)} samples{events}")

    def onPreempt(self) -> State:
        return self.fail("Stopped: the path is discarded", STOPPED)

    def onEnd(self) -> bool:
        if self._gripper is not None:
            self._gripper.close()
        if self._guiding is not None:
            stop_recording(self.element("Arm"), self._guiding, self)
        return True

    def _store(self) -> State:
        name, owner = self.value("Name"), self.element("Object")
        commands = self._gripper.commands() if self._gripper is not None else ()
        there = self.existing(taught.PATH)
        path = self._recording.path(inverted(self.object_on_arm()), commands)
        if there is None:
            self.wmi.transact(taught.new_path(self.wmi, owner, name, path))
        else:
            self.wmi.transact(taught.with_path(self.wmi, there, path))
        found = f"{path.duration:.1f} s, {len(path.times)} samples, {len(path.events)} gripper events"
        return self.success(f"Taught path {name!r} of {owner.label!r}: {found}")


class teach_end(_Teaching):
    """Has `teach_path` store its path and `teach_release` hold the arm, and waits for them."""

    def createDescription(self) -> None:
        self.setDescription(described.TeachEnd(), self.__class__.__name__)

    def onStart(self) -> bool:
        self._guiding = guiding_of(self.element("Arm"))
        if self._guiding is None:
            return True
        self._waiting = _Waiting(self._guiding.arm)
        self._guiding.ends_recording = True
        self._guiding.ends = self._guiding.ends or not self.value("KeepReleased")
        return True

    def execute(self) -> State:
        guiding, arm = self._guiding, self.label_of("Arm")
        if guiding is None:
            return self.success(f"Nothing was being taught with {arm}")
        is_guided = guiding_of(self.element("Arm")) is guiding
        if not guiding.is_recorded and not (guiding.ends and is_guided):
            return self.success(f"{arm} is still released" if is_guided else f"{arm} holds its pose")
        if self._waiting.is_over():
            return self.fail(f"{arm} is still {'recorded' if guiding.is_recorded else 'released'}", TOO_LONG)
        return self.step(f"Ending to teach with {arm}")


class teach_undo(PrimitiveBase):
    """Reverts the last edit in one request."""

    def createDescription(self) -> None:
        self.setDescription(described.TeachUndo(), self.__class__.__name__)

    def execute(self) -> State:
        try:
            edit = taught.last_edit(self.wmi)
            self.wmi.revert(edit)
        except SkirosError as error:
            return self.fail(str(error), REFUSED)
        changed = [r.label for pair in edit.changes.records.values() for r in pair if r is not None]
        return self.success(f"Undone: the edit of {', '.join(dict.fromkeys(changed))} by {edit.author}")
