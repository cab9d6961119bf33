"""Checks of numbers; without the physics engine, so that skills of real robots can use them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from skiros2_common.core.errors import WrongType, WrongValue


def finite(values: Sequence[Any], count: int, what: str) -> list[float]:
    """Checks a sequence of numbers.

    :param what: describes them in the error text.
    :raises WrongType: they are not numbers.
    :raises WrongValue: there are not `count` of them, or one is not finite.
    """
    try:
        found = [float(value) for value in values]
    except (TypeError, ValueError):
        raise WrongType(f"{what}: expected {count} numbers, got {values!r}") from None
    if len(found) != count or not all(map(math.isfinite, found)):
        raise WrongValue(f"{what}: expected {count} finite numbers, got {found}")
    return found
