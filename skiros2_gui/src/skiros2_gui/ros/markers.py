"""The elements of the scene as markers on a topic, for rviz; also without a window, as a node of its own."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rosgraph
import rospy
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.world_element import Element
from skiros2_common.ros.shutdown import spin
from skiros2_gui.core.marker_board import ChangedElements, Difference, MarkerBoard
from skiros2_gui.core.markers import Showing, Shown
from skiros2_gui.ros.marker_messages import PackedMarkers
from skiros2_gui.ros.selected_marker import OnProblem, SelectedMarker
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

log = logging.getLogger(__name__)

#: Below the node's namespace, so that it moves with the whole system.
TOPIC = "skiros/markers"

#: Markers are sent this often at most (Hz), and take this part of one core's time at most.
RATE = 25.0
_SHARE = 0.1

#: How long after a failure the scene is read again (s).
_PATIENCE = 1.0


class Markers:
    """Publishes the markers of all elements with a pose, and the interactive marker of the selected one.

    Who subscribes gets all markers at once, then only what changes. Nothing is done while nobody subscribes and no
    element is selected. Everything is done in threads of its own; `select` returns at once, from any thread.

    :param world: has a replica of the scene; used in other threads than the caller's.
    :param folders: where relative names of meshes are looked for.
    :param on_problem: `on_problem(what, error)` is called, in another thread, when an element could not be moved.
    """

    def __init__(
        self, world: WorldModelInterface, folders: Sequence[str | Path] = (), on_problem: OnProblem | None = None
    ) -> None:
        self._world = world
        self._changed = ChangedElements()
        self._showing = Showing(world.is_subclass, folders)
        self._board = MarkerBoard(self._showing.of)
        self._packed = PackedMarkers()
        self._sending = threading.Lock()  # of the board and what has been sent of it
        self._ending = threading.Event()
        self._wanted = threading.Event()
        self._selected = SelectedMarker(world, on_problem)
        self._publisher = rospy.Publisher(TOPIC, MarkerArray, subscriber_listener=_Newcomers(self), queue_size=100)
        world.add_listener(self._changed.note)
        self._thread = threading.Thread(target=self._run, name="markers", daemon=True)
        self._thread.start()

    def select(self, eid: str) -> None:
        """The element gets the interactive marker, in the place of another; "": none has it."""
        self._selected.select(eid)
        self._changed.note_ids([eid] if eid else [])
        self._wanted.set()

    def close(self) -> None:
        """Takes the markers away, unless somebody else publishes them too. May be called twice."""
        if self._ending.is_set():
            return
        self._ending.set()
        self._changed.waiting.set()
        self._wanted.set()
        self._world.remove_listener(self._changed.note)
        self._thread.join()
        self._selected.close()
        with self._sending:
            if not _has_others(self._publisher.resolved_name):
                self._send(Difference(gone=list(self._board.shown)))
        self._publisher.unregister()

    # -- in the thread of the markers ---------------------------------------------------------------------------

    def _run(self) -> None:
        refusal = ""
        while True:
            if not self._publisher.get_num_connections() and not self._selected.chosen:
                self._wanted.wait()
            self._wanted.clear()
            self._changed.waiting.wait()
            if self._ending.is_set():
                return
            begin, spent = time.monotonic(), time.thread_time()
            ids = self._changed.take()
            pause = 1.0 / RATE
            try:
                self._update(ids)
                refusal = ""
            except (SkirosError, rospy.ROSException) as error:
                self._changed.give_back(ids)
                pause = _PATIENCE
                if str(error) != refusal:  # told once, not each second
                    log.warning("the markers are not up to date: %s", error)
                refusal = str(error)
            pause = max(pause, (time.thread_time() - spent) / _SHARE)
            self._ending.wait(max(0.0, begin + pause - time.monotonic()))

    def _update(self, ids: set[str] | None) -> None:
        """Sends what has changed of these elements; None: of all.

        :raises SkirosError: the world model does not answer.
        """
        if ids is None:
            self._showing.forget()
            elements = self._world.resolve_elements(Element())
            with self._sending:
                self._send(self._board.replace_all(elements))
        else:
            found = {eid: self._world.find_element(eid) for eid in ids}
            with self._sending:
                self._send(self._board.replace(found))
        chosen = self._selected.chosen
        if chosen and (ids is None or chosen in ids):
            self._selected.show(self._board.get(chosen))

    def _send(self, difference: Difference) -> None:
        if difference and self._publisher.get_num_connections():
            self._publisher.publish(self._packed.message(difference.put, difference.gone))
        else:
            self._packed.forget(difference.gone)

    # -- in the thread of a new subscriber -----------------------------------------------------------------------

    def tell_all(self, publish: Any) -> None:
        """Sends all markers to one who has subscribed just now."""
        with self._sending:
            everything: list[Shown] = list(self._board.shown)
            if everything:
                publish(self._packed.message(everything))
        self._wanted.set()


class _Newcomers(rospy.SubscribeListener):  # type: ignore[misc]
    def __init__(self, markers: Markers) -> None:
        super().__init__()
        self._markers = markers

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        self._markers.tell_all(peer_publish)


def _has_others(topic: str) -> bool:
    """Whether another node publishes a topic; True also when the master does not say."""
    try:
        publishers, _, _ = rosgraph.Master(rospy.get_name()).getSystemState()
    except (OSError, rosgraph.MasterException):
        return True
    return any(node != rospy.get_name() for name, nodes in publishers if name == topic for node in nodes)


def mesh_folders() -> list[str]:
    """Where the system's meshes are looked for: the workspace of the world model, where it is on this machine."""
    try:
        folder = rospy.get_param("wm/workspace_dir", "")
    except (OSError, rospy.ROSException):
        return []  # the master has gone; what is named by its whole path is found all the same
    return [folder] if isinstance(folder, str) and folder else []


def main() -> None:
    """Runs the node: publishes markers until it is asked to end.

    The parameter `~selected` names the element that gets the interactive marker; a topic of that name changes it.
    """
    world = WorldModelInterface(rospy.get_name(), make_cache=True)
    markers = Markers(world, mesh_folders())
    chosen = rospy.get_param("~selected", "")
    if chosen:
        markers.select(str(chosen))
    rospy.Subscriber("~selected", String, lambda message: markers.select(message.data))
    rospy.on_shutdown(markers.close)
    spin()
