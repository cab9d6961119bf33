"""Parameters, properties and elements as JSON.

A parameter is one JSON object, an element a JSON object inside it. Types are given by name: of a built-in type or a
registered class. Other names are rejected, so a message cannot name code to call.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping
from typing import Any

from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.errors import SkirosError, UnknownName, WrongType, WrongValue
from skiros2_common.core.json_data import read_json
from skiros2_common.core.limits import Limits
from skiros2_common.core.params import PARAM_TYPE_CODES, Param
from skiros2_common.core.property import Property, as_type, format_value
from skiros2_common.core.world_element import Element

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
    param.assign(decoded_values(name, _field(p, "values", list, f"parameter {key!r}")))
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
    prop.assign(decoded_values(name, _field(p, "values", list, f"property {key!r}")))
    return prop


def encodeElement(encoder: Any, obj: Element) -> dict[str, Any]:
    """The JSON form of an element."""
    return {
        "id": obj.id,
        "label": obj.label,
        "type": obj.type,
        "last_update": 0.0,
        "properties": {key: encodeProperty(encoder, prop) for key, prop in obj.property_view.items()},
        "relations": [{**relation_dict("", "", ""), **r} for r in obj.relation_view],
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
        element.last_update = as_type(e.get("last_update") or 0.0, float)
    except WrongType as error:
        raise WrongValue(f"element {element!r}: 'last_update': {error}") from None
    return element


registerClass("skiros_wm::Element", Element, encodeElement, decodeElement)
registerEncoder(Param, encodeParam)
registerEncoder(Property, encodeProperty)


def has_decoder(name: str) -> bool:
    """Whether values of the type with this wire name differ from their JSON form."""
    return name in _decoders


def _loaded(value: Any, what: str) -> dict[str, Any]:
    if isinstance(value, (str, bytes)):
        try:
            value = read_json(value if isinstance(value, str) else value.decode())
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


def decoded_values(name: str, values: list[Any]) -> list[Any]:
    """The values of a type, given by name, from their JSON forms."""
    decoder = _decoders.get(name)
    return [decoder(v) for v in values] if decoder is not None else values


def param_texts(params: Mapping[str, Param]) -> list[str]:
    """Encodes parameters; those with values that have no JSON form are left out."""
    texts = []
    for param in params.values():
        try:
            texts.append(json.dumps(param, cls=ParamsEncoder))
        except (SkirosError, TypeError, ValueError, RecursionError) as error:
            log.debug("parameter %r has no JSON form: %s", param.key, error)
    return texts
