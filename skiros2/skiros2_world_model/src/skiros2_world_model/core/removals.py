"""The removed elements of a scene: who removed them, and when."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skiros2_world_model.core.scene import Provenance

#: The most removed elements that a scene remembers.
_MOST = 10_000


class Removals:
    """The changes that removed elements, by id, for as many as are remembered; not for elements that exist again."""

    def __init__(self) -> None:
        self._made: dict[str, Provenance] = {}

    def get(self, eid: str) -> Provenance | None:
        """The change that removed an element; None when none is known."""
        return self._made.get(eid)

    def note(self, eid: str, made: Provenance | None) -> None:
        """An element was removed by a change, or (None) exists again."""
        self._made.pop(eid, None)
        if made is not None:
            self._made[eid] = made
            if len(self._made) > _MOST:
                del self._made[next(iter(self._made))]

    def succeed(
        self, before: Removals, ids: Iterable[str], made: Provenance | None, exists: Callable[[str], bool]
    ) -> None:
        """Takes over the removals of a scene that is replaced.

        :param ids: its elements.
        :param made: the change that replaced it; None: not known.
        :param exists: whether an element is in the new scene.
        """
        for eid, removed in before._made.items():
            self.note(eid, None if exists(eid) else removed)
        for eid in ids:
            self.note(eid, None if exists(eid) else made)
