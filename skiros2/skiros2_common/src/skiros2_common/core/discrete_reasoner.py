"""Reasoners: plugins that own properties of elements and compute relations between elements."""

from __future__ import annotations

import importlib
import logging
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from skiros2_common.core.errors import FOREIGN_ERRORS, UnknownName
from skiros2_common.core.names import full_name, spellings

if TYPE_CHECKING:
    from skiros2_common.core.world_element import Element
    from skiros2_common.core.world_model_port import WorldModelPort

log = logging.getLogger(__name__)

#: The property of an element that names its reasoners.
REASONER_PROPERTY = "skiros:DiscreteReasoner"

#: The module with `load_reasoners`, which loads the reasoners of the ROS parameter. Imported on first use, because ROS
#: may not be installed.
_LOADER = "skiros2_common.ros.reasoners"

#: How often a thread that waits for an earlier one checks whether it is itself to end (s).
_POLL_PERIOD = 0.1

#: The maximum size of the lookup cache.
_MAX_CACHED = 1000


class DiscreteReasoner:
    """Base of all reasoners. An element names its reasoners in the property `skiros:DiscreteReasoner`.

    The world-model server calls `init` once, `execute` after each load of the scene, and `parse` before each addition,
    update or removal of an element (under the world model's lock). `getData`, `setData`, `hasData` and
    `computeRelations` are called in all processes, from any thread.
    """

    _wmi: Any = None
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


class ReasonerRegistry:
    """The reasoners of this process, by class name, code, owned property or relation.

    On the first unknown name it loads the packages of the ROS parameter `wm/reasoners_pkgs`, if set. Reasoners hold no
    element, so all elements of the process share them.
    """

    def __init__(self) -> None:
        self._by_name: dict[str, DiscreteReasoner] = {}
        self._owners: dict[str, DiscreteReasoner] = {}
        self._cache: dict[str, DiscreteReasoner | None] = {}
        self._loading = threading.RLock()
        self._is_loaded = False

    def add(self, reasoner: DiscreteReasoner) -> None:
        """Adds a reasoner; it replaces an earlier one of the same class."""
        self._by_name[reasoner.__class__.__name__] = reasoner
        owners: dict[str, DiscreteReasoner] = {}
        for known in self._by_name.values():
            for name in (*_names_of(known.getAssociatedProperties), *data_of(known), *relations_of(known)):
                owners.setdefault(name, known)
        self._owners = owners
        self._cache = {}  # a new dict: a concurrent lookup writes its old result to the old one

    def names(self) -> list[str]:
        return list(self._by_name)

    def all(self) -> list[DiscreteReasoner]:
        return list(self._by_name.values())

    def find(self, name: str) -> DiscreteReasoner | None:
        """Returns the reasoner that has this class name or owns this code, property or relation, or None."""
        found = self._find(name)
        return self._find(name) if found is None and self._load() else found

    def find_or_load(self, name: str) -> DiscreteReasoner | None:
        """Same as `find`, with a cache. Thread-safe."""
        cache = self._cache
        try:
            return cache[name]
        except KeyError:
            if len(cache) >= _MAX_CACHED:
                cache.clear()
        cache[name] = found = self.find(name)
        return found

    def get(self, name: str) -> DiscreteReasoner:
        """Same as `find`.

        :raises UnknownName: no reasoner has this name.
        """
        found = self.find(name)
        if found is None:
            loaded = ", ".join(self._by_name) or "none"
            raise UnknownName(f"no reasoner has the name or owns {name!r}; loaded: {loaded}")
        return found

    def owner_of_data(self, name: str) -> str:
        """The class name of the reasoner that owns a property (not a code or relation); "" if none does."""
        self.find(name)  # loads the reasoners, if none is known
        return next((repr(known) for known in self.all() if full_name(name) in map(full_name, data_of(known))), "")

    def _find(self, name: str) -> DiscreteReasoner | None:
        for spelling in (name, *spellings(name)):
            found = self._by_name.get(spelling) or self._owners.get(spelling)
            if found is not None:
                return found
        return None

    def _load(self) -> bool:
        """Loads the reasoners of the ROS parameter. Returns whether this call loaded them."""
        with self._loading:
            if self._is_loaded:
                return False
            self._is_loaded = True  # already while loading: reasoners may look up others
            try:
                self._is_loaded = importlib.import_module(_LOADER).load_reasoners(self.names(), self.add)
            except ImportError as error:
                log.debug("no reasoners are loaded, because ROS is not installed: %s", error)
            return self._is_loaded


def data_of(reasoner: DiscreteReasoner) -> Sequence[str]:
    """The properties that a reasoner owns; () if it does not define them."""
    return _names_of(reasoner.getAssociatedData)


def relations_of(reasoner: DiscreteReasoner) -> Sequence[str]:
    """The relations that a reasoner computes; () if it does not define them."""
    return _names_of(reasoner.getAssociatedRelations)


def _names_of(method: Callable[[], Sequence[str] | None]) -> Sequence[str]:
    try:
        return method() or ()
    except NotImplementedError:
        return ()


def set_reasoners(element: Element, names: Sequence[str]) -> None:
    """Sets the reasoners of an element: added ones add their properties, removed ones remove theirs."""
    before = list(element.getProperty(REASONER_PROPERTY).values) if element.hasProperty(REASONER_PROPERTY) else []
    for name in dict.fromkeys([*before, *names]):
        if (name in before) == (name in names):
            continue
        try:
            reasoner = reasoners.get(name)
        except UnknownName as error:
            log.error("%r: %s", element, error)
            continue
        if name in names:
            reasoner.addProperties(element)
        else:
            reasoner.removeProperties(element)
    if not element.hasProperty(REASONER_PROPERTY):
        element.appendProperty(REASONER_PROPERTY, str)  # without a name yet
    element.getProperty(REASONER_PROPERTY).setValues(list(names))


#: The reasoners of this process, filled by world-model interfaces and servers from their plugin packages.
reasoners = ReasonerRegistry()
