"""A joint of a robot in the simulated world, and the numbers that its motors take."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import WrongType, WrongValue

_KINDS = {0: "revolute", 1: "prismatic", 4: "fixed"}


@dataclass(frozen=True)
class Joint:
    """A joint. Positions in m or rad, velocities per second, effort in N or Nm.

    :param index: of the joint, and of the link that it moves, in PyBullet's model.
    :param child: name of the link that it moves.
    :param lower: -inf, and upper inf, for one without limits.
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
        """From what PyBullet's `getJointInfo` tells."""
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
    """As many finite numbers.

    :param what: what they are, for the text of the error.
    :raises WrongType: they are no numbers.
    :raises WrongValue: there are more or fewer, or one is not finite.
    """
    try:
        found = [float(value) for value in values]
    except (TypeError, ValueError):
        raise WrongType(f"{what}: expected {count} numbers, got {values!r}") from None
    if len(found) != count or not all(map(math.isfinite, found)):
        raise WrongValue(f"{what}: expected {count} finite numbers, got {found}")
    return found
