"""The commands `set`, `load` and `save`."""

from __future__ import annotations

import argparse
import json
from typing import Any

from skiros2_common.command_line.command import CommandResult
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import full_name
from skiros2_common.core.property import from_text
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_world_model.command_line.reading import element_json
from skiros2_world_model.core.history import changed_lines, difference
from skiros2_world_model.core.wm_errors import WmException


def set_values(wm: WorldModelPort, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Sets or removes a property, relations, the label or the type of an element in one request."""
    context = arguments.context
    element = wm.get_element(arguments.id, context)
    before = element.copy()
    name, values = full_name(arguments.name), arguments.values
    if not values and not arguments.remove:
        raise WmException(f"{element.id} {name}: the value is missing (--remove removes the property)")
    if arguments.name in ("label", "rdfs:label"):
        element.label = "" if arguments.remove else " ".join(values)
    elif arguments.name in ("type", "rdf:type"):
        element.type = full_name(values[0]) if len(values) == 1 and not arguments.remove else ""
    elif _is_relation(wm, element, name, values, context):
        _set_relations(element, name, values, arguments.remove)
    elif arguments.remove:
        _remove_property(element, name, values)
    else:
        element.removeProperty(name)
        element.setProperty(name, [_typed(wm, before, name, value) for value in values])
    wm.update_element(element, context)
    lines = [screen.fitted(line) for line in changed_lines(difference([before], [element]))]
    return CommandResult(lines or [f"{element.id} has these values already"], element_json(element))


def _is_relation(wm: WorldModelPort, element: Element, name: str, values: list[str], context: str) -> bool:
    """Whether a name denotes a relation.

    An undeclared name is a property if the element has such a property, and a relation if all values are elements.
    """
    declared = wm.get_type(name)
    if "owl:ObjectProperty" in declared:
        return True
    if "owl:DatatypeProperty" in declared or element.hasProperty(name):
        return False
    if not values:
        return bool(element.getRelations("-1", name))
    return all(wm.find_element(value, context) is not None for value in values)


def _set_relations(element: Element, name: str, objects: list[str], remove: bool) -> None:
    if not remove:
        for obj in objects:
            element.addRelation("-1", name, obj)
        return
    for obj in objects or [""]:
        if not element.getRelations("-1", name, obj):
            raise WmException(f"there is no relation {element.id} {name} {obj}".rstrip())
        element.removeRelation2("-1", name, obj)


def _remove_property(element: Element, name: str, values: list[str]) -> None:
    if not element.hasProperty(name):
        known = ", ".join(sorted(element.available_properties)) or "none"
        raise WmException(f"{element.id} has no property {name}; it has: {known}")
    if not values:
        element.removeProperty(name)
        return
    prop = element.getProperty(name)
    for text in values:
        found = next((v for v in prop.values if str(v) == text), None)
        if found is None:
            raise WmException(f"{element.id} {name} has no value {text}; it has: {prop.getValuesStr()}")
        prop.removeValue(found)


def _typed(wm: WorldModelPort, element: Element, name: str, text: str) -> Any:
    """Parses a value of a property.

    The type is that of the existing property. For a new property with a declared datatype, the server parses the text;
    without one, numbers, bools and quoted texts are parsed as JSON.

    :raises WrongValue: the text is not a value of that type.
    """
    prop = element.property_view.get(name)
    if prop is not None and prop.dataType() not in (list, dict):
        try:
            return from_text(text, prop.dataType())
        except WrongValue as error:
            raise WrongValue(f"{element.id} {name}: {error}") from None
    if prop is None and wm.get_datatype(name) is not None:
        return text
    try:
        value = json.loads(text)
    except ValueError:
        value = None
    return value if isinstance(value, prop.dataType() if prop else (str, bool, int, float)) else text


def load(wm: WorldModelPort, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Replaces a context with the content of a file."""
    wm.load(arguments.file, arguments.context)
    file = arguments.file or "its file"
    return CommandResult([f"loaded {file} into context {arguments.context}"], _said(arguments))


def save(wm: WorldModelPort, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Writes a context to a file."""
    wm.save(arguments.file, arguments.context)
    return CommandResult([f"saved context {arguments.context} to {arguments.file}"], _said(arguments))


def _said(arguments: argparse.Namespace) -> dict[str, str]:
    return {"file": arguments.file, "context": arguments.context}
