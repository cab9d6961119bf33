"""Reasoners: plugins that own some properties and relations of elements and compute with them."""

from __future__ import annotations

import importlib
import logging
import threading
from collections.abc import Callable, Sequence
from typing import Any

from skiros2_common.core.errors import FOREIGN_ERRORS, UnknownName
from skiros2_common.core.names import full_name, spellings

log = logging.getLogger(__name__)

#: The property in which an element names its reasoners.
REASONER_PROPERTY = "skiros:DiscreteReasoner"

#: The module whose `load_reasoners` loads the reasoners that the ROS parameters name. Imported on first use, where ROS
#: is installed.
_LOADER = "skiros2_common.ros.reasoners"

#: Time that a thread which was asked to stop has to end before the next one starts (s).
_STOPPING = 2.0

#: At most this number of names is remembered with their reasoners.
_MOST_ANSWERS = 1000


class DiscreteReasoner:
    """Base of all reasoners. An element names the ones it uses in its property `skiros:DiscreteReasoner`.

    In the world-model server `init` is called once, `execute` after each load of the scene, `parse` before any element
    is added, updated or removed (under the world model's lock). In every process `getData`, `setData`, `hasData` and
    `computeRelations` may be called from any thread.
    """

    _wmi: Any = None
    _thread: threading.Thread | None = None

    def __repr__(self) -> str:
        return self.__class__.__name__

    def init(self, wmi: Any) -> None:
        """Called once before use. `wmi` is the world model that the reasoner serves."""
        self._wmi = wmi

    def parse(self, element: Any, action: str) -> bool | None:
        """To override: an element was changed. `action` is `add`, `update` or `remove`. False rejects the change."""
        raise self._missing("parse")

    @property
    def _stop_event(self) -> threading.Event:
        # Made on first use, so that subclasses need not call a constructor of ours.
        event: threading.Event = self.__dict__.setdefault("_stopped", threading.Event())
        return event

    @property
    def stopRequested(self) -> bool:
        """Whether `run` has to end; a request is reported once."""
        requested = self._stop_event.is_set()
        if requested:
            self._stop_event.clear()
        return requested

    def stop(self) -> None:
        """Asks `run` to end."""
        self._stop_event.set()

    def execute(self) -> None:
        """Starts a thread that calls `run`, and returns at once. A thread that was asked to stop ends before."""
        if self._thread is not None and self._stop_event.is_set():
            self._thread.join(_STOPPING)
        self._stop_event.clear()
        self._thread = threading.Thread(target=self._run_logged, name=repr(self), daemon=True)
        self._thread.start()

    def wait_stopped(self, timeout: float) -> bool:
        """Waits until `run` has returned; returns whether it has.

        :param timeout: in s.
        """
        if self._thread is not None:
            self._thread.join(timeout)
        return self._thread is None or not self._thread.is_alive()

    def _run_logged(self) -> None:
        try:
            self.run()
        except NotImplementedError as error:
            log.debug("%s", error)
        except FOREIGN_ERRORS:
            log.exception("reasoner %r has ended", self)

    def run(self) -> None:
        """To override: the reasoner's own loop. It ends when `stopRequested`."""
        raise self._missing("run")

    def addProperties(self, element: Any) -> None:
        """Makes the reasoner one of the element's and gives the element its properties."""
        name = self.__class__.__name__
        if not element.hasProperty(REASONER_PROPERTY, name):
            element.appendProperty(REASONER_PROPERTY, name)
        self.onAddProperties(element)

    def onAddProperties(self, element: Any) -> None:
        """To override: adds the reasoner's properties, where missing."""
        raise self._missing("onAddProperties")

    def removeProperties(self, element: Any) -> None:
        """Takes the reasoner and its properties away from the element."""
        name = self.__class__.__name__
        if element.hasProperty(REASONER_PROPERTY, name):
            named = element.getProperty(REASONER_PROPERTY)
            named.removeValue(name)
            if not named.isSpecified():
                element.removeProperty(REASONER_PROPERTY)
        self.onRemoveProperties(element)

    def onRemoveProperties(self, element: Any) -> None:
        """To override: removes the reasoner's properties."""
        raise self._missing("onRemoveProperties")

    def hasData(self, element: Any, get_code: str) -> bool:
        """To override: whether the element has all data behind the code."""
        raise self._missing("hasData")

    def getData(self, element: Any, get_code: str) -> Any:
        """To override: the data behind the code, read from the element's properties."""
        raise self._missing("getData")

    def setData(self, element: Any, data: Any, set_code: str) -> Any:
        """To override: writes the data behind the code into the element's properties."""
        raise self._missing("setData")

    def getAssociatedRelations(self) -> list[str]:
        """To override: the relations that `computeRelations` may answer."""
        raise self._missing("getAssociatedRelations")

    def getAssociatedProperties(self) -> list[str]:
        """To override: the codes of `getData` and `setData`, such as `:Pose`."""
        raise self._missing("getAssociatedProperties")

    def getAssociatedData(self) -> list[str]:
        """To override: the properties that the reasoner owns, such as `skiros:PositionX`."""
        raise self._missing("getAssociatedData")

    def computeRelations(self, sub: Any, obj: Any, with_metrics: bool = False) -> list[Any]:
        """To override: the relations from `sub` to `obj`; with metrics, pairs of a relation and its distance(s)."""
        raise self._missing("computeRelations")

    def _missing(self, method: str) -> NotImplementedError:
        return NotImplementedError(f"{self!r} has to define {method}")


class ReasonerRegistry:
    """The reasoners of this process, found by name, by code, by owned property or by relation.

    A name that is not known makes it load the packages of the ROS parameter `wm/reasoners_pkgs`, where there is one.
    Reasoners hold no element, so that all elements of the process can share them.
    """

    def __init__(self) -> None:
        self._by_name: dict[str, DiscreteReasoner] = {}
        self._owners: dict[str, DiscreteReasoner] = {}
        self._answers: dict[str, DiscreteReasoner | None] = {}
        self._loading = threading.RLock()
        self._is_loaded = False

    def add(self, reasoner: DiscreteReasoner) -> None:
        """Adds a reasoner; one of the same class takes the place of the earlier one."""
        self._by_name[reasoner.__class__.__name__] = reasoner
        owners: dict[str, DiscreteReasoner] = {}
        for known in self._by_name.values():
            for name in (*codes_of(known), *data_of(known), *relations_of(known)):
                owners.setdefault(name, known)
        self._owners = owners
        self._answers = {}  # who still gives an old answer, writes it to the old ones

    def names(self) -> list[str]:
        return list(self._by_name)

    def all(self) -> list[DiscreteReasoner]:
        return list(self._by_name.values())

    def find(self, name: str) -> DiscreteReasoner | None:
        """The reasoner with that class name, or that owns that code, property or relation, of those loaded."""
        for spelling in (name, *spellings(name)):
            found = self._by_name.get(spelling) or self._owners.get(spelling)
            if found is not None:
                return found
        return None

    def find_or_load(self, name: str) -> DiscreteReasoner | None:
        """As `find`, but loads reasoners first. Remembers the answers: most conditions ask. Any thread."""
        answers = self._answers
        try:
            return answers[name]
        except KeyError:
            if len(answers) >= _MOST_ANSWERS:
                answers.clear()
        found = self.find(name)
        if found is None and self._load():
            return self.find_or_load(name)
        answers[name] = found
        return found

    def get(self, name: str) -> DiscreteReasoner:
        """As `find`, but loads reasoners first.

        :raises UnknownName: no reasoner has that name.
        """
        found = self.find(name)
        if found is None and self._load():
            found = self.find(name)
        if found is None:
            loaded = ", ".join(self._by_name) or "none"
            raise UnknownName(f"no reasoner is called or owns {name!r}; loaded: {loaded}")
        return found

    def owner_of_data(self, name: str) -> str:
        """The class name of the reasoner that owns a property (not a code or relation), "" when none does."""
        full = full_name(name)
        for known in (self.find(name), *self.all()):
            if known is not None and full in map(full_name, data_of(known)):
                return repr(known)
        if self.find(name) is None and self._load():
            return self.owner_of_data(name)
        return ""

    def _load(self) -> bool:
        """Loads the reasoners that the ROS parameters name. Returns whether they were loaded by this call."""
        with self._loading:
            if self._is_loaded:
                return False
            self._is_loaded = True  # also while it loads: reasoners may ask for others
            try:
                self._is_loaded = importlib.import_module(_LOADER).load_reasoners(self.names(), self.add)
            except ImportError as error:
                log.debug("there is no ROS that names reasoners: %s", error)
            return self._is_loaded


def codes_of(reasoner: DiscreteReasoner) -> Sequence[str]:
    """The codes of a reasoner's data; none when it does not define them."""
    return _told(reasoner.getAssociatedProperties)


def data_of(reasoner: DiscreteReasoner) -> Sequence[str]:
    """The properties that a reasoner owns; none when it does not define them."""
    return _told(reasoner.getAssociatedData)


def relations_of(reasoner: DiscreteReasoner) -> Sequence[str]:
    """The relations that a reasoner computes; none when it does not define them."""
    return _told(reasoner.getAssociatedRelations)


def _told(method: Callable[[], Sequence[str] | None]) -> Sequence[str]:
    try:
        return method() or ()
    except NotImplementedError:
        return ()


def set_reasoners(element: Any, names: Sequence[str]) -> None:
    """Makes these the reasoners of an element: new ones add their properties, those that are gone remove theirs."""
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
        element.appendProperty(REASONER_PROPERTY, str)  # no name yet: nothing else is done
    element.getProperty(REASONER_PROPERTY).setValues(list(names))


#: The reasoners of this process. World-model interfaces and servers fill it from their plugin packages.
reasoners = ReasonerRegistry()
