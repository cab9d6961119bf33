"""Primitives that grip and release parts, and update the world model."""

from __future__ import annotations

from control_msgs.msg import GripperCommandGoal, GripperCommandResult
from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.core.evidence import NOTHING_BETWEEN
from skiros2_contact_skills.held_parts import leave_where_it_was_lost
from skiros2_motion.core.geometry import IDENTITY, Pose, composed, inverted
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.places import move_in_world_model
from skiros2_std_reasoners.core.scene_poses import parent_of, pose_in_scene, size_of
from skiros2_std_skills.core.devices import opening
from skiros2_std_skills.drivers import NOT_KNOWN
from skiros2_std_skills.gripper_motion import NOT_HELD, GripperMotion


class GripPart(SkillDescription):
    """Closes the gripper on a part at its grasping pose."""

    def createDescription(self) -> None:
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Required, description="The gripper")
        self.addParam("Part", Element("skiros:Product"), ParamTypes.Required, description="The part")
        self.addParam("Grasp", Element("skiros:GraspingPose"), ParamTypes.Required, description="Where it is gripped")
        self.addParam("Effort", 40.0, ParamTypes.Optional, description="Of each finger", unit="N", minimum=1.0)


class CheckGrip(SkillDescription):
    """Checks that a part is still between the fingers."""

    def createDescription(self) -> None:
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Required, description="The gripper")
        self.addParam("Part", Element("skiros:Product"), ParamTypes.Required, description="The held part")
        self.addParam("Effort", 40.0, ParamTypes.Optional, description="Of each finger", unit="N", minimum=1.0)


class ReleasePart(SkillDescription):
    """Opens the gripper; the part is then in its container."""

    def createDescription(self) -> None:
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Required, description="The gripper")
        self.addParam("Part", Element("skiros:Product"), ParamTypes.Required, description="The held part")
        self.addParam("Container", Element("sumo:Object"), ParamTypes.Required, description="Where the part is then")
        self.addParam(
            "Place",
            Element("skiros:PlacingPose"),
            ParamTypes.Optional,
            description="Of the container, on which the lower end of the part rests then; none: the part stays there",
        )
        self.addParam(
            "Width", 0.0, ParamTypes.Optional, description="Between the fingers; 0: fully open", unit="m", minimum=0.0
        )


class check_grip(GripperMotion):
    """Closes the fingers on the part."""

    def createDescription(self) -> None:
        self.setDescription(CheckGrip(), self.__class__.__name__)

    def doing(self) -> str:
        return f"Holding {self.label_of('Part')}"

    def buildGoal(self) -> GripperCommandGoal:
        return self.grip()

    #: Of the failure if nothing is between the fingers.
    kind = FailureKind.LOST

    def onDone(self, status: int, msg: GripperCommandResult) -> State:
        if not self.ended_well(status, msg):
            return self.failed(self.status_text(), status)
        if msg.position <= NOTHING_BETWEEN:
            text = f"{self.label_of('Part')} is not between the fingers: they have closed"
            if self.kind is FailureKind.LOST:
                text = f"{text}; {leave_where_it_was_lost(self.wmi, self.element('Part'))}"
            return self.fail(text, NOT_HELD, self.kind)
        return self.success(f"{self.doing()}: {1000 * msg.position:.0f} mm between the fingers")


class grip_part(check_grip):
    """Closes the fingers, and moves the part into the gripper in the world model, at its grasping pose."""

    kind = FailureKind.RETRYABLE

    def createDescription(self) -> None:
        self.setDescription(GripPart(), self.__class__.__name__)

    def doing(self) -> str:
        return f"Gripping {self.label_of('Part')}"

    def onDone(self, status: int, msg: GripperCommandResult) -> State:
        if (held := super().onDone(status, msg)) is not State.Success:
            return held
        grasp = space.pose_of(self.element("Grasp")) or IDENTITY
        try:
            move_in_world_model(self.wmi, self.element("Part"), self.element("Gripper"), inverted(grasp))
        except SkirosError as error:
            return self.fail(str(error), NOT_KNOWN)
        return held


class release_part(GripperMotion):
    """Opens the fingers, and moves the part into the container in the world model, where it was released."""

    def createDescription(self) -> None:
        self.setDescription(ReleasePart(), self.__class__.__name__)

    def doing(self) -> str:
        return f"Releasing {self.label_of('Part')}"

    def buildGoal(self) -> GripperCommandGoal:
        return self.command(self.value("Width") or opening(self.element("Gripper")), 0.0)

    def onDone(self, status: int, msg: GripperCommandResult) -> State:
        part, container = self.element("Part"), self.element("Container")
        holder = parent_of(self.wmi, part)
        if status != 3 or holder is None:
            return self.failed(self.status_text() or f"{self.label_of('Part')} is nowhere", status)
        try:
            target = pose_in_scene(self.wmi, container)[1]
            pose = composed(inverted(target), pose_in_scene(self.wmi, part)[1])
            place = space.pose_of(self.params["Place"].value) if self.params["Place"].values else None
            if place is not None:  # it may have touched the edge of its seat, and has fallen down
                x, y, _ = pose.position
                pose = Pose((x, y, place.position[2] + size_of(part)[2] / 2.0), pose.orientation)
            move_in_world_model(self.wmi, part, container, pose)
        except SkirosError as error:
            return self.fail(str(error), NOT_KNOWN)
        return self.success(f"{self.label_of('Part')} is in {self.label_of('Container')}")
