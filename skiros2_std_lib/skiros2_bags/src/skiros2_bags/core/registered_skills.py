"""The skills that managers have registered in the world model, by label: their ids differ from run to run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from skiros2_bags.core.world_history import TimedChange
from skiros2_common.core.names import local_name
from skiros2_common.core.operations import Change
from skiros2_common.core.world_element import Element

#: A property of registered skills.
MODULE = "skiros:PythonModule"


class RegisteredSkills:
    """The registered skills of a run, with their parameters and conditions.

    :param changes: all changes of the run, in order.
    """

    def __init__(self, changes: Iterable[TimedChange]) -> None:
        #: The name of each element by its id, such as `skill pick hasPreCondition GripperEmpty`.
        self.names: dict[str, str] = {}
        #: The last version of each element by its name.
        self.elements: dict[str, Element] = {}
        for timed in changes:
            elements = {element.id: element for element in timed.change.elements}
            for element in elements.values():
                if MODULE in element.property_view:
                    for name, part in _parts(f"skill {element.label}", element, elements):
                        self.names[part.id] = name
                        self.elements[name] = part

    def concerns(self, change: Change) -> bool:
        """Whether a change is about registered skills only."""
        return bool(change.elements) and all(element.id in self.names for element in change.elements)


def _parts(name: str, element: Element, elements: dict[str, Element]) -> Iterator[tuple[str, Element]]:
    """Yields an element and those below it that belong to its skill, with their names."""
    yield name, element
    for relation in element.relation_view:
        part = elements.get(relation["dst"])
        if part is not None and relation["src"] in ("-1", element.id) and _is_part(part):
            yield from _parts(f"{name} {local_name(relation['type'])} {part.label}", part, elements)


def _is_part(element: Element) -> bool:
    """Whether an element is a parameter or a condition."""
    return element.type == "skiros:Parameter" or "Condition" in element.type
