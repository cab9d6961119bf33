"""What a world model holds at a moment, to see at little cost what is still the same later."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol


class Mark(Protocol):
    """What stands for an element as it is now."""

    @property
    def version(self) -> int:
        """The `Element.version` that would be read."""


@dataclass(frozen=True, slots=True)
class Present:
    """Marks of what can be read from a world model. To be asked for anew when its `version` has changed. Any thread.

    :param ontology: what the ontologies say; another object after each change.
    :param element: gives for an id what stands for the element, another object after each change of the content or the
        relations, both ways; None when there is no such element.
    """

    ontology: object
    element: Callable[[str], Mark | None]
