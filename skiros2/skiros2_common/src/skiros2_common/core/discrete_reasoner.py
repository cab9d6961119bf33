"""Reasoners: plugins that own properties of elements and compute relations between elements."""

from __future__ import annotations

import logging
import threading
from typing import Any, cast

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.core.world_element import REASONER_PROPERTY, Element, reasoners, set_reasoners
from skiros2_common.core.world_model_port import WorldModelPort

__all__ = ["REASONER_PROPERTY", "DiscreteReasoner", "reasoners", "set_reasoners"]

log = logging.getLogger(__name__)

#: How often a thread that waits for an earlier one checks whether it is itself to end (s).
_POLL_PERIOD = 0.1


class DiscreteReasoner:
    """Base of all reasoners. An element names its reasoners in the property `skiros:DiscreteReasoner`.

    The world-model server calls `init` once, `execute` after each load of the scene, and `parse` before each addition,
    update or removal of an element (under the world model's lock). `getData`, `setData`, `hasData` and
    `computeRelations` are called in all processes, from any thread.
    """

    _wmi = cast(WorldModelPort, None)  # until `init`
    _thread: _RunThread | None = None

    def __repr__(self) -> str:
        return self.__class__.__name__

    def init(self, wmi: WorldModelPort) -> None:
        """Called once before use.

        :param wmi: the world model of the reasoner.
        """
        self._wmi = wmi

    def parse(self, element: Element, action: str) -> bool | None:
        """To override: called for each changed element. `action` is `add`, `update` or `remove`. Return False to reject
        the change."""
        raise self._missing("parse")

    @property
    def _stop_event(self) -> threading.Event:
        """The request to end the run of this thread, or the latest run for other threads."""
        thread = threading.current_thread()
        if isinstance(thread, _RunThread) and thread.reasoner is self:
            return thread.stop_event
        if self._thread is not None:
            return self._thread.stop_event
        # Created on first use, because subclasses need not call a constructor.
        event: threading.Event = self.__dict__.setdefault("_stopped", threading.Event())
        return event

    @property
    def stopRequested(self) -> bool:
        """Whether `run` has to end. Reading it clears the request."""
        event = self._stop_event
        requested = event.is_set()
        if requested:
            event.clear()
        return requested

    def stop(self) -> None:
        """Requests the end of `run`."""
        if self._thread is not None:
            self._thread.stop_event.set()
            self._thread.is_stopped = True
        else:
            self._stop_event.set()

    def execute(self) -> None:
        """Starts a thread that calls `run`, after the end of a stopped one. No effect while one runs."""
        latest = self._thread
        if latest is not None and latest.is_alive() and not latest.is_stopped:
            return
        self._thread = _RunThread(self, latest)
        self._thread.start()

    def wait_stopped(self, timeout: float) -> bool:
        """Waits for the end of `run`. Returns whether it has ended.

        :param timeout: s.
        """
        if self._thread is None:
            return True
        self._thread.join(timeout)
        return not any(run.is_alive() for run in (self._thread, *self._thread.earlier))

    def _run_logged(self) -> None:
        try:
            self.run()
        except NotImplementedError as error:
            log.debug("%s", error)
        except FOREIGN_ERRORS:
            log.exception("reasoner %r: run raised an error and has ended", self)

    def run(self) -> None:
        """To override: the reasoner's loop, which ends on `stopRequested`."""
        raise self._missing("run")

    def addProperties(self, element: Element) -> None:
        """Adds the reasoner and its properties to the element."""
        name = self.__class__.__name__
        if not element.hasProperty(REASONER_PROPERTY, name):
            element.appendProperty(REASONER_PROPERTY, name)
        self.onAddProperties(element)

    def onAddProperties(self, element: Element) -> None:
        """To override: adds the reasoner's missing properties."""
        raise self._missing("onAddProperties")

    def removeProperties(self, element: Element) -> None:
        """Removes the reasoner and its properties from the element."""
        name = self.__class__.__name__
        if element.hasProperty(REASONER_PROPERTY, name):
            named = element.getProperty(REASONER_PROPERTY)
            named.removeValue(name)
            if not named.isSpecified():
                element.removeProperty(REASONER_PROPERTY)
        self.onRemoveProperties(element)

    def onRemoveProperties(self, element: Element) -> None:
        """To override: removes the reasoner's properties."""
        raise self._missing("onRemoveProperties")

    def hasData(self, element: Element, get_code: str) -> bool:
        """To override: whether the element has all data of the code."""
        raise self._missing("hasData")

    def getData(self, element: Element, get_code: str) -> Any:
        """To override: the data of the code, read from the element's properties."""
        raise self._missing("getData")

    def setData(self, element: Element, data: Any, set_code: str) -> Any:
        """To override: writes the data of the code to the element's properties."""
        raise self._missing("setData")

    def getAssociatedRelations(self) -> list[str]:
        """To override: the relations that `computeRelations` may return."""
        raise self._missing("getAssociatedRelations")

    def getAssociatedProperties(self) -> list[str]:
        """To override: the codes of `getData` and `setData`, such as `:Pose`."""
        raise self._missing("getAssociatedProperties")

    def getAssociatedData(self) -> list[str]:
        """To override: the properties that the reasoner owns, such as `skiros:PositionX`."""
        raise self._missing("getAssociatedData")

    def computeRelations(self, sub: Element, obj: Element, with_metrics: bool = False) -> list[Any]:
        """To override: the relations from `sub` to `obj`; with `with_metrics`, pairs of relation and distance(s)."""
        raise self._missing("computeRelations")

    def _missing(self, method: str) -> NotImplementedError:
        return NotImplementedError(f"{self!r} has to define {method}")


class _RunThread(threading.Thread):
    """One run of a reasoner. Each has a request to stop of its own, so that a later start cannot revive it.

    :param latest: the run before; it, and those that it waits for, end before this one starts. None: none.
    """

    def __init__(self, reasoner: DiscreteReasoner, latest: _RunThread | None) -> None:
        super().__init__(name=repr(reasoner), daemon=True)
        self.reasoner = reasoner
        self.stop_event = threading.Event()
        self.is_stopped = False  # stays, unlike the event, which `stopRequested` clears
        self.earlier: list[_RunThread] = []
        if latest is not None:
            self.earlier = [run for run in (latest, *latest.earlier) if run.is_alive()]

    def run(self) -> None:
        for run in self.earlier:
            while run.is_alive():
                run.join(_POLL_PERIOD)
                if self.is_stopped:
                    return
        self.earlier = []
        self.reasoner._run_logged()
