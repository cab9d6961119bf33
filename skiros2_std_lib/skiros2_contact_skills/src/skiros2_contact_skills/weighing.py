"""Evidence by weight: a part that was released no longer pulls at the wrist."""

from __future__ import annotations

import numpy as np

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.skill_description import ParamOptions
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.contact_primitive import NOT_RELEASED, ContactPrimitive, dot
from skiros2_contact_skills.descriptions import ContactMotion
from skiros2_contact_skills.fit import weight_of
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.geometry import IDENTITY, conjugated, inverted, rotated
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.places import move_in_world_model
from skiros2_std_reasoners.core.scene_poses import parent_of, pose_in_scene

#: Stiffness along the tool axis (N/m).
_STIFFNESS = 600.0
#: Time in which the arm comes to rest, and for which the force is measured (s).
_SETTLING, _MEASURING = 0.3, 0.4
#: The smallest weight that is judged (N): less is within the errors of a sensor and of an arm at rest. Part of the
#: weight that must be missing.
_LIGHTEST, _MISSING = 1.5, 0.5


class CheckRelease(ContactMotion):
    """Checks by its weight that a released part does not hang on the hand. The sensor must have been zeroed while the
    hand held the part, in this orientation."""

    def createDescription(self) -> None:
        self.add_arm(1000.0, 60.0)
        self.addParam("Part", Element("skiros:Product"), ParamTypes.Required, description="The released part")
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Required, description="That held it")
        self.addParam(
            "Evidence", dict, ParamTypes.Optional, [ParamOptions.Output], description="Result: see docs/contact.md"
        )


class check_release(ContactPrimitive):
    """Holds the pose and compares the change of the vertical force with the weight of the part. A part that still hangs
    on the hand is in the gripper again in the world model."""

    def createDescription(self) -> None:
        self.setDescription(CheckRelease(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        self.set_stiffness(_STIFFNESS)
        self.arm.set_reference(state.pose)
        self._weight = weight_of(self.element("Part"))
        _, base = pose_in_scene(self.wmi, self.element("Arm"))
        self._up = rotated(conjugated(base.orientation), (0.0, 0.0, 1.0))
        self._measured: list[float] = []

    def move(self, state: ArmState, dt: float) -> State:
        part = self.label_of("Part")
        if self._weight is None or self._weight < _LIGHTEST:
            known = "not known" if self._weight is None else f"{self._weight:.1f} N: too little to be felt"
            self._note("not judged", None)
            return self.success(f"The weight of {part} is {known}")
        passed = state.stamp - self.start.stamp
        if passed >= _SETTLING:
            self._measured.append(dot(self._up, state.wrench[:3]))
        if passed < _SETTLING + _MEASURING:
            return self.step(f"Weighing the hand: {passed:.1f} s")
        missing = float(np.mean(self._measured))
        text = f"{missing:.1f} N of the {self._weight:.1f} N of {part} are missing at the wrist"
        if missing >= _MISSING * self._weight:
            self._note("released", missing)
            return self.success(text)
        self._note("not released", missing)
        self._take_back()
        return self.fail(f"{text}: it still hangs on the hand", NOT_RELEASED)

    def _note(self, judgement: str, missing: float | None) -> None:
        found: dict[str, object] = {"judgement": judgement, "used": [] if missing is None else ["weight"]}
        for key, value in (("weight", self._weight), ("missing_weight", missing)):
            if value is not None:
                found[key] = value
        self.params["Evidence"].values = [found]

    def _take_back(self) -> None:
        """Moves the part into the gripper in the world model, at its grasping pose."""
        part, gripper = self.element("Part"), self.element("Gripper")
        holder = parent_of(self.wmi, part)
        if holder is not None and holder.id != gripper.id:
            grasps = (self.wmi.get_element(each["dst"]) for each in part.getRelations("-1", "skiros:hasA", ""))
            poses = (space.pose_of(grasp) for grasp in grasps if grasp.type == "skiros:GraspingPose")
            move_in_world_model(self.wmi, part, gripper, inverted(next(filter(None, poses), IDENTITY)))
