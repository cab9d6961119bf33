"""The interactive marker of the selected element: dragging it in rviz moves the element in the world model."""

from __future__ import annotations

import functools
import itertools
import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Any

import rospy
from interactive_markers.interactive_marker_server import InteractiveMarkerServer
from visualization_msgs.msg import InteractiveMarkerFeedback

from skiros2_common.core.errors import SkirosError
from skiros2_gui.view3d.dragging import Dragging, Target
from skiros2_gui.view3d.ros.marker_messages import interactive_marker, pose_message
from skiros2_live.core.markers import ElementMarker
from skiros2_motion.core.geometry import Pose, normalized
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model_client import WorldModelClient

log = logging.getLogger(__name__)

#: The prefix of the topics `update`, `update_full` and `feedback`; relative to the node's namespace.
TOPIC = "skiros/selected"

#: Called with the activity that failed and the error.
OnProblem = Callable[[str, Exception], None]

_instances = itertools.count(1)


class MarkerServer(InteractiveMarkerServer):  # type: ignore[misc]
    """A server that does not raise at shutdown."""

    def keepAlive(self, msg: Any) -> None:
        try:
            super().keepAlive(msg)
        except rospy.ROSException:
            if not rospy.core.is_shutdown_requested():
                raise


@functools.cache
def _server() -> InteractiveMarkerServer:
    """Returns the server of this process; it cannot be closed."""
    return MarkerServer(TOPIC)


class SelectedMarker:
    """The marker of one element, and a thread that writes its pose while it is dragged. Thread-safe.

    :param world: written to in a thread of this class.
    :param on_problem: `on_problem(activity, error)` is called in that thread when moving an element failed.
    """

    def __init__(
        self,
        world: WorldModelClient,
        on_problem: OnProblem | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._world = world
        self._on_problem = on_problem
        self._clock = clock
        self._number = next(_instances)
        self._state = threading.Condition()
        self._dragging = Dragging()
        self._chosen = ""
        self._marker: ElementMarker | None = None  # at the pose in the world model
        self._published: ElementMarker | None = None  # as published
        self._reported_error = ""  # of this drag
        self._is_finished = False
        self._writer: threading.Thread | None = None

    @property
    def chosen(self) -> str:
        """The id of the selected element; "" for none."""
        return self._chosen

    def select(self, eid: str) -> None:
        """Selects an element; "" for none. `show` adds its marker."""
        with self._state:
            if eid != self._chosen:
                self._chosen = eid
                self._marker = None
                self._update_server()

    def show(self, marker: ElementMarker | None) -> None:
        """Moves the marker to where the element is; None removes it. Ignored while the marker is dragged."""
        with self._state:
            if self._is_finished or (marker is not None and marker.id != self._chosen):
                return
            self._marker = marker
            if marker is None or not self._dragging.is_held(marker.id, self._clock()):
                self._update_server()

    def close(self) -> None:
        """Writes the pending target and removes the marker. Blocks until done."""
        with self._state:
            self._is_finished = True
            self._chosen, self._marker = "", None
            self._dragging.release()
            self._update_server()
            self._state.notify_all()
            writer = self._writer
        if writer is not None:
            writer.join()

    # -- with the lock held -----------------------------------------------------------------------------------------

    def _update_server(self) -> None:
        before, now = self._published, self._marker
        self._published = now
        if now is None and before is None:
            return
        server = _server()
        if before is not None and (now is None or now.id != before.id):
            server.erase(self._name(before))
        if now is not None:
            if before is None or (before.id, before.frame, before.visual) != (now.id, now.frame, now.visual):
                server.insert(interactive_marker(self._name(now), now), self._on_feedback)
            else:
                server.setPose(self._name(now), pose_message(now.pose))
        server.applyChanges()

    def _name(self, marker: ElementMarker) -> str:
        """Returns the name of a marker; unique, as several windows may show the same element."""
        return f"{marker.id} {rospy.get_name()} {self._number}"

    # -- in the thread of the subscription ------------------------------------------------------------------------

    def _on_feedback(self, message: Any) -> None:
        with self._state:
            marker = self._published
            if marker is None or message.marker_name != self._name(marker) or self._is_finished:
                return
            if message.event_type in (InteractiveMarkerFeedback.MOUSE_DOWN, InteractiveMarkerFeedback.KEEP_ALIVE):
                is_new = message.event_type == InteractiveMarkerFeedback.MOUSE_DOWN
                if is_new:
                    self._reported_error = ""
                if is_new or self._dragging.is_held(marker.id, self._clock()):
                    self._dragging.hold(marker.id, self._clock())
                return
            if message.event_type not in (InteractiveMarkerFeedback.POSE_UPDATE, InteractiveMarkerFeedback.MOUSE_UP):
                return
            pose = _pose_of(message)
            if pose is None:
                log.warning("%s: invalid pose from a view ignored: %s", marker.id, message.pose)
            elif message.event_type == InteractiveMarkerFeedback.POSE_UPDATE and not marker.visual.follows:
                frame = message.header.frame_id.lstrip("/") or marker.frame
                self._dragging.move(Target(marker.id, frame, pose), self._clock())
            if message.event_type == InteractiveMarkerFeedback.MOUSE_UP:
                self._dragging.release()
                if self._dragging.wait(self._clock()) is None:
                    self._update_server()  # it may have been moved meanwhile
            self._state.notify_all()
            if self._writer is None:
                self._writer = threading.Thread(target=self._write_all, name="moved elements", daemon=True)
                self._writer.start()

    # -- in the thread that writes --------------------------------------------------------------------------------

    def _write_all(self) -> None:
        while True:
            with self._state:
                wait = self._dragging.wait(self._clock())
                if wait is None and self._is_finished:
                    return
                if wait is None or wait > 0.0:
                    self._state.wait(wait)
                target = self._dragging.take(self._clock())
            if target is not None:
                try:
                    self._write(target)
                except (SkirosError, rospy.ROSException, rospy.ServiceException) as error:
                    self._on_refused(target, error)

    def _write(self, target: Target) -> None:
        """:raises SkirosError: the world model refuses, or the element does not exist."""
        element = self._world.find_element(target.id)
        if element is None:
            raise WmException(f"{target.id} is no longer in the scene")
        space.set_pose(element, target.pose)
        if target.frame != space.text(element, space.BASE_FRAME).lstrip("/"):
            space.set_text(element, space.BASE_FRAME, target.frame)
        self._world.update_element(element)

    def _on_refused(self, target: Target, error: Exception) -> None:
        """Moves the marker back to the element and reports the error, once per drag."""
        with self._state:
            self._dragging.forget()
            if self._published is not None:
                self._update_server()
            is_reported, self._reported_error = self._reported_error == str(error), str(error)
        if is_reported:
            return
        log.error("moving %s failed: %s", target.id, error)
        if self._on_problem is not None:
            self._on_problem(f"moving {target.id}", error)


def _pose_of(message: Any) -> Pose | None:
    """Returns the pose of a feedback message; None if it is invalid."""
    position, q = message.pose.position, message.pose.orientation
    numbers = (position.x, position.y, position.z, q.x, q.y, q.z, q.w)
    if not all(math.isfinite(number) for number in numbers) or not any(numbers[3:]):
        return None
    return Pose((position.x, position.y, position.z), normalized(numbers[3:]))
