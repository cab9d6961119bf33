"""Primitives for the gripper with control_msgs/GripperCommand, where the position is the width between the fingers
(m)."""

from __future__ import annotations

from actionlib_msgs.msg import GoalStatus

from control_msgs.msg import GripperCommandGoal, GripperCommandResult
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_demo_skills.motions import CloseGripper, OpenGripper
from skiros2_sim_skills.motions import CheckGrasp, WatchGrasp, WmGrasped
from skiros2_std_reasoners.core.places import (
    box_of,
    contents,
    direction_between,
    grasp_of,
    in_grasp,
    move_in_world_model,
)
from skiros2_std_reasoners.core.scene_poses import ancestors, parent_of, pose_in_scene, size_of
from skiros2_std_skills.clock import Stopwatch
from skiros2_std_skills.core.devices import opening
from skiros2_std_skills.drivers import NOT_KNOWN
from skiros2_std_skills.gripper_motion import NOT_HELD, GripperMotion

#: Maximum width of closed fingers (m).
_NOTHING_BETWEEN = 0.004
#: Tolerance of the width of a held object (m).
_FIT = 0.015


class open_gripper(GripperMotion):
    """Opens the gripper."""

    def createDescription(self) -> None:
        self.setDescription(OpenGripper(), self.__class__.__name__)

    def doing(self) -> str:
        return "Opening the gripper"

    def buildGoal(self) -> GripperCommandGoal:
        return self.command(opening(self.element("Gripper")), 0.0)

    def onDone(self, status: int, msg: GripperCommandResult) -> State:
        if status == GoalStatus.SUCCEEDED and not msg.stalled:
            return self.success(f"{self.doing()}: {msg.position * 1000:.0f} mm")
        if not getattr(msg, "stalled", False):
            return self.failed(self.status_text(), status)
        wanted = opening(self.element("Gripper"))
        return self.failed(f"the fingers are stuck, {msg.position * 1000:.0f} of {wanted * 1000:.0f} mm apart", status)


class close_gripper(GripperMotion):
    """Closes the gripper on an object; fails if the fingers do not stop at its size."""

    def createDescription(self) -> None:
        self.setDescription(CloseGripper(), self.__class__.__name__)
        self.add_effort()

    def doing(self) -> str:
        return f"Grasping {self.label_of('Object')}"

    def buildGoal(self) -> GripperCommandGoal:
        return self.grip()

    def onDone(self, status: int, msg: GripperCommandResult) -> State:
        if not self.ended_well(status, msg):
            return self.failed(self.status_text(), status)
        wrong = misfit(self.element("Object"), msg.position)
        if wrong:
            return self.fail(wrong, NOT_HELD)
        return self.success(f"{self.doing()}: {msg.position * 1000:.0f} mm between the fingers")


class check_grasp(GripperMotion):
    """Closes the gripper again to check that it holds the object: then the fingers do not move."""

    def createDescription(self) -> None:
        self.setDescription(CheckGrasp(), self.__class__.__name__)
        self.add_effort()

    def doing(self) -> str:
        return f"Checking the grip on {self.label_of('Object')}"

    def buildGoal(self) -> GripperCommandGoal:
        return self.grip()

    def onDone(self, status: int, msg: GripperCommandResult) -> State:
        if not self.ended_well(status, msg):
            return self.failed(self.status_text(), status)
        thing = self.element("Object")
        wrong = misfit(thing, msg.position)
        if not wrong:
            return self.success(f"{self.label_of('Object')} is held")
        return self.fail(lost(self.wmi, self.element("Gripper"), thing, wrong), NOT_HELD)


class watch_grasp(GripperMotion):
    """Checks the grasp every `Period` seconds. Never succeeds; run it in parallel to another skill."""

    def createDescription(self) -> None:
        self.setDescription(WatchGrasp(), self.__class__.__name__)
        self.add_effort()
        self.addParam("Period", 1.0, ParamTypes.Optional, description="Period of the checks", unit="s", minimum=0)

    def onStart(self) -> bool:
        held = contents(self.wmi, self.element("Gripper"))
        self._held = held[0] if held else None
        self._rest: Stopwatch | None = None
        return super().onStart() if held else True

    def onPreempt(self) -> State:
        # the usual end: the parallel skill has ended
        if self._held is not None:
            super().onPreempt()
        return self.success("Watched to the end")

    def doing(self) -> str:
        return "Watching the grip"

    def buildGoal(self) -> GripperCommandGoal:
        return self.grip()

    def execute(self) -> State:
        if self._held is None:
            return self.step("The gripper is empty")
        if self._rest is None:
            return super().execute()
        if self._rest.passed() < self.value("Period"):
            return self.step(f"{self._held.label} is held")
        self._rest = None
        return self.restart(self.grip(), f"Checking the grip on {self._held.label}")

    def onDone(self, status: int, msg: GripperCommandResult) -> State:
        assert self._held is not None
        if not self.ended_well(status, msg):
            return self.failed(self.status_text(), status)
        wrong = misfit(self._held, msg.position)
        if wrong:
            return self.fail(lost(self.wmi, self.element("Gripper"), self._held, wrong), NOT_HELD)
        self._rest = Stopwatch()
        return self.step(f"{self._held.label} is held")


class wm_grasped(PrimitiveBase):
    """Moves the object into the gripper in the world model, with its pose between the fingers."""

    def createDescription(self) -> None:
        self.setDescription(WmGrasped(), self.__class__.__name__)

    def execute(self) -> State:
        thing, gripper = self.params["Object"].value, self.params["Gripper"].value
        try:
            box = box_of(self.wmi, thing)
            arm = pose_in_scene(self.wmi, self.params["Arm"].value)[1]
            grasp = grasp_of(box, direction_between(arm, box.pose))
            move_in_world_model(self.wmi, thing, gripper, in_grasp(box, grasp))
        except SkirosError as error:
            return self.fail(str(error), NOT_KNOWN)
        return self.success(f"{gripper.label} holds {thing.label}")


def misfit(thing: Element, width: float) -> str:
    """Returns why an object cannot be between fingers at a distance (m); "" if it can.

    :raises WrongValue: the object has no size.
    """
    if not width > _NOTHING_BETWEEN:
        return f"{thing.label} is not between the fingers: they have closed"
    size = size_of(thing)
    if any(abs(width - edge) <= _FIT for edge in size):
        return ""
    edges = " x ".join(f"{edge * 1000:.0f}" for edge in size)
    return f"the object between the fingers is {width * 1000:.0f} mm wide, but {thing.label} is {edges} mm"


def lost(wmi: WorldModelPort, gripper: Element, thing: Element, why: str) -> str:
    """Moves a lost object from the gripper to the scene in the world model. Returns a description."""
    holder = parent_of(wmi, wmi.get_element(thing.id))
    if holder is None or holder.id != gripper.id:
        return why
    thing = wmi.get_element(thing.id)
    move_in_world_model(wmi, thing, ancestors(wmi, thing)[-1], pose_in_scene(wmi, thing)[1])
    return f"{why}; {gripper.label} has lost it"
