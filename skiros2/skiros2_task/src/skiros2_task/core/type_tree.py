"""Classes as PDDL types.

A class of the ontology may have several superclasses, and classes may cross; PDDL types form a tree. So the tree is
made of those classes whose objects nest: of two, one holds all objects of the other, or they share none. A class that
crosses one of the tree becomes a static predicate instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from skiros2_task.core.task import EVERYTHING


class TypeTree:
    """The types for some objects, by the name of their class; `EVERYTHING` is the root."""

    def __init__(self, members: Mapping[str, Sequence[str]], flat: bool = False) -> None:
        """
        :param members: the objects of each class, general classes before those under them; with `EVERYTHING`.
        :param flat: no types but the root; all classes are static predicates.
        """
        everything = frozenset(members[EVERYTHING])
        self._objects: dict[str, frozenset[str]] = {EVERYTHING: everything}
        #: The type above each type but the root.
        self.parent: dict[str, str] = {}
        #: The classes that have to be static predicates.
        self.crossing: list[str] = []
        sizes = sorted((cls for cls in members if cls != EVERYTHING), key=lambda cls: -len(members[cls]))
        for cls in sizes:
            objects = frozenset(members[cls])
            if not flat and all(objects <= other or not objects & other for other in self._objects.values()):
                self.parent[cls] = self.smallest(objects)
                self._objects[cls] = objects
            else:
                self.crossing.append(cls)
        self._depth = {t: len(self.line(t)) for t in self._objects}
        #: The type of each object: the smallest that holds it.
        self.type_of: dict[str, str] = dict.fromkeys(members[EVERYTHING], EVERYTHING)
        for cls in sorted(self.parent, key=lambda t: self._depth[t]):
            self.type_of.update(dict.fromkeys(self._objects[cls], cls))

    def smallest(self, objects: Iterable[str]) -> str:
        """The smallest type that holds all of some objects; of equal ones the last."""
        wanted = frozenset(objects)
        best = EVERYTHING
        for cls, there in self._objects.items():
            if wanted <= there and len(there) <= len(self._objects[best]):
                best = cls
        return best

    def line(self, cls: str) -> list[str]:
        """A type and those above it, up to the root."""
        found = [cls]
        while found[-1] in self.parent:
            found.append(self.parent[found[-1]])
        return found

    def join(self, one: str, other: str) -> str:
        """The smallest type above, or equal to, both."""
        above = set(self.line(one))
        return next(t for t in self.line(other) if t in above)
