"""Skills of the piston cell that a task manager plans with: take a part, put it down, insert a piston with two arms."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.skill_description import ParamOptions
from skiros2_common.core.world_element import Element
from skiros2_skill.core.processors import NoFail, ParallelFs, SelectorStar, SerialStar
from skiros2_skill.core.skill import SkillBase
from skiros2_std_reasoners.core.places import CONTAINER_STATE

Required, Inferred, Optional = ParamTypes.Required, ParamTypes.Inferred, ParamTypes.Optional

#: Property of a part: its pose in the world model is right.
LOCATED = "piston:Located"
#: Height of transfers above targets (m), and their speed (m/s).
_TRANSFER, _FAST = 0.12, 0.25
#: A transfer: fast, and with a tolerance that need not be settled.
SWING = {"Height": _TRANSFER, "Speed": _FAST, "Tolerance": 0.01}
#: A retreat: what has exceeded the usual limit of the force (N) may not be over yet.
RETREAT = {"MaxForce": 120.0, "Speed": _FAST}
#: Motion of the hand at which a held ring counts as slipping (m).
_SLIP = 0.004
#: Between the fingers that release the piston: they may be in the opening of the ring (m).
_RELEASED = 0.03
#: Time limit of putting down one part (s).
_PUT_DOWN_TIME = 60.0


class Handling(SkillDescription):
    """Base: an arm, its gripper, a part and a stand."""

    def add_arm(self, arm: str = "Arm", gripper: str = "Gripper", lock: bool = True) -> None:
        """Declares an arm with its gripper, which are inferred."""
        options = [ParamOptions.Lock] if lock else []
        self.addParam(arm, Element("rparts:ArmDevice"), Inferred, options, description="An arm of the robot")
        self.addParam(gripper, Element("rparts:GripperEffector"), Inferred, description="Its gripper")
        self.addPreCondition(self.getRelationCond(f"RobotHas{arm}", "skiros:hasA", "Robot", arm, True))
        self.addPreCondition(self.getRelationCond(f"{arm}Has{gripper}", "skiros:hasA", arm, gripper, True))

    def add_stand(
        self, stand: str = "Container", place: str = "Place", arm: str = "Arm", kind: str = "piston:Stand"
    ) -> None:
        """Declares an empty stand that the arm reaches, with its placing pose."""
        self.addParam(stand, Element(kind), Inferred, description="Where the part is put down")
        self.addParam(place, Element("skiros:PlacingPose"), Inferred, description="Its placing pose")
        self.addPreCondition(self.getRelationCond(f"{arm}Reaches{stand}", "piston:reaches", arm, stand, True))
        self.addPreCondition(self.getRelationCond(f"{stand}Has{place}", "skiros:hasA", stand, place, True))
        self.addPreCondition(self.getPropCond(f"{stand}Empty", CONTAINER_STATE, stand, "=", "Empty", True))

    def add_move(self, part: str, source: str, target: str) -> None:
        """Declares that a part is moved between containers, which are full and empty then."""
        self.addPreCondition(self.getRelationCond(f"{part}In{source}", "skiros:contain", source, part, True))
        self.addPostCondition(self.getRelationCond(f"{part}NotIn{source}", "skiros:contain", source, part, False))
        self.addPostCondition(self.getRelationCond(f"{part}In{target}", "skiros:contain", target, part, True))
        for container, old, new in ((source, "Full", "Empty"), (target, "Empty", "Full")):
            self.addPostCondition(self.getPropCond(f"{container}{new}", CONTAINER_STATE, container, "=", new, True))
            self.addPostCondition(self.getPropCond(f"{container}Not{old}", CONTAINER_STATE, container, "=", old, False))


class TakePart(Handling):
    """Takes a part from its stand."""

    def createDescription(self) -> None:
        self.set_duration(10.0)
        self.addParam("Part", Element("skiros:Product"), Required, description="The part to take")
        self.addParam("Container", Element("piston:Stand"), Inferred, description="Its stand")
        self.addParam("Grasp", Element("skiros:GraspingPose"), Inferred, description="Of the part")
        self.add_arm()
        self.addPreCondition(self.getRelationCond("ArmReachesContainer", "piston:reaches", "Arm", "Container", True))
        self.addPreCondition(self.getRelationCond("PartHasGrasp", "skiros:hasA", "Part", "Grasp", True))
        self.addPreCondition(self.getPropCond("GripperIsEmpty", CONTAINER_STATE, "Gripper", "=", "Empty", True))
        self.add_move("Part", "Container", "Gripper")
        holds = self.getRelationCond("GripperHoldsPart", "skiros:contain", "Gripper", "Part", True)
        self.set_on_preempt("PutDownPart", condition=holds, seconds=_PUT_DOWN_TIME)


class PutDownPart(Handling):
    """Puts a held part down on an empty stand, until contact."""

    def createDescription(self) -> None:
        self.is_reaction = True
        self.set_duration(10.0)
        self.addParam("Part", Element("skiros:Product"), Required, description="The held part")
        self.add_arm(lock=False)
        self.add_stand()
        self.add_move("Part", "Gripper", "Container")


class InsertPiston(Handling):
    """Inserts a held piston into a bore, while the other arm holds the ring around it; puts the ring down."""

    def createDescription(self) -> None:
        self.set_duration(30.0)
        self.addParam("Part", Element("piston:Piston"), Required, description="The held piston")
        self.addParam("Bore", Element("skiros:Bore"), Required, description="Where it goes")
        self.addParam("Ring", Element("piston:Ring"), Inferred, description="The held ring")
        self.addParam("Opening", Element("skiros:Bore"), Inferred, description="Of the ring")
        self.add_arm()
        self.add_arm("RingArm", "RingGripper")
        self.add_stand("RingStand", "RingPlace", "RingArm")
        self.addPreCondition(self.getRelationCond("RingHasOpening", "skiros:hasA", "Ring", "Opening", True))
        self.addParam("Block", Element("skiros:Product"), Inferred, description="What has the bore")
        self.addPreCondition(self.getRelationCond("BlockHasBore", "skiros:hasA", "Block", "Bore", True))
        self.addPreCondition(self.getPropCond("BlockIsLocated", LOCATED, "Block", "=", True, True))
        self.addPreCondition(self.getPropCond("BoreIsEmpty", CONTAINER_STATE, "Bore", "=", "Empty", True))
        self.add_move("Part", "Gripper", "Bore")
        self.add_move("Ring", "RingGripper", "RingStand")
        holds = self.getOrCond(True)
        holds.addCondition(self.getRelationCond("GripperHoldsPiston", "skiros:contain", "Gripper", "Part", True))
        holds.addCondition(self.getRelationCond("GripperHoldsRing", "skiros:contain", "RingGripper", "Ring", True))
        self.set_on_preempt("PutDownPistonAndRing", condition=holds, seconds=2.0 * _PUT_DOWN_TIME)


class PutDownPistonAndRing(SkillDescription):
    """Puts down the piston, which is in the ring, and then the ring."""

    def createDescription(self) -> None:
        self.is_reaction = True
        self.setAvailableForPlanning(False)
        for arm, gripper, part, kind in (
            ("Arm", "Gripper", "Part", "piston:Piston"),
            ("RingArm", "RingGripper", "Ring", "piston:Ring"),
        ):
            self.addParam(arm, Element("rparts:ArmDevice"), Required, description="An arm")
            self.addParam(gripper, Element("rparts:GripperEffector"), Required, description="Its gripper")
            self.addParam(part, Element(kind), Required, description="What it may hold")


class LocatePart(SkillDescription):
    """Measures the pose of a part with the camera of an arm, from several views."""

    def createDescription(self) -> None:
        self.set_duration(15.0)
        self.addParam("Object", Element("skiros:Product"), Required, description="The part; its size must be known")
        self.addParam("Arm", Element("rparts:ArmDevice"), Inferred, [ParamOptions.Lock], description="With the camera")
        self.addParam("Camera", Element("skiros:DepthCamera"), Inferred, description="On the arm")
        self.addParam("Gripper", Element("rparts:GripperEffector"), Inferred, description="Of the arm")
        self.addPreCondition(self.getRelationCond("RobotHasArm", "skiros:hasA", "Robot", "Arm", True))
        self.addPreCondition(self.getRelationCond("ArmHasCamera", "skiros:hasA", "Arm", "Camera", True))
        self.addPreCondition(self.getRelationCond("ArmHasGripper", "skiros:hasA", "Arm", "Gripper", True))
        # a held part would be in the view
        self.addPreCondition(self.getPropCond("GripperIsEmpty", CONTAINER_STATE, "Gripper", "=", "Empty", True))
        self.addPostCondition(self.getPropCond("ObjectIsLocated", LOCATED, "Object", "=", True, True))


class GuardBore(SkillDescription):
    """Holds the ring around a bore until it is preempted."""

    def createDescription(self) -> None:
        self.setAvailableForPlanning(False)
        self.addParam("RingArm", Element("rparts:ArmDevice"), Required, description="The arm with the ring")


class take_part(SkillBase):
    """Moves above the part, grasps it at its grasping pose and lifts it."""

    def createDescription(self) -> None:
        self.setDescription(TakePart(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(SerialStar())
        skill(
            self.skill("OpenGripper", ""),
            self.skill("ApproachGrasp", "", specify=SWING | {"ZeroSensor": True}),
            self.skill("ApproachGrasp", "", specify={"Height": 0.0}),
            self.skill("GripPart", ""),
            self.skill("RetractTool", "", specify=SWING),
        )


class put_down_part(SkillBase):
    """Lifts the part, moves it above the placing pose and down until contact, and releases it. After a failure the arm
    lifts it again: the next motion may be sideways, and the part in its seat."""

    def createDescription(self) -> None:
        self.setDescription(PutDownPart(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        there = {"Target": "Place"}
        skill.setProcessor(SelectorStar())
        skill(
            self.skill(SerialStar())(
                self.skill("RetractTool", "", specify={"Height": _TRANSFER, "Tolerance": 0.03}),
                self.skill("ApproachTarget", "", remap=there, specify=SWING | {"ZeroSensor": True}),
                self.skill("ApproachTarget", "", remap=there, specify={"Height": 0.02, "Tolerance": 0.01}),
                self.skill("MoveUntilContact", "", specify={"Speed": 0.01, "MaxDistance": 0.04, "NeedsContact": False}),
                self.skill("ReleasePart", ""),
                self.skill("RetractTool", "", specify=SWING),
            ),
            self.skill("RetractAfterFailure", "", specify=RETREAT | {"Height": _TRANSFER}),
        )


class put_down_piston_and_ring(SkillBase):
    """Puts down the held parts: the ring even if the piston cannot be put down."""

    def createDescription(self) -> None:
        self.setDescription(PutDownPistonAndRing(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        ring = {"Arm": "RingArm", "Part": "Ring", "Gripper": "RingGripper"}
        skill.setProcessor(SerialStar())
        skill(
            self.skill(NoFail(SerialStar()))(self.skill("PutDownPart", "")),
            self.skill("PutDownPart", "", remap=ring | {"Container": "RingStand", "Place": "RingPlace"}),
        )


class locate_part(SkillBase):
    """Moves the arm to its postures `look_left` and `look_right`, and fuses what the camera sees there."""

    def createDescription(self) -> None:
        self.setDescription(LocatePart(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(SerialStar())
        skill(
            self.skill("SwitchController", "", specify={"Compliant": False}),
            self.skill("MoveArmCollisionFree", "", specify={"Posture": "look_left"}),
            self.skill("EstimatePose", "", specify={"Fuse": False}),
            self.skill("MoveArmCollisionFree", "", specify={"Posture": "look_right"}),
            self.skill("EstimatePose", "", specify={"Fuse": True}),
            self.skill("WmSetProperties", "", remap={"Src": "Object"}, specify={"Properties": {LOCATED: True}}),
            self.skill("MoveArmCollisionFree", "", specify={"Posture": "home"}),
        )


class guard_bore(SkillBase):
    """Presses the ring on the block where it is; fails when the hand moves: the ring slips."""

    def createDescription(self) -> None:
        self.setDescription(GuardBore(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill(self.skill("HoldPose", "", remap={"Arm": "RingArm"}, specify={"Force": 5.0, "MaxDistance": _SLIP}))


class insert_piston(SkillBase):
    """One arm places the ring around the bore and holds it, the other one inserts through it and releases the piston.
    When the insertion fails or the ring slips, the piston is retracted."""

    def createDescription(self) -> None:
        self.setDescription(InsertPiston(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        ring = {"Arm": "RingArm", "Part": "Ring", "Gripper": "RingGripper"}
        around = ring | {"Target": "Bore", "Feature": "Opening"}
        above = {"Target": "Bore"}
        skill.setProcessor(SerialStar())
        skill(
            self.skill(SelectorStar())(
                self.skill(SerialStar())(
                    self.skill("ApproachTarget", "", remap=around, specify=SWING | {"ZeroSensor": True}),
                    self.skill("ApproachTarget", "", remap=around, specify={"Height": 0.02}),
                    self.skill(
                        "MoveUntilContact",
                        "",
                        remap=ring,
                        specify={"Speed": 0.01, "MaxDistance": 0.03, "ContactForce": 3.0},
                    ),
                    self.skill(ParallelFs())(
                        self.skill("GuardBore", ""),
                        self.skill(SerialStar())(
                            self.skill("ApproachTarget", "", remap=above, specify=SWING | {"ZeroSensor": True}),
                            self.skill("InsertIntoBore", ""),
                            self.skill("CheckGrip", ""),
                            self.skill("ReleasePart", "", remap={"Container": "Bore"}, specify={"Width": _RELEASED}),
                            self.skill("RetractTool", "", specify=SWING),
                            self.skill("CheckRelease", ""),
                        ),
                    ),
                ),
                # the piston may still be in the ring, also at the start, and must pass above it afterwards
                self.skill("RetractAfterFailure", "", specify=RETREAT | {"Height": 0.2}),
            ),
            self.skill("PutDownPart", "", remap=ring | {"Container": "RingStand", "Place": "RingPlace"}),
        )
