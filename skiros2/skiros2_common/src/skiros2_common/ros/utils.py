"""Wire formats: parameters, properties, elements and relations as messages, and the names of their JSON forms.

See `skiros2_common.core.json_codec`; an element is a JSON object inside a parameter, or a `WmElement`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import lru_cache
from json.encoder import encode_basestring_ascii
from typing import Any

from skiros2_common.core.element_content import is_fact
from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.json_codec import (
    ParamsEncoder,
    decoded_values,
    decodeElement,
    decodeParam,
    decodeProperty,
    encodeElement,
    encodeParam,
    encodeProperty,
    getStrFromType,
    getTypeFromStr,
    has_decoder,
    json_loads_byteified,
    registerClass,
    registerCtype,
    registerDecoder,
    registerEncoder,
    type_named,
)
from skiros2_common.core.params import Param, ParamHandler
from skiros2_common.core.property import Property, format_value
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_msgs import msg as msgs

__all__ = [
    "ParamsEncoder",
    "decodeElement",
    "decodeParam",
    "decodeProperty",
    "deserializeParamMap",
    "deserializePropertyMap",
    "element2msg",
    "encodeElement",
    "encodeParam",
    "encodeProperty",
    "getStrFromType",
    "getTypeFromStr",
    "json_loads_byteified",
    "makeRelation",
    "makeRelationMsg",
    "makeStatementMsg",
    "msg2element",
    "msg2relation",
    "registerClass",
    "registerCtype",
    "registerDecoder",
    "registerEncoder",
    "relation2msg",
    "serializeParamMap",
    "serializePropertyMap",
    "type_named",
]


def serializeParamMap(param_map: Mapping[str, Param] | ParamHandler) -> list[Any]:
    """Parameters as a list of `Param` messages."""
    return [msgs.Param(json.dumps(param, cls=ParamsEncoder)) for param in param_map.values()]


def deserializeParamMap(params: Iterable[Any]) -> dict[str, Param]:
    """Parameters by key, from `Param` messages.

    :raises WrongValue: a message is not a parameter, or two have the same key.
    :raises UnknownName: a type name is unknown.
    """
    decoded: dict[str, Param] = {}
    for message in params:
        param = decodeParam(message.param)
        if param.key in decoded:
            raise WrongValue(f"parameter {param.key!r} is given twice")
        decoded[param.key] = param
    return decoded


def serializePropertyMap(p_map: Mapping[str, Property]) -> list[Any]:
    """Properties as a list of `Property` messages."""
    return [
        msgs.Property(prop.key, _encode_values(prop.values), getStrFromType(prop.dataType())) for prop in p_map.values()
    ]


#: The encoder itself: `json.dumps` with a class makes a new one for each call, which takes three times as long.
_encode = ParamsEncoder().encode


def _encode_values(values: list[Any]) -> str:
    """The JSON of values. One number or text, as most properties have, takes a tenth of the time of the encoder."""
    if len(values) == 1:
        value = values[0]
        kind = value.__class__
        if kind is str:
            return f"[{encode_basestring_ascii(value)}]"
        text = repr(value) if kind is float or kind is int else "n"
        if text[-1] not in "fn":  # neither inf nor nan
            return f"[{text}]"
    return _encode(values)


def deserializePropertyMap(msg: Iterable[Any]) -> dict[str, Property]:
    """Properties by key, from `Property` messages.

    :raises WrongValue: values are not a JSON list.
    :raises UnknownName: a type name is unknown.
    :raises WrongType: a value does not have the message's type.

    Several errors are raised as one `WrongValue` with all texts.
    """
    properties: dict[str, Property] = {}
    errors: list[SkirosError] = []
    for message in msg:
        try:
            prop = Property(message.key, type_named(message.dataType))
            given = message.dataType, message.dataValue
            prop.assign(_plain_values(*given) or _values(*given))
            properties[message.key] = prop
        except SkirosError as error:
            errors.append(error.with_text(f"property {message.key!r}: {error}"))
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise WrongValue("; ".join(map(str, errors)))
    return properties


def _values(data_type: str, text: str) -> list[Any]:
    values = json_loads_byteified(text)
    if not isinstance(values, list):
        raise WrongValue(f"{format_value(text)} is not a JSON list")
    return list(decoded_values(data_type, values))


@lru_cache(10_000)
def _plain_values(data_type: str, text: str) -> tuple[Any, ...]:
    """The values of a short text, if they are immutable; else (). Most properties of a message are as before."""
    values = _values(data_type, text) if len(text) < 40 and not has_decoder(data_type) else []
    return tuple(values) if all(isinstance(value, (str, float, int)) for value in values) else ()


def element2msg(element: Element) -> Any:
    """An element as a `WmElement`, without its local relations."""
    return msgs.WmElement(
        element.id,
        element.type,
        element.label,
        serializePropertyMap(element.property_view),
        [relation2msg(r) for r in element.relation_view if is_fact(r)],
    )


def msg2element(msg: Any) -> Element:
    """An element from a `WmElement`.

    :raises WrongValue: a property or relation cannot be read.
    :raises UnknownName: a type name is unknown.
    """
    element = Element(msg.type, msg.label, msg.id)
    try:
        element._properties = deserializePropertyMap(msg.properties)
    except ValueError as error:
        raise WrongValue(f"element {element!r}: {error}") from None
    element._relations = [msg2relation(r) for r in msg.relations]
    return element


def relation2msg(r: RelationDict) -> Any:
    """A relation dict as a `Relation` message."""
    return msgs.Relation(r["src"], r["type"], r["dst"])


def msg2relation(msg: Any) -> RelationDict:
    """A relation dict from a `Relation` message."""
    return makeRelation(msg.subjectId, msg.predicate, msg.objectId)


def makeRelation(subj: str, pred: str, obj: str) -> RelationDict:
    """A relation dict."""
    return {"src": subj, "type": pred, "dst": obj, "state": True, "abstract": False}


def makeRelationMsg(subj: str, pred: str, obj: str) -> Any:
    """A `Relation` message."""
    return msgs.Relation(subj, pred, obj)


def makeStatementMsg(subj: str, pred: str, obj: str, value: bool) -> Any:
    """A `Statement` message: the relation must exist (True) or not."""
    return msgs.Statement(makeRelationMsg(subj, pred, obj), value)
