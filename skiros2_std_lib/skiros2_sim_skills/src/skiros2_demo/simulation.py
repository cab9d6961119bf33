"""The demo's client of the simulator: true poses, pictures and disturbances."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import rospy
from geometry_msgs.msg import Point, PoseStamped
from PIL import Image as Picture
from sensor_msgs.msg import Image

from skiros2_bags.core.run import Finding
from skiros2_common.core.errors import Refused, TimedOut
from skiros2_demo.ground_truth import Body, check_placement
from skiros2_demo.world_state import Thing
from skiros2_sim_msgs.msg import Contacts
from skiros2_sim_msgs.srv import GetPose, SetFault, SetFaultRequest, SetPose, TakePicture
from skiros2_std_reasoners.core.geometry import Pose, Vector

#: Timeout of a camera image (s).
PICTURE_TIMEOUT = 5.0


class Simulation:
    """A client of the simulator. Needs an initialised node."""

    def __init__(self) -> None:
        self._contacts: list[Any] = []
        self._lock = threading.Lock()
        rospy.Subscriber("sim/contacts", Contacts, self._on_contacts)

    def is_ready(self) -> bool:
        """Whether the simulator is running."""
        try:
            rospy.wait_for_service("sim/get_pose", 0.01)
        except rospy.ROSException:
            return False
        return True

    def pose_of(self, element: str) -> Pose:
        """Returns the true pose of an element in the map.

        :raises Refused: it is not in the simulated world.
        """
        return _pose(self._call("get_pose", GetPose, element=element).pose.pose)

    def check_placement(self, product: Thing, tray: Thing) -> list[Finding]:
        """Checks that a product lies in a tray; see `ground_truth.check_placement`.

        :raises Refused: one of them is not in the simulated world.
        """
        answer = self._call("get_pose", GetPose, element=product.id)
        with self._lock:
            pairs = [(contact.first, contact.second) for contact in self._contacts]
        touching = {other for pair in pairs if product.id in pair for other in pair if other != product.id}
        return check_placement(
            Body(product.name, _pose(answer.pose.pose), product.size),
            Body(tray.name, self.pose_of(tray.id), tray.size),
            _vector(answer.twist.linear),
            _vector(answer.twist.angular),
            {other for other in touching if "/" in other},  # ROBOT/LINK, where things have ids
        )

    def put(self, element: str, pose: Pose) -> None:
        """Moves an element to a pose in the map.

        :raises Refused: the simulator rejects it.
        """
        target = PoseStamped()
        (target.pose.position.x, target.pose.position.y, target.pose.position.z) = pose.position
        turn = target.pose.orientation
        turn.x, turn.y, turn.z, turn.w = pose.orientation
        self._call("set_pose", SetPose, element=element, pose=target)

    def slip(self, gripper: str, active: bool) -> None:
        """Starts or ends the slipping of a gripper.

        :raises Refused: the simulator rejects it.
        """
        self._call("set_fault", SetFault, kind=SetFaultRequest.SLIPPING_GRIPPER, target=gripper, active=active)

    def take_picture(self, file: Path, eye: Vector, target: Vector) -> Path:
        """Saves a picture of the world from a given camera position.

        :raises Refused: the simulator rejects it.
        """
        return _saved(self._call("take_picture", TakePicture, eye=Point(*eye), target=Point(*target)).image, file)

    def take_robots_picture(self, file: Path, topic: str) -> Path:
        """Saves an image of the robot's camera.

        :raises TimedOut: there is no image.
        """
        try:
            return _saved(rospy.wait_for_message(topic, Image, PICTURE_TIMEOUT), file)
        except rospy.ROSException:
            raise TimedOut(f"no picture came on {topic} within {PICTURE_TIMEOUT:g} s") from None

    def _call(self, name: str, service: Any, **request: Any) -> Any:
        answer = rospy.ServiceProxy(f"sim/{name}", service)(**request)
        if not answer.ok:
            raise Refused(f"sim/{name}: {answer.message}")
        return answer

    def _on_contacts(self, message: Any) -> None:
        with self._lock:
            self._contacts = message.contacts


def _saved(image: Any, file: Path) -> Path:
    if image.encoding != "rgb8":
        raise Refused(f"{file.name}: the picture is {image.encoding}, expected rgb8")
    rows = (bytes(image.data), "raw", "RGB", image.step, 1)
    Picture.frombytes("RGB", (image.width, image.height), *rows).save(file)
    return file


def _pose(message: Any) -> Pose:
    turn = message.orientation
    return Pose(_vector(message.position), (turn.x, turn.y, turn.z, turn.w))


def _vector(message: Any) -> Vector:
    return message.x, message.y, message.z
