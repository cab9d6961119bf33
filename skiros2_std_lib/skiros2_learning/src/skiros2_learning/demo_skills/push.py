"""Pushing an object across a table: description, compound and the motion that it is made of."""

from __future__ import annotations

import math
from typing import Any

from actionlib_msgs.msg import GoalStatus

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose, Quaternion
from skiros2_sim_msgs.msg import CartesianMotionAction, CartesianMotionGoal, CartesianMotionResult
from skiros2_sim_skills.base_motion import stamped
from skiros2_sim_skills.motions import ArmAndGripper
from skiros2_skill.core.processors import Sequential
from skiros2_skill.core.skill import SkillBase
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from skiros2_std_skills.core.devices import name_of
from skiros2_std_skills.core.driver_names import CARTESIAN
from skiros2_std_skills.drivers import DriverAction

#: Orientation of a tool that points down, with the fingers side by side along x of the map.
_DOWN: Quaternion = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
#: Height of the tool above the object's centre before and after the push (m).
_ABOVE = 0.16
#: Largest offset (m).
REACH = 0.2


class MoveToolBeside(ArmAndGripper):
    """Moves the tool, pointing down, to a point at an offset from a thing."""

    def createDescription(self) -> None:
        self.add_arm_and_gripper()
        self.addParam("Reference", Element("sumo:Object"), ParamTypes.Required, description="The thing")
        for axis in "XY":
            self.addParam(
                f"Offset{axis}", float, ParamTypes.Required, description=f"Offset along {axis.lower()} of the map",
                unit="m", minimum=-1.0, maximum=1.0,
            )  # fmt: skip
        self.addParam("Height", 0.0, ParamTypes.Optional, description="Height above the thing's centre", unit="m")
        self.addParam(
            "Speed", 0.25, ParamTypes.Optional, description="Speed of the tool", unit="m/s", minimum=0.01, maximum=2.0
        )
        self.addParam(
            "MaxForce", 40.0, ParamTypes.Optional, description="Force at which the motion fails", unit="N", minimum=0
        )


class Push(ArmAndGripper):
    """Pushes an object to a goal with a straight motion of the tool.

    The tool starts at an offset from the object and ends at an offset from the goal. Which offsets bring the object
    to the goal, past obstacles, depends on sizes, friction and the errors of poses: they are to be learned.
    """

    def createDescription(self) -> None:
        self.add_arm_and_gripper()
        self.addParam("Object", Element("skiros:Manipulatable"), ParamTypes.Required, description="The pushed object")
        self.addParam("Goal", Element("skiros:Location"), ParamTypes.Required, description="Where it shall be")
        for key, text in (
            ("StartX", "Start of the push: offset from the object along x of the map"),
            ("StartY", "Start of the push: offset from the object along y of the map"),
            ("GoalX", "End of the push: offset from the goal along x of the map"),
            ("GoalY", "End of the push: offset from the goal along y of the map"),
        ):
            self.addParam(key, float, ParamTypes.Required, description=text, unit="m", minimum=-REACH, maximum=REACH)
        self.addParam(
            "Speed", 0.15, ParamTypes.Optional, description="Speed of the push", unit="m/s", minimum=0.01, maximum=0.5
        )
        self.addPostCondition(self.getRelationCond("ObjectAtGoal", "skiros:at", "Object", "Goal", True))


class move_tool_beside(DriverAction):
    """Sends the point as a straight motion of the tool."""

    def createDescription(self) -> None:
        self.setDescription(MoveToolBeside(), self.__class__.__name__)

    def address(self) -> tuple[str, type]:
        return name_of(CARTESIAN, self.element("Robot"), self.element("Arm")), CartesianMotionAction

    def doing(self) -> str:
        return f"Moving the tool beside {self.label_of('Reference')}"

    def buildGoal(self) -> CartesianMotionGoal:
        frame, pose = pose_in_scene(self.wmi, self.element("Reference"))
        x, y, z = pose.position
        target = Pose((x + self.value("OffsetX"), y + self.value("OffsetY"), z + self.value("Height")), _DOWN)
        return CartesianMotionGoal(
            target=stamped(frame, target), speed=self.value("Speed"), max_force=self.value("MaxForce")
        )

    def onDone(self, status: int, msg: CartesianMotionResult) -> State:
        if status == GoalStatus.SUCCEEDED:
            return self.success(f"{self.doing()}: there")
        return self.failed(getattr(msg, "error_string", "") or self.status_text(), status)


class push(SkillBase):
    """Goes above the start of the push, down, straight to its end, and up."""

    def createDescription(self) -> None:
        self.setDescription(Push(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        start = {"Reference": "Object", "OffsetX": "StartX", "OffsetY": "StartY"}
        end = {"Reference": "Goal", "OffsetX": "GoalX", "OffsetY": "GoalY"}
        skill.setProcessor(Sequential())
        skill(
            self.skill("OpenGripper", ""),
            self.skill("MoveToolBeside", "", remap=start | {"Speed": "Approach"}, specify={"Height": _ABOVE}),
            self.skill("MoveToolBeside", "", remap=start | {"Speed": "Approach"}, specify={"Height": 0.0}),
            self.skill("MoveToolBeside", "", remap=end, specify={"Height": 0.0}),
            self.skill("LiftTool", "", specify={"Height": _ABOVE}, remap={"Speed": "Approach"}),
            self.skill(
                "WmSetRelation",
                "wm_set_relation",
                remap={"Src": "Object", "Dst": "Goal"},
                specify={"Relation": "skiros:at", "RelationState": True},
            ),
        )
