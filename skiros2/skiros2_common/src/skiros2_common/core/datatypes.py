"""Datatypes of the ontology and the Python types of their values."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.property import Property, as_type, from_text

#: The Python types of the datatypes that `setProperty` takes.
DATATYPES: dict[str, type] = {
    "xsd:float": float,
    "xsd:double": float,
    "xsd:decimal": float,
    "xsd:int": int,
    "xsd:integer": int,
    "xsd:boolean": bool,
    "xsd:string": str,
}


def converted(key: str, value: Any, datatype: type) -> Property:
    """A property of that type with the value, or values, converted to it.

    :raises WrongValue: a value cannot be converted.
    """
    if value is None or isinstance(value, type):
        return Property(key, datatype)
    prop = Property(key, datatype)
    values = value if isinstance(value, (list, tuple)) else [value]
    converted = []
    for item in values:
        try:
            converted.append(from_text(item, datatype) if isinstance(item, str) else as_type(item, datatype))
        except (WrongValue, WrongType):
            try:
                converted.append(datatype(item))
            except (TypeError, ValueError) as error:
                raise WrongValue(f"{key}: {item!r} cannot be made a {datatype.__name__}") from error
    prop.assign(converted)
    return prop
