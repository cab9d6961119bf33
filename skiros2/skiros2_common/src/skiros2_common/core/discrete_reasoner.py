"""Reasoners: plugins that own some properties and relations of elements and compute with them."""

from __future__ import annotations

import threading
from typing import Any

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.names import DEFAULT_PREFIX, full_name, local_name

#: So many names are remembered with their reasoners.
_MOST_ANSWERS = 1000


class DiscreteReasoner:
    """Base of all reasoners. An element names the ones it uses in its property `skiros:DiscreteReasoner`.

    In the world-model server `init` is called once, `parse` for each added, updated or removed element (under the
    world model's lock), and `execute` in a thread of its own. In every process `getData`, `setData`, `hasData`
    and `computeRelations` may be called from any thread.
    """

    _wmi: Any = None

    def init(self, wmi: Any) -> None:
        """Called once before use. `wmi` is the world model that the reasoner serves."""
        self._wmi = wmi

    def parse(self, element: Any, action: str) -> bool | None:
        """An element was changed. `action` is `add`, `update` or `remove`. False rejects the change."""
        return None

    @property
    def _stop_event(self) -> threading.Event:
        # Made on first use, so that subclasses need not call a constructor of ours.
        event: threading.Event = self.__dict__.setdefault("_stopped", threading.Event())
        return event

    @property
    def stopRequested(self) -> bool:
        """Whether `run` has to end."""
        return self._stop_event.is_set()

    def stop(self) -> None:
        """Asks `run` to end."""
        self._stop_event.set()

    def execute(self) -> None:
        """Runs `run`; called in the reasoner's own thread."""
        self._stop_event.clear()
        self.run()

    def run(self) -> None:
        """The reasoner's own loop. It ends when `stopRequested`."""

    def addProperties(self, element: Any) -> None:
        """Makes the reasoner one of the element's and gives the element its properties."""
        element.setReasoner(self.__class__.__name__)
        self.onAddProperties(element)

    def onAddProperties(self, element: Any) -> None:
        """To override: adds the reasoner's properties, where missing."""

    def removeProperties(self, element: Any) -> None:
        """Takes the reasoner and its properties away from the element."""
        element.unsetReasoner(self.__class__.__name__)
        self.onRemoveProperties(element)

    def onRemoveProperties(self, element: Any) -> None:
        """To override: removes the reasoner's properties."""

    def hasData(self, element: Any, get_code: str) -> bool:
        """Whether the element has all data behind the code."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define hasData")

    def getData(self, element: Any, get_code: str) -> Any:
        """The data behind the code, read from the element's properties."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define getData")

    def setData(self, element: Any, data: Any, set_code: str) -> None:
        """Writes the data behind the code into the element's properties."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define setData")

    def getAssociatedRelations(self) -> list[str]:
        """The relations that `computeRelations` may answer."""
        return []

    def getAssociatedProperties(self) -> list[str]:
        """The codes of `getData` and `setData`, such as `:Pose`."""
        return []

    def getAssociatedData(self) -> list[str]:
        """The properties that the reasoner owns, such as `skiros:PositionX`."""
        return []

    def computeRelations(self, sub: Any, obj: Any, with_metrics: bool = False) -> list[Any]:
        """The relations that hold from `sub` to `obj`; with metrics, pairs of a relation and its distance(s)."""
        return []


class ReasonerRegistry:
    """The reasoners of this process, found by name, by code, by owned property or by relation.

    Reasoners hold no element, so that all elements of the process can share them.
    """

    def __init__(self) -> None:
        self._by_name: dict[str, DiscreteReasoner] = {}
        self._owners: dict[str, DiscreteReasoner] = {}
        self._answers: dict[str, DiscreteReasoner | None] = {}

    def add(self, reasoner: DiscreteReasoner) -> None:
        """Adds a reasoner; one of the same class takes the place of the earlier one."""
        self._by_name[reasoner.__class__.__name__] = reasoner
        owners: dict[str, DiscreteReasoner] = {}
        for known in self._by_name.values():
            owned = (known.getAssociatedProperties(), known.getAssociatedData(), known.getAssociatedRelations())
            for name in (name for names in owned for name in names):
                owners.setdefault(name, known)
        self._owners = owners
        self._answers = {}  # who still gives an old answer, writes it to the old ones

    def names(self) -> list[str]:
        return list(self._by_name)

    def all(self) -> list[DiscreteReasoner]:
        return list(self._by_name.values())

    def find(self, name: str) -> DiscreteReasoner | None:
        """The reasoner with that class name, or that owns that code, property or relation; None if nobody does."""
        found = self._by_name.get(name)
        return found if found is not None else self._owners.get(name)

    def find_written(self, name: str) -> DiscreteReasoner | None:
        """As `find`, however the name is written: `pX`, `:pX` or `skiros:pX`. Any thread; asked for most conditions."""
        answers = self._answers
        try:
            return answers[name]
        except KeyError:
            if len(answers) >= _MOST_ANSWERS:
                answers.clear()
        full = full_name(name)
        ways = [name, full]
        if full.startswith(f"{DEFAULT_PREFIX}:"):
            ways.append(":" + local_name(full))  # how reasoners write their codes and relations
        answers[name] = found = next((found for way in ways if (found := self.find(way)) is not None), None)
        return found

    def get(self, name: str) -> DiscreteReasoner:
        """As `find`.

        :raises UnknownName: nobody does.
        """
        found = self.find(name)
        if found is None:
            loaded = ", ".join(self._by_name) or "none"
            raise UnknownName(f"no reasoner is called or owns {name!r}; loaded: {loaded}")
        return found


#: The reasoners of this process. World-model interfaces and servers fill it from their plugin packages.
reasoners = ReasonerRegistry()
