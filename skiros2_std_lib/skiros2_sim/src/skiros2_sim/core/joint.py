"""Joints of a robot in the simulated world."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import WrongType, WrongValue

_KINDS = {0: "revolute", 1: "prismatic", 4: "fixed"}


@dataclass(frozen=True)
class Joint:
    """A joint. Positions in rad or m, velocities per second, effort in Nm or N.

    :param index: of the joint and of its child link in PyBullet's model.
    :param child: name of the child link.
    :param lower: -inf (and `upper` inf) for a joint without limits.
    """

    name: str
    index: int
    kind: str
    child: str
    lower: float
    upper: float
    velocity: float
    effort: float

    @property
    def moves(self) -> bool:
        return self.kind != "fixed"

    @classmethod
    def of(cls, info: Sequence[Any]) -> Joint:
        """Creates a joint from the result of PyBullet's `getJointInfo`."""
        lower, upper = float(info[8]), float(info[9])
        if lower >= upper:  # PyBullet's mark of a joint without limits
            lower, upper = -math.inf, math.inf
        return cls(
            name=info[1].decode(),
            index=int(info[0]),
            kind=_KINDS.get(info[2], "other"),
            child=info[12].decode(),
            lower=lower,
            upper=upper,
            velocity=float(info[11]),
            effort=float(info[10]),
        )


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
