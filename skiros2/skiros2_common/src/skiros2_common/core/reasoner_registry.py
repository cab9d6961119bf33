"""The registry of reasoners, by class name and by what they own: codes, properties and relations."""

from __future__ import annotations

import importlib
import logging
import threading
from collections.abc import Callable, Sequence
from typing import Generic, Protocol, TypeVar

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.names import full_name, spellings

log = logging.getLogger(__name__)

#: The module with `load_reasoners`, which loads the reasoners of the ROS parameter. Imported on first use, because ROS
#: may not be installed.
_LOADER = "skiros2_common.ros.reasoners"

#: The maximum size of the lookup cache.
_MAX_CACHED = 1000


class Owner(Protocol):
    """What a reasoner owns. Each method may raise `NotImplementedError`."""

    def getAssociatedRelations(self) -> Sequence[str]: ...
    def getAssociatedProperties(self) -> Sequence[str]: ...
    def getAssociatedData(self) -> Sequence[str]: ...


_Reasoner = TypeVar("_Reasoner", bound=Owner)


class ReasonerRegistry(Generic[_Reasoner]):
    """The reasoners of this process, by class name, code, owned property or relation.

    On the first unknown name it loads the packages of the ROS parameter `wm/reasoners_pkgs`, if set. Reasoners hold no
    element, so all elements of the process share them.
    """

    def __init__(self) -> None:
        self._by_name: dict[str, _Reasoner] = {}
        self._owners: dict[str, _Reasoner] = {}
        self._cache: dict[str, _Reasoner | None] = {}
        self._loading = threading.RLock()
        self._is_loaded = False

    def add(self, reasoner: _Reasoner) -> None:
        """Adds a reasoner; it replaces an earlier one of the same class."""
        self._by_name[reasoner.__class__.__name__] = reasoner
        owners: dict[str, _Reasoner] = {}
        for known in self._by_name.values():
            for name in (*_names_of(known.getAssociatedProperties), *data_of(known), *relations_of(known)):
                owners.setdefault(name, known)
        self._owners = owners
        self._cache = {}  # a new dict: a concurrent lookup writes its old result to the old one

    def names(self) -> list[str]:
        return list(self._by_name)

    def all(self) -> list[_Reasoner]:
        return list(self._by_name.values())

    def find(self, name: str) -> _Reasoner | None:
        """Returns the reasoner that has this class name or owns this code, property or relation, or None."""
        found = self._find(name)
        return self._find(name) if found is None and self._load() else found

    def find_or_load(self, name: str) -> _Reasoner | None:
        """Same as `find`, with a cache. Thread-safe."""
        cache = self._cache
        try:
            return cache[name]
        except KeyError:
            if len(cache) >= _MAX_CACHED:
                cache.clear()
        cache[name] = found = self.find(name)
        return found

    def get(self, name: str) -> _Reasoner:
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

    def _find(self, name: str) -> _Reasoner | None:
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


def data_of(reasoner: Owner) -> Sequence[str]:
    """The properties that a reasoner owns; () if it does not define them."""
    return _names_of(reasoner.getAssociatedData)


def relations_of(reasoner: Owner) -> Sequence[str]:
    """The relations that a reasoner computes; () if it does not define them."""
    return _names_of(reasoner.getAssociatedRelations)


def _names_of(method: Callable[[], Sequence[str] | None]) -> Sequence[str]:
    try:
        return method() or ()
    except NotImplementedError:
        return ()
