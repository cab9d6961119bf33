"""A primitive for robots without a mobile base."""

from __future__ import annotations

import math

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_demo_skills.motions import MoveBase
from skiros2_sim_skills.core.places import approach_pose, pose_in_scene

#: Maximum distance (m) of a robot at a place.
_NEAR = 0.1


class stand_still(PrimitiveBase):
    """Succeeds if the robot stands at the place. Implements `MoveBase` for robots that cannot drive."""

    def createDescription(self) -> None:
        self.setDescription(MoveBase(), self.__class__.__name__)

    def execute(self) -> State:
        robot, place = self.params["Robot"].value, self.params["TargetLocation"].value
        try:
            here = pose_in_scene(self.wmi, self.wmi.get_element(robot.id))[1].position
            there = approach_pose(self.wmi, place)[1].position
        except SkirosError as error:
            return self.fail(f"Whether {robot.label} stands at {place.label} is not known: {error}", -1)
        far = math.dist(here[:2], there[:2])
        if far > _NEAR:
            return self.fail(f"{robot.label} cannot drive, and {place.label} is {far:.2f} m away", -2)
        return self.success(f"At {place.label}")
