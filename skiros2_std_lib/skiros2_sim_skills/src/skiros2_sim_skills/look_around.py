"""A primitive for the camera: calls its detection service."""

from __future__ import annotations

import math

import rospy
from geometry_msgs.msg import Pose as PoseMessage

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import SkirosError
from skiros2_motion.core.geometry import Pose, normalized
from skiros2_sim_msgs.srv import Detect, DetectRequest, DetectResponse
from skiros2_sim_skills.core.sight import expected_at, findings
from skiros2_sim_skills.motions import DetectObjects
from skiros2_std_reasoners.core.places import move_in_world_model
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from skiros2_std_skills.core.devices import DETECT, name_of
from skiros2_std_skills.drivers import NOT_KNOWN, DriverService


class detect_objects(DriverService):
    """Detects objects, once more if an expected one is not visible, and updates the world model."""

    def createDescription(self) -> None:
        self.setDescription(DetectObjects(), self.__class__.__name__)

    def onStart(self) -> bool:
        self._may_ask_again = True
        return super().onStart()

    def buildClient(self) -> rospy.ServiceProxy:
        return rospy.ServiceProxy(name_of(DETECT, self.element("Robot"), self.element("Camera")), Detect)

    def buildRequest(self) -> DetectRequest:
        frame, _ = pose_in_scene(self.wmi, self.element("Workstation"))
        return DetectRequest(camera=self.element("Camera").id, frame=frame)

    def onDone(self, response: DetectResponse) -> State:
        if not response.ok:
            return self.fail(f"{self.label_of('Camera')} detected nothing: {response.message}", -1)
        seen = {d.id: _pose(d.pose.pose) for d in response.detections if _is_pose(d.pose.pose)}
        try:
            missing = [e.label for e in expected_at(self.wmi, self.element("Workstation")) if e.id not in seen]
            if missing and self._may_ask_again:
                self._may_ask_again = False
                super().onStart()
                return self.step(f"Not in view: {', '.join(missing)}; looking again")
            return self.success(self._write_findings(seen))
        except SkirosError as error:
            return self.fail(f"{self.label_of('Camera')}: {error}", NOT_KNOWN)

    def _write_findings(self, seen: dict[str, Pose]) -> str:
        """Updates the world model. Returns a summary of the changes.

        :raises SkirosError: the world model rejects a change.
        """
        found = findings(self.wmi, self.element("Workstation"), seen)
        for finding in found:
            move_in_world_model(self.wmi, finding.thing, finding.holder, finding.pose)
        news = [str(finding) for finding in found if finding.is_change]
        return "; ".join(news) if news else f"As expected: {len(found)} objects in view"


def _pose(message: PoseMessage) -> Pose:
    position, orientation = message.position, message.orientation
    return Pose(
        (position.x, position.y, position.z), normalized((orientation.x, orientation.y, orientation.z, orientation.w))
    )


def _is_pose(message: PoseMessage) -> bool:
    """Whether all numbers are finite."""
    p, q = message.position, message.orientation
    return all(map(math.isfinite, (p.x, p.y, p.z, q.x, q.y, q.z, q.w)))
