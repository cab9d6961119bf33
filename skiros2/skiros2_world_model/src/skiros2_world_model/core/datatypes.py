"""Datatypes of RDF and the Python values in them. Also for clients on Debian's Python, which has no RDF store."""

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

#: The Python type of the values of a datatype, by the datatype's name. Other datatypes hold text.
PYTHON_TYPES: dict[str, type] = {
    **{f"xsd:{name}": float for name in _FLOATS},
    **{f"xsd:{name}": int for name in _INTEGERS},
    **{f"xsd:{name}": str for name in _TEXTS},
    "xsd:boolean": bool,
}

_OWN_DATATYPES: dict[type, str] = {float: "double", int: "integer", bool: "boolean", str: "string"}


def as_datatype(value: Any, datatype: str) -> Any:
    """A value as one of a datatype: texts of numbers and bools, which scenes in the field hold, become such.

    :param datatype: a name such as `xsd:float`; one that is not known takes anything.
    :raises WrongType: it is another kind of value.
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

    :param datatype: the datatype it should have, such as `xsd:float`; the value's own when it does not fit.
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
