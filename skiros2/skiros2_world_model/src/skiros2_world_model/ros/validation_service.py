"""The service `~validation`."""

from __future__ import annotations

import rospy

from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.changes import SCENE
from skiros2_world_model.core.validator import Validator
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.ros.errors import service_handler


class ValidationService:
    """The service, and the validation of each loaded file unless the parameter `~validate` is false."""

    def __init__(self, model: WorldModel) -> None:
        self._validator = Validator(model)
        rospy.on_shutdown(self._validator.stop)
        self._validates_files = bool(rospy.get_param("~validate", True))
        self._service = rospy.Service("~validation", srvs.WmValidation, service_handler(self._on_validation))
        for context in model.loaded:
            self.file_loaded(context)

    def file_loaded(self, context: str) -> None:
        """Validates the file that was loaded into a context."""
        if self._validates_files:
            self._validator.file_loaded(context)

    def _on_validation(self, request: srvs.WmValidationRequest) -> srvs.WmValidationResponse:
        context = request.context or SCENE
        report = self._validator.file_report(context) if request.loaded else self._validator.validate_context(context)
        findings = [msgs.WmFinding(f.severity, f.element, f.property, f.file, f.text) for f in report.findings]
        return srvs.WmValidationResponse(rospy.Time.from_sec(report.stamp), findings)
