"""Work masters that elements of the scene define."""

from __future__ import annotations

import asyncio
import logging
import threading

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.names import is_of_class
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_gateway.core.work_masters import WORK_MASTER, WorkMasters, work_masters_of
from skiros2_world_model.core.changes import Change

log = logging.getLogger(__name__)


class SceneWorkMasters:
    """Keeps work masters as the scene defines them. Its methods are called by threads of the world model's client.

    :param loop: the thread that reads `masters`.
    """

    def __init__(self, wm: WorldModelPort, masters: WorkMasters, loop: asyncio.AbstractEventLoop) -> None:
        self._wm, self._masters, self._loop = wm, masters, loop
        self._lock = threading.Lock()
        self._problems: list[str] = []
        self._ids: set[str] = set()
        self._read()
        wm.add_listener(self._on_change)

    def _on_change(self, change: Change) -> None:
        if any(e.id in self._ids or is_of_class(e.type, WORK_MASTER, self._wm) for e in change.elements):
            self._read()

    def _read(self) -> None:
        with self._lock:
            try:
                elements = self._wm.resolve_elements(Element(WORK_MASTER))
            except SkirosError as error:
                log.error("the work masters of the scene cannot be read: %s", error)
                return
            masters, problems = work_masters_of(elements)
            for problem in problems:
                if problem not in self._problems:
                    log.warning("work master refused: %s", problem)
            self._ids, self._problems = {element.id for element in elements}, problems
            self._loop.call_soon_threadsafe(self._masters.set_of_scene, masters)
