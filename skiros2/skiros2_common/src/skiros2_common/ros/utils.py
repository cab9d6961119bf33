"""Wire formats: parameters, properties, elements and relations as JSON and as messages.

A parameter is one JSON object, an element a JSON object inside it or a `WmElement`. Types are given by name: of a
built-in type or a registered class. Other names are rejected, so a message cannot name code to call.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Any

from skiros2_common.core.element_content import is_fact
from skiros2_common.core.errors import SkirosError, UnknownName, WrongType, WrongValue
from skiros2_common.core.json_data import read_json
from skiros2_common.core.limits import Limits
from skiros2_common.core.params import PARAM_TYPE_CODES, Param, ParamHandler
from skiros2_common.core.property import Property, as_type, format_value
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_msgs import msg as msgs

log = logging.getLogger(__name__)

_BUILTIN_TYPES: dict[str, type] = {t.__name__: t for t in (str, int, float, bool, list, dict)}
_PARAM_TYPES = {code: param_type for param_type, code in PARAM_TYPE_CODES.items()}

_types: dict[str, type] = dict(_BUILTIN_TYPES)
_encoders: dict[type, Callable[..., Any]] = {}
_decoders: dict[str, Callable[[Any], Any]] = {}


def json_loads_byteified(json_text: str) -> Any:
    """Parses a JSON text; None if it is not JSON or nested too deeply."""
    try:
        return read_json(json_text)
    except (TypeError, ValueError):
        return None


class ParamsEncoder(json.JSONEncoder):
    """Encodes parameters, properties, elements and values of registered classes; others as "NotSerializable"."""

    def default(self, obj: Any) -> Any:
        for cls in type(obj).__mro__:
            if cls in _encoders:
                return _encoders[cls](self, obj)
        return "NotSerializable"


def registerDecoder(name: str, func: Callable[[Any], Any]) -> None:
    """Registers `func`, which creates a value of the type with this wire name from its JSON form."""
    _decoders[name] = func


def registerEncoder(ctype: type, func: Callable[..., Any]) -> None:
    """Registers `func(encoder, value)`, which returns the JSON form of a value of this class."""
    _encoders[ctype] = func


def registerCtype(name: str, class_type: type) -> None:
    """Registers the wire name of a class."""
    _types[name] = class_type


def registerClass(
    name: str,
    class_type: type,
    encoder: Callable[..., Any] | None = None,
    decoder: Callable[[Any], Any] | None = None,
) -> None:
    """Registers a Python class with a wire name, so that parameters can hold its values.

    A name or class that is already registered is logged and unchanged.

    :param encoder: `encoder(json_encoder, value)` returns the JSON form.
    :param decoder: `decoder(json_value)` returns the value.
    """
    if name in _types or class_type in _types.values():
        log.warning("class %s is not registered as %r: one of them is already registered", class_type.__name__, name)
        return
    registerCtype(name, class_type)
    if encoder is not None:
        registerEncoder(class_type, encoder)
    if decoder is not None:
        registerDecoder(name, decoder)


def getStrFromType(obj: Any) -> str:
    """The wire name of a type, or of a value's type.

    :raises UnknownName: the type has no wire name.
    """
    wanted = obj if isinstance(obj, type) else type(obj)
    for cls in wanted.__mro__:
        for name, registered in _types.items():
            if registered is cls:
                return name
    raise UnknownName(f"type {wanted.__module__}.{wanted.__name__} has no wire name; see registerClass")


def getTypeFromStr(name: str) -> Any:
    """A new value of the type with this wire name: `"int"` gives 0.

    :raises UnknownName: unknown wire name, or its constructor requires arguments.
    """
    datatype = type_named(name)
    try:
        return datatype()
    except TypeError as error:
        raise UnknownName(f"a value of type {name!r} cannot be made without arguments: {error}") from None


def type_named(name: str) -> type:
    """The type with this wire name.

    :raises UnknownName: unknown wire name.
    """
    if name not in _types:
        raise UnknownName(f"unknown type name {name!r}; known: {', '.join(sorted(_types))}")
    return _types[name]


def encodeParam(encoder: Any, obj: Param) -> dict[str, Any]:
    """The JSON form of a parameter: with `unit`, `minimum`, `maximum` and `choices` where it declares them."""
    return {
        "key": obj.key,
        "description": obj.description,
        "specType": PARAM_TYPE_CODES[obj.paramType],
        "type": getStrFromType(obj.dataType()),
        "values": obj.values,
        **obj.limits.to_json(),
    }


def decodeParam(p: Any) -> Param:
    """A parameter from its JSON form (a dict or a text).

    :raises WrongValue: a field is missing or has the wrong type.
    :raises UnknownName: the type name is unknown.
    """
    p = _loaded(p, "parameter")
    key = _field(p, "key", str, "parameter")
    code = _field(p, "specType", int, f"parameter {key!r}")
    if code not in _PARAM_TYPES:
        raise WrongValue(f"parameter {key!r}: specType {code}, expected 0 (required), 1 (optional) or 2 (inferred)")
    name = _field(p, "type", str, f"parameter {key!r}")
    param = Param(key, str(p.get("description", "")), type_named(name), _PARAM_TYPES[code], Limits.from_json(p))
    param.assign(_decoded_values(name, _field(p, "values", list, f"parameter {key!r}")))
    param.makeDefault(param.values)
    return param


def encodeProperty(encoder: Any, obj: Property) -> dict[str, Any]:
    """The JSON form of a property."""
    return {"key": obj.key, "type": getStrFromType(obj.dataType()), "values": obj.values}


def decodeProperty(p: Any) -> Property:
    """A property from its JSON form (a dict or a text).

    :raises WrongValue: a field is missing or has the wrong type.
    :raises UnknownName: the type name is unknown.
    """
    p = _loaded(p, "property")
    key = _field(p, "key", str, "property")
    name = _field(p, "type", str, f"property {key!r}")
    prop = Property(key, type_named(name))
    prop.assign(_decoded_values(name, _field(p, "values", list, f"property {key!r}")))
    return prop


def encodeElement(encoder: Any, obj: Element) -> dict[str, Any]:
    """The JSON form of an element."""
    return {
        "id": obj.id,
        "label": obj.label,
        "type": obj.type,
        "last_update": 0.0,
        "properties": {key: encodeProperty(encoder, prop) for key, prop in obj._props.items()},
        "relations": [{**makeRelation("", "", ""), **r} for r in obj._rels],
    }


def decodeElement(json_string: Any) -> Element:
    """An element from its JSON form (a dict or a text), as one that was read: its `changes` start from here.

    :raises WrongValue: a field is missing or has the wrong type.
    :raises UnknownName: the type name of a property is unknown.
    """
    e = _loaded(json_string, "element")
    element = Element(
        _field(e, "type", str, "element"), _field(e, "label", str, "element"), _field(e, "id", str, "element")
    )
    for prop in _field(e, "properties", dict, f"element {element!r}").values():
        decoded = decodeProperty(prop)
        element._properties[decoded.key] = decoded
    for r in _field(e, "relations", list, f"element {element!r}"):
        r = _loaded(r, "relation")
        src, pred, dst = (_field(r, name, str, f"relation of {element!r}") for name in ("src", "type", "dst"))
        element.addRelation(src, pred, dst, bool(r.get("state", True)), bool(r.get("abstract", False)))
    element = element.view()
    try:
        element._last_update = as_type(e.get("last_update") or 0.0, float)
    except WrongType as error:
        raise WrongValue(f"element {element!r}: 'last_update': {error}") from None
    return element


registerClass("skiros_wm::Element", Element, encodeElement, decodeElement)
registerEncoder(Param, encodeParam)
registerEncoder(Property, encodeProperty)

# -- messages ------------------------------------------------------------------------------------------------------


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
        msgs.Property(prop.key, _encode(prop.values), getStrFromType(prop.dataType()))
        for prop in p_map.values()
    ]


#: The encoder itself: `json.dumps` with a class makes a new one for each call, which takes three times as long.
_encode = ParamsEncoder().encode


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
            errors.append(type(error)(f"property {message.key!r}: {error}"))
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise WrongValue("; ".join(map(str, errors)))
    return properties


def _values(data_type: str, text: str) -> list[Any]:
    values = json_loads_byteified(text)
    if not isinstance(values, list):
        raise WrongValue(f"{format_value(text)} is no JSON list")
    return list(_decoded_values(data_type, values))


@lru_cache(10_000)
def _plain_values(data_type: str, text: str) -> tuple[Any, ...]:
    """The values of a short text, if they are immutable; else (). Most properties of a message are as before."""
    values = _values(data_type, text) if len(text) < 40 and data_type not in _decoders else []
    return tuple(values) if all(isinstance(value, (str, float, int)) for value in values) else ()


def element2msg(element: Element) -> Any:
    """An element as a `WmElement`, without its local relations."""
    return msgs.WmElement(
        element.id,
        element.type,
        element.label,
        serializePropertyMap(element._props),
        [relation2msg(r) for r in element._rels if is_fact(r)],
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


# -- checks --------------------------------------------------------------------------------------------------------


def _loaded(value: Any, what: str) -> dict[str, Any]:
    if isinstance(value, (str, bytes)):
        try:
            value = read_json(value)
        except ValueError as error:
            raise WrongValue(f"{what} is not JSON: {error} in {format_value(value)}") from None
    if not isinstance(value, dict):
        raise WrongValue(f"{what}: expected a JSON object, got {format_value(value)}")
    return value


def _field(value: dict[str, Any], name: str, expected: type, what: str) -> Any:
    field = value.get(name)
    if not isinstance(field, expected) or (expected is int and isinstance(field, bool)):
        raise WrongValue(f"{what}: expected {name!r} to be a {expected.__name__}, got {format_value(field)}")
    return field


def _decoded_values(name: str, values: list[Any]) -> list[Any]:
    decoder = _decoders.get(name)
    return [decoder(v) for v in values] if decoder is not None else values
