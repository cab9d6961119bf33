"""Names of the ontology as people write them.

A name is `prefix:Name`. `:Name` and `Name` stand for the default prefix.
"""

from __future__ import annotations

from functools import lru_cache

DEFAULT_PREFIX = "skiros"

#: What an abstract element has as its class when it stands for elements of any class.
ANY_TYPE = ("", "Unknown", "skiros:Unknown")

#: The highest number of an id. More digits than that are a part of the name.
LAST_ID_NUMBER = 10**18 - 1


@lru_cache(maxsize=10_000)
def full_name(name: str, default: str = DEFAULT_PREFIX) -> str:
    """`contain` and `:contain` as `skiros:contain`; a name with a prefix, an IRI and "" stay as they are."""
    if not name:
        return name
    prefix, colon, local = name.partition(":")
    if not colon:
        return f"{default}:{name}"
    if not prefix:
        return f"{default}:{local}"
    return name


def local_name(name: str) -> str:
    """The part after the prefix: `skiros:contain` gives `contain`."""
    return name.rpartition(":")[2]


def id_number(eid: str) -> int:
    """The number at the end of an id, or -1 when it has none."""
    _, dash, number = eid.rpartition("-")
    return int(number) if dash and number.isascii() and number.isdigit() and len(number) <= 18 else -1


def id_order(eid: str) -> tuple[str, int]:
    """The key that sorts ids by class and number: `skiros:Part-9` before `skiros:Part-10`."""
    number = id_number(eid)
    return (eid, number) if number < 0 else (eid.rpartition("-")[0], number)
