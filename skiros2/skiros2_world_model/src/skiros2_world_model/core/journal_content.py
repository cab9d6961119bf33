"""What the journal holds of an element, as JSON: `[class, label, {property: values}]`.

The values of a property tell its type, as JSON parts int from float. Where they do not, because there are none or
because they are of no plain type, the property is `{"type": name, "values": [...]}`.
"""

from __future__ import annotations

import json
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.property import Property
from skiros2_world_model.core.scene import Node, Provenance

_PLAIN = (float, int, bool, str)
_TYPES: dict[str, type] = {kind.__name__: kind for kind in (*_PLAIN, list, dict, tuple)}

_encode = json.JSONEncoder(separators=(",", ":"), check_circular=False).encode


def element_text(node: Node) -> str:
    """The content of an element, without its relations.

    :raises WrongValue: a value is of a type that cannot be written.
    """
    try:
        properties = {
            key: prop._values if prop._values and prop._data_type in _PLAIN else _typed(prop)
            for key, prop in node.properties.items()
        }
        return _encode([node.type, node.label, properties])
    except (TypeError, ValueError) as error:
        raise WrongValue(f"{node.id}: {error}") from None


def read_node(eid: str, text: str, made: Provenance) -> Node:
    """The element with that content.

    :raises ValueError: the text is not as `element_text` writes it.
    """
    etype, label, properties = json.loads(text)
    return Node(eid, etype, label, {key: _property(key, values) for key, values in properties.items()}, made)


def _typed(prop: Property) -> dict[str, Any]:
    kind = prop.dataType()
    if kind.__name__ not in _TYPES:
        raise TypeError(f"{prop.key}: values of type {kind.__name__} cannot be written")
    return {"type": kind.__name__, "values": prop.values}


def _property(key: str, content: Any) -> Property:
    if isinstance(content, list):
        return Property(key, content)
    kind = _TYPES[content["type"]]
    prop = Property(key, kind)
    prop.assign([tuple(value) for value in content["values"]] if kind is tuple else content["values"])
    return prop
