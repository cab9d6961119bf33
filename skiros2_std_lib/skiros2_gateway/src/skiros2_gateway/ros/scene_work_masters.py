"""Work masters that elements of the scene define."""

from __future__ import annotations

import asyncio
import logging
import threading

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.names import is_of_class
from skiros2_common.core.operations import Change
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_gateway.core.work_masters import WORK_MASTER, WorkMasters, work_masters_of

log = logging.getLogger(__name__)


class SceneWorkMasters:
    """Keeps work masters as the scene defines them. Its methods are called by threads of the world model's client.

    :param loop: the thread that reads `masters`.
    :raises SkirosError: the world model does not answer.
    """

    def __init__(self, wm: WorldModelPort, masters: WorkMasters, loop: asyncio.AbstractEventLoop) -> None:
        self._wm, self._masters, self._loop = wm, masters, loop
        self._lock = threading.Lock()
        self._problems: list[str] = []
        self._ids: set[str] = set()
        self._is_read = False
        self._read()
        wm.add_listener(self._on_change)

    def _on_change(self, change: Change) -> None:
        try:
            if not self._is_read or any(map(self._concerns, change.elements)):
                self._read()
        except SkirosError as error:
            self._is_read = False
            log.error("the work masters of the scene are read with its next change: %s", error)

    def _concerns(self, element: Element) -> bool:
        return element.id in self._ids or is_of_class(element.type, WORK_MASTER, self._wm)

    def _read(self) -> None:
        """
        :raises SkirosError: the world model does not answer.
        """
        with self._lock:
            elements = self._wm.resolve_elements(Element(WORK_MASTER))
            masters, problems = work_masters_of(elements)
            for problem in problems:
                if problem not in self._problems:
                    log.warning("work master refused: %s", problem)
            self._ids, self._problems, self._is_read = {element.id for element in elements}, problems, True
            self._loop.call_soon_threadsafe(self._masters.set_of_scene, masters)
