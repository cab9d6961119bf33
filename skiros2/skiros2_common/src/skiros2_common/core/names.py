"""Names of ontology terms and elements.

An ontology name is `prefix:Name`. `:Name` and `Name` stand for the default prefix.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from functools import lru_cache
from typing import Protocol

DEFAULT_PREFIX = "skiros"

#: The root of the scene, and the relation of which all relations from a holder to what it holds are subproperties.
SCENE_ROOT, SPATIAL = "skiros:Scene-0", "skiros:spatiallyRelated"

#: The classes of an abstract element that stands for elements of any class.
ANY_TYPE = ("", "Unknown", "skiros:Unknown")

#: The highest number of an id. A longer sequence of digits is part of the name.
LAST_ID_NUMBER = 10**18 - 1


class ClassHierarchy(Protocol):
    """The classes of the ontologies, as the world model knows them."""

    def is_subclass(self, child: str, parent: str) -> bool: ...
    def get_sub_classes(self, parent_class: str, recursive: bool = True) -> list[str]: ...


@lru_cache(maxsize=10_000)
def full_name(name: str, default: str = DEFAULT_PREFIX) -> str:
    """The name with its prefix: `contain` gives `skiros:contain`. A prefixed name, an IRI and "" stay unchanged."""
    if not name:
        return name
    prefix, colon, local = name.partition(":")
    if not colon:
        return f"{default}:{name}"
    if not prefix:
        return f"{default}:{local}"
    return name


@lru_cache(maxsize=10_000)
def spellings(name: str) -> tuple[str, ...]:
    """All spellings of a name, the full one first: `skiros:contain`, `contain`, `:contain`."""
    full = full_name(name)
    prefix, colon, local = full.partition(":")
    return (full, local, f":{local}") if colon and prefix == DEFAULT_PREFIX else (full,)


def nearest(name: str, known: Iterable[str], count: int = 3) -> list[str]:
    """The known names closest to a name, ignoring case, the closest first; [] if none is close."""
    folded = {k.casefold(): k for k in reversed([*known])}
    return [folded[n] for n in difflib.get_close_matches(name.casefold(), folded, count)]


def local_name(name: str) -> str:
    """The part after the prefix: `skiros:contain` gives `contain`."""
    return name.rpartition(":")[2]


def is_of_class(name: str, wanted: str, wmi: ClassHierarchy | None) -> bool:
    """Whether a class is the wanted one (see `ANY_TYPE`) or a subclass of it.

    :param wmi: the world model, queried if the names differ; None: different names are different classes.
    """
    name, wanted = full_name(name), full_name(wanted)
    if name == wanted or wanted in ANY_TYPE:
        return True
    if wmi is None:
        return False
    if hasattr(type(wmi), "is_subclass"):  # faster, but a library's own world model may lack it
        return wmi.is_subclass(name, wanted)
    return name in map(full_name, wmi.get_sub_classes(wanted, True))


def id_number(eid: str) -> int:
    """The number at the end of an id, or -1 if it has none."""
    _, dash, number = eid.rpartition("-")
    return int(number) if dash and number.isascii() and number.isdigit() and len(number) <= 18 else -1


@lru_cache(maxsize=20_000)
def id_order(eid: str) -> tuple[str, int]:
    """The key that sorts ids by class and number: `skiros:Part-9` before `skiros:Part-10`."""
    number = id_number(eid)
    return (eid, number) if number < 0 else (eid.rpartition("-")[0], number)
