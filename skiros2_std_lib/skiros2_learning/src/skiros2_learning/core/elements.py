"""Finds the elements that a scenario names."""

from __future__ import annotations

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.names import is_of_class
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_learning.core.sections import near

#: Classes of the elements by which a running manager describes its skills: they may have the labels of things.
_DESCRIPTIONS = ("skiros:Skill", "skiros:Parameter", "skiros:Condition", "skiros:ParameterSet")


def find_element(wmi: WorldModelPort, name: str) -> Element:
    """Returns the element with an id or a label.

    :raises UnknownName: there is none.
    :raises WrongValue: there are several.
    """
    element = wmi.find_element(name)
    if element is not None:
        return element
    found = [each for each in wmi.resolve_elements(Element("", name)) if not _describes(each, wmi)]
    if not found:
        known = {each.label for each in wmi.get_scene_elements() if each.label and not _describes(each, wmi)}
        raise UnknownName(f"no element is labelled {name!r}; {near(name, known)}")
    if len(found) > 1:
        raise WrongValue(f"several elements are labelled {name!r}: {', '.join(sorted(each.id for each in found))}")
    return found[0]


def _describes(element: Element, wmi: WorldModelPort) -> bool:
    return any(is_of_class(element.type, each, wmi) for each in _DESCRIPTIONS)
