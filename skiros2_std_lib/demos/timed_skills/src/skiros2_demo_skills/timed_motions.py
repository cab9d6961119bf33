"""Placeholders for the motions: they take time, report progress, and update the world model."""

from __future__ import annotations

from abc import ABC, abstractmethod

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_demo_skills.motions import CloseGripper, MoveArm, MoveBase, OpenGripper, TuckArm
from skiros2_motion.core.geometry import composed
from skiros2_std_reasoners.core.spatial_data import pose_of, set_pose
from skiros2_std_skills.clock import Stopwatch


class TimedMotion(PrimitiveBase, ABC):
    """Base of the placeholders: runs for `Duration` seconds."""

    @abstractmethod
    def createDescription(self) -> None:
        """To override: call `describe`."""

    def describe(self, description: SkillDescription, duration: float) -> None:
        """Sets the description, and adds the duration of the motion (s)."""
        self.setDescription(description, self.__class__.__name__)
        self.addParam(
            "Duration", duration, ParamTypes.Optional, description="Duration of the motion", unit="s", minimum=0
        )

    def doing(self) -> str:
        """To override: returns what the motion does, for progress messages."""
        return self.label

    def arrive(self) -> None:
        """To override: updates the world model at the end of the motion."""

    def onStart(self) -> bool:
        self._stopwatch = Stopwatch()
        return True

    def onPreempt(self) -> State:
        return self.fail(f"{self.doing()}: stopped", -1)

    def execute(self) -> State:
        passed, duration = self._stopwatch.passed(), self.params["Duration"].value
        if passed < duration:
            return self.step(f"{self.doing()}: {passed / duration:.0%}")
        self.arrive()
        return self.success(f"{self.doing()}: done")


class move_base_timed(TimedMotion):
    """Moves the robot to the approach pose of the place; without one, to the place itself."""

    def createDescription(self) -> None:
        self.describe(MoveBase(), 2.0)

    def doing(self) -> str:
        return f"Driving to {self.params['TargetLocation'].value.label}"

    def arrive(self) -> None:
        robot, place = self.params["Robot"].value, self.params["TargetLocation"].value
        pose = pose_of(place)
        if pose is None:
            return
        approach = self._approach_pose(place)
        relative = pose_of(approach) if approach is not None else None
        set_pose(robot, composed(pose, relative) if relative is not None else pose)
        self.wmi.update_element_properties(robot)

    def _approach_pose(self, place: Element) -> Element | None:
        for relation in place.getRelations("-1", "skiros:hasA"):
            part: Element = self.wmi.get_element(relation["dst"])
            if part.type == "skiros:ApproachPose":
                return part
        return None


class move_arm_timed(TimedMotion):
    """Does not change the poses of arm and gripper."""

    def createDescription(self) -> None:
        self.describe(MoveArm(), 1.0)

    def doing(self) -> str:
        return f"Reaching for {self.params['Target'].value.label}"


class tuck_arm_timed(TimedMotion):
    """Does not change the poses of arm and gripper."""

    def createDescription(self) -> None:
        self.describe(TuckArm(), 1.0)

    def doing(self) -> str:
        return "Tucking the arm"


class open_gripper_timed(TimedMotion):
    """Changes nothing."""

    def createDescription(self) -> None:
        self.describe(OpenGripper(), 0.5)

    def doing(self) -> str:
        return "Opening the gripper"


class close_gripper_timed(TimedMotion):
    """Changes nothing."""

    def createDescription(self) -> None:
        self.describe(CloseGripper(), 0.5)

    def doing(self) -> str:
        return f"Grasping {self.params['Object'].value.label}"
