"""The commands of the execution state machine."""

from __future__ import annotations

from dataclasses import dataclass

from skiros2_task.core.plan import Step
from skiros2_task.core.planning import Verdict


@dataclass(frozen=True)
class MakePlan:
    """Make a plan; answered by `planned` or `no_plan`.

    :param running: steps that run, whose effects are assumed.
    :param lost: the managers that do not run.
    :param avoided: (manager, skill label) pairs to plan without if possible.
    """

    running: tuple[Step, ...]
    lost: frozenset[str]
    avoided: frozenset[tuple[str, str]]


@dataclass(frozen=True)
class Claim:
    """Request these robots and devices, in place of the last request; answered by `granted` once all are free.

    :param in_use: the requested ones that running steps use.
    """

    requested: frozenset[str]
    in_use: frozenset[str]


@dataclass(frozen=True)
class Start:
    """Start a step; answered by `ended`."""

    step: Step


@dataclass(frozen=True)
class Stop:
    """Stop a running step; answered by `ended`."""

    number: int


@dataclass(frozen=True)
class ReadWorld:
    """Read the world model after `delay` (s); answered by `world`."""

    delay: float = 0.0


@dataclass(frozen=True)
class Wake:
    """Call `wake` after `delay` (s)."""

    delay: float


@dataclass(frozen=True)
class End:
    """The execution has ended. `verdict` is `PLANNED` if the goal was reached.

    :param missing: see `PlanningResult`.
    """

    verdict: Verdict
    message: str
    missing: tuple[str, ...] = ()


Command = MakePlan | Claim | Start | Stop | ReadWorld | Wake | End
