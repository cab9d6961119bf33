"""The scene at one time as plain data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.names import local_name
from skiros2_common.core.world_element import Element

#: Subject, predicate, object.
Triple = tuple[str, str, str]

SELF = "-1"


@dataclass
class Thing:
    """An element without its relations."""

    id: str
    type: str
    label: str
    properties: dict[str, list[Any]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The label without prefix, or the id."""
        return local_name(self.label) or self.id

    @property
    def size(self) -> tuple[float, float, float]:
        """Edge lengths of its box (m); 0 without a size."""
        x, y, z = (float(next(iter(self.properties.get(f"skiros:Size{axis}", [])), 0.0)) for axis in "XYZ")
        return x, y, z


@dataclass
class WorldState:
    """Things and their relations."""

    things: dict[str, Thing] = field(default_factory=dict)
    relations: set[Triple] = field(default_factory=set)

    @classmethod
    def of(cls, elements: Iterable[Element]) -> WorldState:
        """Creates the state from elements."""
        state = cls()
        for element in elements:
            properties = {p.key: list(p.values) for p in element.properties}
            state.things[element.id] = Thing(element.id, element.type, element.label, properties)
            for relation in element.getRelations():
                subject, other = (element.id if end == SELF else end for end in (relation["src"], relation["dst"]))
                state.relations.add((subject, relation["type"], other))
        return state

    def name(self, thing_id: str) -> str:
        """Returns the name of a thing: its label without prefix, or its id."""
        thing = self.things.get(thing_id)
        return thing.name if thing is not None else thing_id

    def holders(self, thing_id: str, predicate: str) -> list[str]:
        """Returns the subjects of a relation to a thing."""
        return sorted(s for s, p, o in self.relations if p == predicate and o == thing_id)

    def labelled(self, label: str) -> Thing:
        """Returns the thing with a label.

        :raises UnknownName: there is not exactly one.
        """
        found = [thing for thing in self.things.values() if thing.label == label]
        if len(found) != 1:
            labels = ", ".join(sorted({t.label for t in self.things.values() if t.label})) or "none"
            problem = "several elements are" if found else "no element is"
            raise UnknownName(f"{problem} labelled {label!r} in the scene; labels there: {labels}")
        return found[0]

    def only(self, kind: str) -> Thing:
        """Returns the thing of a type.

        :raises UnknownName: there is not exactly one.
        """
        found = [thing for thing in self.things.values() if thing.type == kind]
        if len(found) != 1:
            raise UnknownName(f"{len(found)} elements are of type {kind} in the scene, expected one")
        return found[0]
