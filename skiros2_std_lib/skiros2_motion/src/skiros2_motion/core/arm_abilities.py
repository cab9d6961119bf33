"""What the driver of a compliant arm can do, as skills have to allow for it."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from typing import NamedTuple, Protocol, runtime_checkable


class Abilities(NamedTuple):
    """What a driver does itself. The rest is done by its adapter, as far as possible.

    :param limits: whether the driver checks the limits of the wrench at its control rate. If not, the adapter does at
        each state, and stops the arm by its reference.
    :param wrench: whether the driver takes a wrench. If not, an offset of the reference by wrench over stiffness.
    :param overlay: whether the driver adds spirals to the reference. If not, the adapter does at each tick.
    :param damping: whether damping factors have an effect.
    :param state_period: longest time between two of the last states (s of wall time); 0 if it was not measured.
    :param force_rate: rate of the loop that regulates forces (Hz); infinite for that of the driver's control. If it is
        finite, the adapter closes the loop at its states.
    """

    limits: bool = True
    wrench: bool = True
    overlay: bool = True
    damping: bool = True
    state_period: float = 0.0
    force_rate: float = math.inf

    @property
    def reaction_time(self) -> float:
        """The time in which an exceeded limit is noticed, on top of the driver's control period (s)."""
        return 0.0 if self.limits else self.state_period

    def added_force(self, speed: float, stiffness: float) -> float:
        """Returns the force (N) by which a contact exceeds a limit before it is noticed: time x speed x stiffness.

        :param speed: of the reference (m/s).
        :param stiffness: along the motion (N/m).
        """
        return self.reaction_time * speed * stiffness

    def __str__(self) -> str:
        missing = [name for name, has in zip(self._fields[:4], self[:4], strict=True) if not has]
        lacks = f"the driver has no {', '.join(missing)}; " if missing else ""
        return f"{lacks}a state every {1000.0 * self.state_period:.0f} ms"


@runtime_checkable
class Described(Protocol):
    """An arm whose driver lacks something, or whose state is slow."""

    def abilities(self) -> Abilities:
        """Returns what the driver does, as known at the last `begin`."""
        ...


def abilities_of(arm: object) -> Abilities:
    """Returns the abilities of an arm: all, without those that it says it lacks."""
    return arm.abilities() if isinstance(arm, Described) else Abilities()


class StatePeriod:
    """Measures the time between states.

    :param count: how many of the last intervals count.
    """

    def __init__(self, count: int = 20) -> None:
        self._times: deque[float] = deque(maxlen=count + 1)

    def add(self, time: float) -> None:
        """A state was received (s)."""
        self._times.append(time)

    def restart(self) -> None:
        """Forgets the states before."""
        self._times.clear()

    @property
    def longest(self) -> float:
        """The longest interval (s); 0 before the second state."""
        return max((b - a for a, b in pairwise(list(self._times))), default=0.0)
