"""RDF datatypes and their Python values. Must not import an RDF library: clients on Debian's Python have none."""

from __future__ import annotations

import json
import math
from typing import Any

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.property import as_type, format_value, from_text
from skiros2_world_model.core.prefixes import RDF, XSD

_FLOATS = ("float", "double", "decimal")
_INTEGERS = (
    "integer",
    "int",
    "long",
    "short",
    "byte",
    "nonNegativeInteger",
    "positiveInteger",
    "nonPositiveInteger",
    "negativeInteger",
    "unsignedLong",
    "unsignedInt",
    "unsignedShort",
    "unsignedByte",
)
_TEXTS = ("string", "normalizedString", "token", "anyURI")

#: The Python types of datatypes, by name. Values of other datatypes are texts.
PYTHON_TYPES: dict[str, type] = {
    **{f"xsd:{name}": float for name in _FLOATS},
    **{f"xsd:{name}": int for name in _INTEGERS},
    **{f"xsd:{name}": str for name in _TEXTS},
    "xsd:boolean": bool,
}

_OWN_DATATYPES: dict[type, str] = {float: "double", int: "integer", bool: "boolean", str: "string"}


def as_datatype(value: Any, datatype: str) -> Any:
    """Converts a value to a datatype, including texts of numbers and bools, which existing scenes contain.

    :param datatype: a name such as `xsd:float`; an unknown one accepts any value.
    :raises WrongType: the value cannot be converted.
    """
    kind = PYTHON_TYPES.get(datatype)
    if kind is None:
        return value
    try:
        if isinstance(value, str) and kind is not str:
            return from_text(value.strip(), kind)
        if kind is int and isinstance(value, float) and value.is_integer():
            return int(value)
        return as_type(value, kind)
    except (WrongType, WrongValue):
        raise WrongType(f"expected {datatype}, got {type(value).__name__} {format_value(value)}") from None


def literal_parts(value: Any, datatype: str = "") -> tuple[str, str]:
    """The text of a value's literal, and the IRI of its datatype.

    :param datatype: the desired datatype, such as `xsd:float`; ignored when the value does not fit it.
    """
    if isinstance(value, (list, dict, tuple)) or value is None:
        return json.dumps(value, sort_keys=True, default=str), RDF + "JSON"
    kind = bool if isinstance(value, bool) else next((t for t in (float, int, str) if isinstance(value, t)), str)
    fits = PYTHON_TYPES.get(datatype) is kind and datatype != "xsd:decimal"
    return _lexical(value), XSD + (datatype.partition(":")[2] if fits else _OWN_DATATYPES[kind])


def literal_text(value: Any, datatype: str = "") -> str:
    """The literal of a value in N3; see `literal_parts`."""
    text, iri = literal_parts(value, datatype)
    return f"{json.dumps(text, ensure_ascii=False)}^^<{iri}>"


def _lexical(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        if math.isnan(value):
            return "NaN"
        if math.isinf(value):
            return "INF" if value > 0 else "-INF"
        return repr(float(value))
    return str(value)
