"""What a world model holds at a moment, to see at little cost what is still the same later."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Present:
    """Marks of what can be read from a world model. To be asked for anew when its `version` has changed. Any thread.

    :param ontology: what the ontologies say; another object after each change.
    :param element: gives for an id an object that is another one after each change of the element's content or of its
        relations, both ways; None when there is no such element.
    """

    ontology: object
    element: Callable[[str], object]
