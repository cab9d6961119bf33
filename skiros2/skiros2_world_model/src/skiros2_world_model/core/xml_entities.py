"""Bounds how much text the entities of an XML file stand for: a few hundred bytes can stand for gigabytes."""

from __future__ import annotations

import re

from skiros2_common.core.errors import WrongValue

_DECLARATION = re.compile(rb"""<!ENTITY\s+(?:%\s+)?([^\s"'%&;]+)\s+(?:"([^"]*)"|'([^']*)')""")
_REFERENCE = re.compile(rb"[&%]([^\s#&%;<]+);")

#: The text that entities may stand for: these bytes, and a multiple of the file's.
_MAX_EXPANDED, _MAX_FACTOR = 1024**2, 20
#: How deep entities may refer to others.
_MAX_DEPTH = 10


def check_expansion(content: bytes, origin: str) -> None:
    """Checks the entities of an XML text before it is parsed.

    :param origin: the name of the file, for the message.
    :raises WrongValue: they stand for too much text, or refer to themselves.
    """
    values: dict[bytes, bytes] = {}
    for name, double, single in _DECLARATION.findall(content):
        values[name] = max(values.get(name, b""), double or single, key=len)
    if not values:
        return
    sizes: dict[bytes, int] = {}

    def size_of(text: bytes, depth: int) -> int:
        if depth > _MAX_DEPTH:
            raise WrongValue(f"{origin}: entities refer to others more than {_MAX_DEPTH} deep, or to themselves")
        total = len(text)
        for name in _REFERENCE.findall(text):
            if name in values:
                if name not in sizes:
                    sizes[name] = size_of(values[name], depth + 1)
                total += sizes[name]
        return total

    most = _MAX_EXPANDED + _MAX_FACTOR * len(content)
    if (found := size_of(content, 0)) > most:
        raise WrongValue(f"{origin}: {len(content)} bytes stand for {found} by their entities, expected at most {most}")
