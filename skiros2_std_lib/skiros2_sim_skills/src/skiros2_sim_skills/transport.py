"""Descriptions of the skills of a mobile manipulator with a camera: drive, look, pick and place.

They add two conditions to those of the demo without physics: only one robot may be at a place (`demo:Free`), and a
robot may work only at an observed workstation (`demo:Observed`). Driving away, and a failed pick or place, reset
`demo:Observed`, so that the next plan starts with another look.
"""

from __future__ import annotations

from skiros2_common.core.params import ParamTypes
from skiros2_common.core.skill_description import ParamOptions
from skiros2_common.core.world_element import Element
from skiros2_demo_skills import transport_skills as timed
from skiros2_sim_skills.motions import ArmAndGripper

FREE = "demo:Free"
OBSERVED = "demo:Observed"
CONTAINER_STATE = timed.CONTAINER_STATE


class Drive(timed.Drive):
    """Drives the robot to a free place, with the object in the gripper."""

    def createDescription(self) -> None:
        super().createDescription()
        self.set_duration(8.0)
        self.addParam(
            "TargetLocation",
            Element("skiros:Location"),
            ParamTypes.Required,
            ParamOptions.Lock,
            description="The destination",
        )
        self.addPreCondition(self.getPropCond("TargetFree", FREE, "TargetLocation", "=", True, True))
        self.addPostCondition(self.getPropCond("TargetTaken", FREE, "TargetLocation", "=", True, False))
        self.addPostCondition(self.getPropCond("StartFree", FREE, "StartLocation", "=", True, True))
        self.addPostCondition(self.getPropCond("StartOutOfSight", OBSERVED, "StartLocation", "=", True, False))


class Look(ArmAndGripper):
    """Looks at the workstation in front of the robot, and updates the world model."""

    def createDescription(self) -> None:
        self.set_duration(4.0)
        self.addParam("Workstation", Element("demo:Workstation"), ParamTypes.Required, description="The workstation")
        self.add_arm_and_gripper()
        self.addParam("Camera", Element("skiros:DepthCamera"), ParamTypes.Inferred, description="The camera of the arm")
        self.addPreCondition(self.getRelationCond("ArmHasCamera", "skiros:hasA", "Arm", "Camera", True))
        at_workstation = self.getRelationCond("RobotAtWorkstation", "skiros:at", "Robot", "Workstation", True)
        self.addPreCondition(at_workstation)
        self.addHoldCondition(at_workstation)
        self.addPostCondition(self.getPropCond("WorkstationObserved", OBSERVED, "Workstation", "=", True, True))


class Pick(timed.Pick):
    """Picks an object at its observed pose on a workstation."""

    def createDescription(self) -> None:
        super().createDescription()
        self.set_duration(12.0)
        self.addPreCondition(self.getPropCond("WorkstationObserved", OBSERVED, "Workstation", "=", True, True))
        self.addPostCondition(self.getPropCond("StillObserved", OBSERVED, "Workstation", "=", True, True))
        self.addPostCondition(self.getPropCond("ContainerNotFull", CONTAINER_STATE, "Container", "=", "Full", False))


class Place(timed.Place):
    """Puts the object in the gripper into an empty tray, and checks that it is there."""

    def createDescription(self) -> None:
        super().createDescription()
        self.set_duration(14.0)
        self.addParam("Container", Element("demo:Tray"), ParamTypes.Required, description="The destination")
        self.addParam("Camera", Element("skiros:DepthCamera"), ParamTypes.Inferred, description="The camera of the arm")
        self.addPreCondition(self.getRelationCond("ArmHasCamera", "skiros:hasA", "Arm", "Camera", True))
        self.addPreCondition(self.getPropCond("WorkstationObserved", OBSERVED, "Workstation", "=", True, True))
        self.addPreCondition(self.getPropCond("ContainerNotFull", CONTAINER_STATE, "Container", "=", "Full", False))
        self.addPostCondition(self.getPropCond("StillObserved", OBSERVED, "Workstation", "=", True, True))
        self.addPostCondition(self.getPropCond("ContainerFull", CONTAINER_STATE, "Container", "=", "Full", True))
