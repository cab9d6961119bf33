"""The markers of the window: there as soon as the world model is, and while the window is."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from skiros2_gui.core.events import ProblemHeard
from skiros2_gui.core.problems import in_words
from skiros2_gui.ros.markers import Markers, mesh_folders
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

log = logging.getLogger(__name__)


class MarkersLink:
    """Publishes markers for rviz once there is a world model.

    :param told: called, in any thread, when something that was moved in rviz stays where it was.
    """

    def __init__(self, told: Callable[[ProblemHeard], None]) -> None:
        self._told = told
        self._lock = threading.Lock()
        self._markers: Markers | None = None
        self._marked = ""
        self._is_closed = False

    def mark(self, eid: str) -> None:
        """This element can be moved in rviz; "": none. Any thread; returns at once."""
        with self._lock:
            self._marked = eid
            if self._markers is not None:
                self._markers.select(eid)

    def check(self, world: WorldModelInterface | None) -> None:
        """Begins, when it has not begun and the world model has come. May ask the master. Called by one thread."""
        if world is None or self._markers is not None or self._is_closed:
            return
        markers = Markers(world, mesh_folders(), self._on_problem)
        with self._lock:
            self._markers = markers
            markers.select(self._marked)
        if self._is_closed:
            markers.close()

    def close(self) -> None:
        """Takes the markers away. May ask the master."""
        self._is_closed = True
        if self._markers is not None:
            self._markers.close()

    def _on_problem(self, what: str, error: Exception) -> None:
        self._told(ProblemHeard(what, in_words(error)))
