"""Values in requests."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator, ValidationInfo

#: The context in which orders of a store are read: earlier versions have stored any number.
STORED = {"is_stored": True}


def _check(value: bool | int | float | str, info: ValidationInfo) -> bool | int | float | str:
    """Returns a value that every interface can carry."""
    is_right = info.context is STORED
    is_right |= -(2**63) <= value < 2**63 if isinstance(value, int) else isinstance(value, str) or math.isfinite(value)
    if not is_right:
        raise ValueError(f"{str(value)[:50]} is not a finite number or not an integer of 64 bits")
    return value


#: A value of a parameter of a work master.
Value = Annotated[bool | int | float | str, AfterValidator(_check)]
