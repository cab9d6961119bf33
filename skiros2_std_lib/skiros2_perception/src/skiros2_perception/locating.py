"""The pose of a known object from a depth camera."""

from __future__ import annotations

import math

import numpy as np

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_perception.camera_skill import CameraSkill
from skiros2_perception.core import confidence
from skiros2_perception.core.fusion import Estimate, check_determined, estimate_of, fused
from skiros2_perception.core.objects import (
    check_movable,
    known_object,
    model_of,
    stored_estimate,
    write_estimate,
)
from skiros2_perception.core.pose_estimation import registered
from skiros2_perception.core.registration import Limits
from skiros2_perception.core.transforms import difference
from skiros2_perception.core.view import Sensor, View
from skiros2_perception.ros.models import model_file


class EstimatePose(SkillDescription):
    """Estimates the pose of an object from one view of a depth camera, and updates the world model.

    The camera is where the arm holds it: nothing moves. With `Fuse`, the view is fused with the estimate in the world
    model, so that a tree that moves the arm in between fuses views from several sides.
    """

    def createDescription(self) -> None:
        self.addParam("Camera", Element("skiros:DepthCamera"), ParamTypes.Required, description="The camera")
        self.addParam("Object", Element("sumo:Object"), ParamTypes.Required, description="Its size must be known")
        self.addParam(
            "Fuse", False, ParamTypes.Optional, description="Whether to fuse the view with the previous estimate"
        )
        self.addParam(
            "MaxShift",
            0.05,
            ParamTypes.Optional,
            description="Largest distance from the pose in the world model",
            unit="m",
            minimum=0.001,
            maximum=0.5,
        )
        self.addParam(
            "MaxTurn",
            25.0,
            ParamTypes.Optional,
            description="Largest angle from the pose in the world model",
            unit="deg",
            minimum=0.1,
            maximum=180.0,
        )
        self.addParam(
            "Timeout", 5.0, ParamTypes.Optional, description="Limit of the wait for a view", unit="s", minimum=0.0
        )


class estimate_pose(CameraSkill):
    """Registers the depth image with the shape of the object. A bad registration fails with all reasons, and changes
    nothing."""

    def createDescription(self) -> None:
        self.setDescription(EstimatePose(), self.__class__.__name__)

    def prepare(self) -> str:
        element = self.wmi.get_element(self.element("Object").id)
        check_movable(self.wmi, element)
        model = model_of(element)
        self._known = known_object(self.wmi, element, model_file(model) if model else None)
        self._before = stored_estimate(self.wmi, element) if self.params["Fuse"].value else None
        return self._known.frame

    def compute(self, view: View, sensor: Sensor) -> Estimate:
        limits = Limits(shift=self.params["MaxShift"].value, turn=math.radians(self.params["MaxTurn"].value))
        found = estimate_of(registered(self._known.shape, view, sensor, self._known.pose, limits))
        estimate = found if self._before is None else fused(self._before, found)
        check_determined(estimate)
        return estimate

    def write(self, result: Estimate) -> str:
        write_estimate(self.wmi, self._known.id, result, confidence.seen(self._known.confidence, 1.0))
        error = difference(result.pose, self._known.pose)
        position, angle = result.deviations
        return (
            f"{self._known.label}: moved by {np.linalg.norm(error[:3]) * 1000:.1f} mm and"
            f" {math.degrees(float(np.linalg.norm(error[3:]))):.1f} degrees in the world model; standard deviations"
            f" {position * 1000:.2f} mm and {math.degrees(angle):.2f} degrees; {result.fitness:.0%} of the points"
            f" match, {result.residual * 1000:.2f} mm from the shape; {result.views} views"
        )
