"""Publishes the elements of the scene as markers for rviz; as a node, or as a part of the window."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import rosgraph
import rospy
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_common.ros.node import spin
from skiros2_gui.app.events import ProblemReported
from skiros2_gui.app.jobs import Throttle
from skiros2_gui.app.problems import error_text
from skiros2_gui.view3d.marker_set import MarkerSet, MarkerUpdate
from skiros2_gui.view3d.ros.guiding_markers import GuidingMarkers
from skiros2_gui.view3d.ros.marker_messages import deletions, element_markers, robot_marker
from skiros2_gui.view3d.ros.selected_marker import OnProblem, SelectedMarker
from skiros2_live.core.changed_elements import ChangedElements
from skiros2_live.core.markers import MarkerFactory, read_robot
from skiros2_live.ros.parameters import mesh_folders, robot_descriptions
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

log = logging.getLogger(__name__)

#: Relative to the node's namespace.
TOPIC = "skiros/markers"

#: The highest rate (Hz), and the largest shares of a core: of the markers, and of placing their labels, which concerns
#: all of them. Until then, the label of an element that has moved keeps its height above it.
RATE = 25.0
_SHARE, _LABEL_SHARE = 0.1, 0.02

#: The period of checks for robot descriptions, and the longest delay of labels (s).
_ROBOT_PERIOD = 2.0

#: The delay before reading the scene again after a failure (s).
_RETRY_DELAY = 1.0


class Markers:
    """Publishes the markers of all elements with a pose, and the interactive marker of the selected one.

    A new subscriber gets all markers, then changes only. Idle while there is no subscriber and no selected element.
    Works in its own threads; `select` does not block and may be called by any thread.

    :param world: has a replica of the scene; used in other threads than the caller's.
    :param folders: searched for meshes with relative names.
    :param on_problem: `on_problem(activity, error)` is called, in another thread, when moving an element failed.
    """

    def __init__(
        self, world: WorldModelInterface, folders: Sequence[str | Path] = (), on_problem: OnProblem | None = None
    ) -> None:
        self._world = world
        self._changed = ChangedElements()
        self._factory = MarkerFactory(world.is_subclass, folders)
        self._markers = MarkerSet(self._factory.make)
        self._send_lock = threading.Lock()  # guards the marker set and what was sent of it
        self._are_labels_stale = False
        self._ending = threading.Event()
        self._wanted = threading.Event()
        self._selected = SelectedMarker(world, on_problem)
        self._publisher = rospy.Publisher(TOPIC, MarkerArray, subscriber_listener=_NewSubscriber(self), queue_size=100)
        world.add_listener(self._changed.add)
        self._robots = RobotMarkers()
        self._placing = Throttle(_LABEL_SHARE)
        self._thread = threading.Thread(target=self._run, name="markers", daemon=True)
        self._thread.start()

    def select(self, eid: str) -> None:
        """Gives the interactive marker to this element; "" removes it."""
        self._selected.select(eid)
        self._changed.add_ids([eid] if eid else [])
        self._wanted.set()

    def close(self) -> None:
        """Deletes the markers, unless another node publishes them too. May be called twice."""
        if self._ending.is_set():
            return
        self._ending.set()
        self._changed.waiting.set()
        self._wanted.set()
        self._world.remove_listener(self._changed.add)
        self._thread.join()
        self._selected.close()
        with self._send_lock:
            if not _has_others(self._publisher.resolved_name):
                self._send(MarkerUpdate(removed=list(self._markers.all)))
                self._publisher.publish(MarkerArray(self._robots.removed()))
        self._publisher.unregister()

    # -- in the thread of the markers ---------------------------------------------------------------------------

    def _run(self) -> None:
        last_error = ""
        while True:
            if not self._publisher.get_num_connections() and not self._selected.chosen:
                self._wanted.wait()
            self._wanted.clear()
            self._changed.waiting.wait(_ROBOT_PERIOD)
            if self._ending.is_set():
                return
            self._show_robots()
            if not self._changed.waiting.is_set():
                self._place_labels()
                continue
            begin, spent = time.monotonic(), time.thread_time()
            pause = 1.0 / RATE
            try:
                with self._changed.read(self._world) as (elements, is_whole):
                    self._update(elements, is_whole)
                last_error = ""
            except (SkirosError, rospy.ROSException) as error:
                pause = _RETRY_DELAY
                if str(error) != last_error:  # logged once, not each second
                    log.warning("reading the scene failed; the markers are out of date: %s", error)
                last_error = str(error)
            pause = max(pause, (time.thread_time() - spent) / _SHARE)
            self._place_labels()  # has a share of its own
            self._ending.wait(max(0.0, begin + pause - time.monotonic()))

    def _update(self, elements: dict[str, Element | None], is_whole: bool) -> None:
        """Publishes the changes of these elements; see `ChangedElements.read`.

        :raises SkirosError: the world model does not answer.
        """
        if is_whole:
            self._factory.forget()
        with self._send_lock:
            if is_whole:
                self._send(self._markers.replace_all(filter(None, elements.values())))
            else:
                self._send(self._markers.replace(elements))
        self._are_labels_stale = True
        chosen = self._selected.chosen
        if chosen and (is_whole or chosen in elements):
            self._selected.show(self._markers.get(chosen))

    def _place_labels(self) -> None:
        if self._are_labels_stale and self._placing.is_ready:
            self._are_labels_stale = False
            self._placing.begin()
            with self._send_lock:
                self._send(self._markers.place_labels())
            self._placing.end()

    def _show_robots(self) -> None:
        """Publishes robots whose description was set or has changed."""
        if self._robots.is_due and self._publisher.get_num_connections():
            with self._send_lock:
                changed = self._robots.changed()
                if changed:
                    self._publisher.publish(MarkerArray(changed))

    def _send(self, update: MarkerUpdate) -> None:
        if update and self._publisher.get_num_connections():
            removed = [message for marker in update.removed for message in deletions(marker.visual)]
            changed = [message for marker in update.changed for message in element_markers(marker)]
            self._publisher.publish(MarkerArray([*removed, *changed]))

    # -- in the thread of a new subscriber -----------------------------------------------------------------------

    def publish_all(self, publish: Any) -> None:
        """Sends all markers to a new subscriber."""
        with self._send_lock:
            markers = [message for marker in self._markers.all for message in element_markers(marker)]
            publish(MarkerArray([*markers, *self._robots.all]))
        self._wanted.set()


class RobotMarkers:
    """The robots of all parameters `robot_description` as markers. Used under the lock of `Markers`.

    The parameter `tf_prefix` beside a description is the prefix of its tf frames.
    """

    def __init__(self) -> None:
        self._texts: dict[str, tuple[str, str]] = {}  # description and prefix, by name
        self._markers: dict[str, list[Marker]] = {}
        self._next_check = 0.0

    @property
    def all(self) -> list[Marker]:
        """The markers of all robots."""
        return [marker for markers in self._markers.values() for marker in markers]

    @property
    def is_due(self) -> bool:
        """Whether the parameters should be read again."""
        return time.monotonic() >= self._next_check

    def changed(self) -> list[Marker]:
        """Reads the parameters. Returns markers that are new or have changed, and deletions. Calls the master."""
        self._next_check = time.monotonic() + _ROBOT_PERIOD
        try:
            texts = robot_descriptions()
        except (OSError, rospy.ROSException):
            return []  # the master is down
        changes: list[Marker] = []
        for name in {*self._texts, *texts}:
            if texts.get(name) != self._texts.get(name):
                changes += self._deletions(name)
                self._markers[name] = _robot_markers(name, *texts[name]) if name in texts else []
                changes += self._markers[name]
        self._texts = texts
        return changes

    def removed(self) -> list[Marker]:
        """Returns the deletions of all markers."""
        return [marker for name in self._markers for marker in self._deletions(name)]

    def _deletions(self, name: str) -> list[Marker]:
        return [Marker(ns=m.ns, id=m.id, action=Marker.DELETE) for m in self._markers.get(name, ())]


def _robot_markers(name: str, text: str, prefix: str) -> list[Marker]:
    try:
        parts = read_robot(text, prefix)
    except WrongValue as error:
        log.warning("%s: %s", name, error)
        return []
    group = f"robot {name.rpartition('/')[0].strip('/')}".strip()
    return [robot_marker(part, group, number) for number, part in enumerate(parts)]


class _NewSubscriber(rospy.SubscribeListener):  # type: ignore[misc]
    def __init__(self, markers: Markers) -> None:
        super().__init__()
        self._markers = markers

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        self._markers.publish_all(peer_publish)


def _has_others(topic: str) -> bool:
    """Returns whether another node publishes a topic; True also if the master does not answer."""
    try:
        publishers, _, _ = rosgraph.Master(rospy.get_name()).getSystemState()
    except (OSError, rosgraph.MasterException):
        return True
    return any(node != rospy.get_name() for name, nodes in publishers if name == topic for node in nodes)


class MarkerConnection:
    """Publishes markers once the world model is up.

    :param on_event: called, in any thread, when moving an element in rviz failed.
    """

    def __init__(self, on_event: Callable[[ProblemReported], None]) -> None:
        self._on_event = on_event
        self._lock = threading.Lock()
        self._markers: Markers | None = None
        self._movable = ""
        self._is_closed = False

    def set_movable(self, eid: str) -> None:
        """Makes this element movable in rviz; "" for none. Any thread; does not block."""
        with self._lock:
            self._movable = eid
            if self._markers is not None:
                self._markers.select(eid)

    def check(self, world: WorldModelInterface | None) -> None:
        """Starts publishing when the world model is up. May call the master. Called by one thread."""
        if world is None or self._markers is not None or self._is_closed:
            return
        markers = Markers(world, mesh_folders(), self._on_problem)
        with self._lock:
            self._markers = markers
            markers.select(self._movable)
        if self._is_closed:
            markers.close()

    def close(self) -> None:
        """Deletes the markers. May call the master."""
        self._is_closed = True
        if self._markers is not None:
            self._markers.close()

    def _on_problem(self, activity: str, error: Exception) -> None:
        self._on_event(ProblemReported(activity, error_text(error)))


def main() -> None:
    """Runs the node until shutdown.

    The parameter `~selected` and the topic `~selected` name the element that gets the interactive marker. Markers at
    the tools guide simulated arms.
    """
    world = WorldModelInterface(rospy.get_name(), make_cache=True)
    markers = Markers(world, mesh_folders())
    chosen = rospy.get_param("~selected", "")
    if chosen:
        markers.select(str(chosen))
    rospy.Subscriber("~selected", String, lambda message: markers.select(message.data))
    guiding = GuidingMarkers(world)
    rospy.on_shutdown(guiding.close)
    rospy.on_shutdown(markers.close)
    spin()
