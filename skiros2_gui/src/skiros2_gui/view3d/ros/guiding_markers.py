"""Interactive markers at the tools of simulated arms: dragging one guides the arm by hand, with a limited force."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Sequence
from typing import Any

import roslib.message
import rospy
from visualization_msgs.msg import InteractiveMarkerFeedback

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.world_element import Element
from skiros2_gui.view3d.guiding import HandGuiding
from skiros2_gui.view3d.ros.marker_messages import guiding_marker
from skiros2_gui.view3d.ros.selected_marker import MarkerServer
from skiros2_motion.core.geometry import Vector
from skiros2_world_model.core.world_model_client import WorldModelClient
from skiros2_world_model.ros.service_pool import ServicePool

log = logging.getLogger(__name__)

#: The prefix of the topics `update`, `update_full` and `feedback`; relative to the node's namespace.
TOPIC = "skiros/guiding"

#: The services of the simulator and their types; its package need not be installed with the window.
_GET_POSE, _PUSH = ("sim/get_pose", "skiros2_sim_msgs/GetPose"), ("sim/push", "skiros2_sim_msgs/Push")
#: The period of forces and markers (s of ROS time), and of checks for a simulator or a view (s).
_PERIOD, _IDLE_PERIOD = 0.1, 1.0
#: The class of the tools.
_TOOL = "rparts:GripperEffector"

_EVENTS = InteractiveMarkerFeedback


class GuidingMarkers:
    """A marker for each gripper of the scene, in a thread of its own, until `close`.

    A marker is where its tool is; while it is dragged, a spring pulls the tool towards it. Idle while no view is
    connected, and without a simulator: a real arm is guided by hand. One object per process.

    :param world: names the grippers; used in the thread of this class.
    """

    def __init__(self, world: WorldModelClient) -> None:
        self._world = world
        self._lock = threading.Lock()  # guards the hands
        self._hands: dict[str, HandGuiding] = {}
        self._frames: dict[str, str] = {}
        self._problem = ""
        self._ending = threading.Event()
        self._server = MarkerServer(TOPIC)
        self._thread = threading.Thread(target=self._run, name="guiding markers", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends all forces. Blocks until the thread has ended."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        kinds = [roslib.message.get_service_class(kind) for _, kind in (_GET_POSE, _PUSH)]
        if None in kinds:
            log.info("arms are not guided by markers: the package skiros2_sim_msgs is not installed")
            return
        services = [ServicePool(name, kind, 0.0) for (name, _), kind in zip((_GET_POSE, _PUSH), kinds, strict=True)]
        get_pose, push = ((pool, kind._request_class) for pool, kind in zip(services, kinds, strict=True))
        pause, last = _PERIOD / 2.0, float("-inf")
        while not self._ending.wait(pause):
            pause = _IDLE_PERIOD
            now = rospy.get_time()
            if not self._server.update_pub.get_num_connections():
                continue
            if 0.0 <= now - last < _PERIOD:  # forces of two periods would add up
                pause = _PERIOD / 5.0
                continue
            try:
                for eid, label in self._tools():
                    self._guide(eid, label, get_pose, push)
                self._server.applyChanges()
                self._problem, last, pause = "", now, _PERIOD / 5.0
            except (SkirosError, rospy.ROSException) as error:
                self._remove_all()
                if self._problem != str(error):  # logged once, not each second
                    log.info("arms are not guided by markers: %s", error)
                self._problem = str(error)
        for pool in services:
            pool.close()

    def _tools(self) -> Sequence[tuple[str, str]]:
        """Returns the ids and labels of the grippers."""
        return [(tool.id, tool.label or tool.id) for tool in self._world.resolve_elements(Element(_TOOL))]

    def _guide(self, eid: str, label: str, get_pose: tuple[Any, Any], push: tuple[Any, Any]) -> None:
        """Applies the force of a dragged marker; moves any other one to its tool.

        :raises SkirosError: the simulator does not answer, or refuses the force.
        """
        service, request = get_pose
        answer = service.call(request(element=eid))
        if not answer.ok:
            return  # not in the simulated world
        pose, name = answer.pose.pose, self._name(eid)
        position = (pose.position.x, pose.position.y, pose.position.z)
        with self._lock:
            hand = self._hands.setdefault(eid, HandGuiding())
            force = hand.force(position, time.monotonic())
        if self._frames.get(eid) != answer.pose.header.frame_id:
            self._frames[eid] = answer.pose.header.frame_id
            marker = guiding_marker(name, f"Guide {label}", self._frames[eid])
            marker.pose.position = pose.position
            self._server.insert(marker, lambda message: self._on_feedback(eid, message))
        if force is None:
            self._server.setPose(name, _upright(pose))
            return
        service, request = push
        message = request(element=eid, duration=rospy.Duration.from_sec(_PERIOD))
        message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = force
        answer = service.call(message, False)
        if not answer.ok:
            log.warning("%s is not guided: %s", label, answer.message)

    def _remove_all(self) -> None:
        for eid in self._frames:
            self._server.erase(self._name(eid))
        self._frames.clear()
        self._server.applyChanges()

    def _name(self, eid: str) -> str:
        """Returns the name of a marker; unique, as several nodes may show the same tool."""
        return f"{eid} {rospy.get_name()}"

    # -- in the thread of the subscription ------------------------------------------------------------------------

    def _on_feedback(self, eid: str, message: Any) -> None:
        now, frame = time.monotonic(), self._frames.get(eid, "")
        with self._lock:
            hand = self._hands[eid]
            if message.event_type == _EVENTS.MOUSE_UP:
                hand.release()
            elif message.event_type == _EVENTS.KEEP_ALIVE:
                hand.hold(now)
            elif message.event_type == _EVENTS.POSE_UPDATE:
                position = _position(message)
                if position is None or message.header.frame_id.lstrip("/") not in ("", frame):
                    hand.release()
                    log.warning("%s: expected a finite position in %r, got %s", eid, frame, message)
                else:
                    hand.drag(position, now)


def _position(message: Any) -> Vector | None:
    """Returns the position of a feedback message; None if it is invalid."""
    point = message.pose.position
    return (point.x, point.y, point.z) if all(map(math.isfinite, (point.x, point.y, point.z))) else None


def _upright(pose: Any) -> Any:
    """Returns a pose message with the same position along the axes of the map."""
    x, y, z = pose.position.x, pose.position.y, pose.position.z
    upright = type(pose)()
    upright.position.x, upright.position.y, upright.position.z = x, y, z
    upright.orientation.w = 1.0
    return upright
