"""Comparing a view of a depth camera with the world model."""

from __future__ import annotations

import logging

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_perception.camera_skill import CameraSkill
from skiros2_perception.core.observation import Observation, observe
from skiros2_perception.core.scene_update import MANIPULATABLE, scene_objects, update_scene
from skiros2_perception.core.view import Sensor, View
from skiros2_std_reasoners.core.scene_poses import ancestors, pose_in_scene

log = logging.getLogger(__name__)


class ObserveScene(SkillDescription):
    """Compares one view of a depth camera with the world model.

    Objects that are seen get their measured pose; an object that should be in view and is not there loses confidence; a
    thing that matches no object becomes a new element. The camera is where the arm holds it: nothing moves.
    """

    def createDescription(self) -> None:
        self.addParam("Camera", Element("skiros:DepthCamera"), ParamTypes.Required, description="The camera")
        self.addParam(
            "Place",
            Element("sumo:Object"),
            ParamTypes.Optional,
            description="Contains new objects; unset: the root of the scene",
        )
        self.addParam(
            "Class", MANIPULATABLE, ParamTypes.Optional, description="Class of the known objects that are looked for"
        )
        self.addParam(
            "Timeout", 5.0, ParamTypes.Optional, description="Limit of the wait for a view", unit="s", minimum=0.0
        )


class observe_scene(CameraSkill):
    """Segments the depth image, and associates its clusters with the objects of the world model."""

    needs_colours = True

    def createDescription(self) -> None:
        self.setDescription(ObserveScene(), self.__class__.__name__)

    def prepare(self) -> str:
        kind = self.params["Class"].value
        if not self.wmi.is_subclass(kind, MANIPULATABLE):
            raise WrongValue(f"class {kind!r}: expected {MANIPULATABLE} or a subclass")
        self._objects = scene_objects(self.wmi, kind)
        for problem in self._objects.problems:
            log.warning("not compared with the view: %s", problem)
        place = self.params["Place"].value
        root = ancestors(self.wmi, self.wmi.get_element(self.element("Camera").id))[-1]
        self._place = root.id if place is None or place.isAbstract() else place.id
        return pose_in_scene(self.wmi, root)[0]

    def compute(self, view: View, sensor: Sensor) -> Observation:
        return observe(view, sensor, self._objects.known, self._objects.fixed, self._objects.measured)

    def write(self, result: Observation) -> str:
        return str(update_scene(self.wmi, result, self._objects, self._place))
