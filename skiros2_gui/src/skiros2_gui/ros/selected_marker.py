"""The interactive marker of the selected element: moving it in rviz moves the element in the world model."""

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
from skiros2_gui.core.dragging import Dragging, Target
from skiros2_gui.core.markers import Shown
from skiros2_gui.ros.marker_messages import interactive_marker, pose_message
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.geometry import Pose, normalized
from skiros2_world_model.core.world_model_abstract_interface import WmException
from skiros2_world_model.core.world_model_client import WorldModelAbstractInterface

log = logging.getLogger(__name__)

#: Of its topics `update`, `update_full` and `feedback`; below the node's namespace.
TOPIC = "skiros/selected"

#: Called with what was tried and why it failed.
OnProblem = Callable[[str, Exception], None]

_instances = itertools.count(1)


class _Server(InteractiveMarkerServer):  # type: ignore[misc]
    """One that ends quietly with the node."""

    def keepAlive(self, msg: Any) -> None:
        try:
            super().keepAlive(msg)
        except rospy.ROSException:
            if not rospy.core.is_shutdown_requested():
                raise


@functools.cache
def _server() -> InteractiveMarkerServer:
    """One for the process, for as long as it lives: it cannot be closed."""
    return _Server(TOPIC)


class SelectedMarker:
    """The marker of one element at a time, and a thread that writes where it is dragged. Safe to use from all threads.

    :param world: written to in a thread of this class.
    :param on_problem: `on_problem(what, error)` is called in that thread when an element could not be moved.
    """

    def __init__(
        self,
        world: WorldModelAbstractInterface,
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
        self._shown: Shown | None = None  # as the world model has it
        self._in_view: Shown | None = None  # what the marker was made of
        self._refusal = ""  # what has been told of this drag
        self._is_over = False
        self._writer: threading.Thread | None = None

    @property
    def chosen(self) -> str:
        """The id of the selected element, "" for none."""
        return self._chosen

    def select(self, eid: str) -> None:
        """This element is the selected one; its marker comes with `show`. "": none is."""
        with self._state:
            if eid != self._chosen:
                self._chosen = eid
                self._shown = None
                self._bring_up_to_date()

    def show(self, shown: Shown | None) -> None:
        """Where the world model has the selected element; None: nowhere. While it is dragged the marker stays."""
        with self._state:
            if self._is_over or (shown is not None and shown.id != self._chosen):
                return
            self._shown = shown
            if shown is None or not self._dragging.is_held(shown.id, self._clock()):
                self._bring_up_to_date()

    def close(self) -> None:
        """Writes what is left to write and takes the marker away. Waits for that."""
        with self._state:
            self._is_over = True
            self._chosen, self._shown = "", None
            self._dragging.release()
            self._bring_up_to_date()
            self._state.notify_all()
            writer = self._writer
        if writer is not None:
            writer.join()

    # -- under the lock -----------------------------------------------------------------------------------------

    def _bring_up_to_date(self) -> None:
        before, now = self._in_view, self._shown
        self._in_view = now
        if now is None and before is None:
            return
        server = _server()
        if before is not None and (now is None or now.id != before.id):
            server.erase(self._name(before))
        if now is not None:
            if before is None or (before.id, before.frame, before.look) != (now.id, now.frame, now.look):
                server.insert(interactive_marker(self._name(now), now), self._on_feedback)
            else:
                server.setPose(self._name(now), pose_message(now.pose))
        server.applyChanges()

    def _name(self, shown: Shown) -> str:
        """Of a marker: several windows, in one process or in some, may show the same element."""
        return f"{shown.id} {rospy.get_name()} {self._number}"

    # -- in the thread of the subscription ------------------------------------------------------------------------

    def _on_feedback(self, message: Any) -> None:
        with self._state:
            shown = self._in_view
            if shown is None or message.marker_name != self._name(shown) or self._is_over:
                return
            if message.event_type in (InteractiveMarkerFeedback.MOUSE_DOWN, InteractiveMarkerFeedback.KEEP_ALIVE):
                is_new = message.event_type == InteractiveMarkerFeedback.MOUSE_DOWN
                if is_new:
                    self._refusal = ""
                if is_new or self._dragging.is_held(shown.id, self._clock()):
                    self._dragging.hold(shown.id, self._clock())
                return
            if message.event_type not in (InteractiveMarkerFeedback.POSE_UPDATE, InteractiveMarkerFeedback.MOUSE_UP):
                return
            pose = _pose_of(message)
            if pose is None:
                log.warning("a view moves %s to %s: that is no pose; it is ignored", shown.id, message.pose)
            elif message.event_type == InteractiveMarkerFeedback.POSE_UPDATE and not shown.look.follows:
                frame = message.header.frame_id.lstrip("/") or shown.frame
                self._dragging.move(Target(shown.id, frame, pose), self._clock())
            if message.event_type == InteractiveMarkerFeedback.MOUSE_UP:
                self._dragging.release()
                if self._dragging.wait(self._clock()) is None:
                    self._bring_up_to_date()  # somebody else may have moved it meanwhile
            self._state.notify_all()
            if self._writer is None:
                self._writer = threading.Thread(target=self._write_all, name="moved elements", daemon=True)
                self._writer.start()

    # -- in the thread that writes --------------------------------------------------------------------------------

    def _write_all(self) -> None:
        while True:
            with self._state:
                wait = self._dragging.wait(self._clock())
                if wait is None and self._is_over:
                    return
                if wait is None or wait > 0.0:
                    self._state.wait(wait)
                target = self._dragging.take(self._clock())
            if target is not None:
                try:
                    self._write(target)
                except (SkirosError, rospy.ROSException, rospy.ServiceException) as error:
                    self._refused(target, error)

    def _write(self, target: Target) -> None:
        """
        :raises SkirosError: the world model refuses, or has no such element any more.
        """
        element = self._world.find_element(target.id)
        if element is None:
            raise WmException(f"{target.id} is not in the scene any more")
        space.set_pose(element, target.pose)
        if target.frame != space.text(element, space.BASE_FRAME).lstrip("/"):
            space.set_text(element, space.BASE_FRAME, target.frame)
        self._world.update_element(element)

    def _refused(self, target: Target, error: Exception) -> None:
        """Puts the marker back to where the element is, and says why, once for each drag."""
        with self._state:
            self._dragging.forget()
            if self._in_view is not None:
                self._bring_up_to_date()
            is_told, self._refusal = self._refusal == str(error), str(error)
        if is_told:
            return
        log.error("%s was not moved: %s", target.id, error)
        if self._on_problem is not None:
            self._on_problem(f"moving {target.id}", error)


def _pose_of(message: Any) -> Pose | None:
    """The pose of a feedback; None when it is none."""
    position, q = message.pose.position, message.pose.orientation
    numbers = (position.x, position.y, position.z, q.x, q.y, q.z, q.w)
    if not all(math.isfinite(number) for number in numbers) or not any(numbers[3:]):
        return None
    return Pose((position.x, position.y, position.z), normalized(numbers[3:]))
