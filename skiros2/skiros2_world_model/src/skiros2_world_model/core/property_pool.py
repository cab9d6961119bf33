"""Equal properties of a scene are one object: most sizes, states and frames of a cell are the same few."""

from __future__ import annotations

from collections.abc import Hashable

from skiros2_common.core.property import Property

_PLAIN = (float, int, bool, str)


class PropertyPool:
    """The properties that were seen last. What it is given must never be changed.

    :param size: it forgets all when it holds so many.
    """

    def __init__(self, size: int = 10_000) -> None:
        self._size = size
        self._known: dict[Hashable, Property] = {}

    def shared(self, prop: Property) -> Property:
        """A property that is equal in key, type and values: one that was seen, or this one."""
        values = prop.values
        datatype = prop.dataType()
        if len(values) > 1 or datatype not in _PLAIN:
            return prop
        value: Hashable = None
        if values:
            value = values[0] or (repr(values[0]),)  # by their texts 0.0 and -0.0 differ, which are equal as numbers
        if len(self._known) >= self._size:
            self._known.clear()
        return self._known.setdefault((prop.key, datatype, value), prop)
