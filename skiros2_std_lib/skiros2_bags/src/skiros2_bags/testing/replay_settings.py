"""Settings and result of a replay."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from skiros2_runs.core.compare import Divergence
from skiros2_runs.core.tolerance import NARROW, Tolerance

#: The most event orders tried by default. Each takes at most as long as the first pass. The five recorded runs in
#: tests/bags need 1 each.
MAX_ORDERS = 20


@dataclass(frozen=True)
class Settings:
    """Settings of a replay.

    :param workspace: folder of additional ontologies for the scene; None for the recorded parameter `workspace_dir` of
        the world model.
    :param played: labels of primitives that a re-run replaces by their recorded progress. Primitives that call
        services are always replaced, since bags do not contain answers of services.
    :param tolerance: of measured numbers.
    :param launch: for `trace`, what to start besides the platform: package, launch file, arguments. Empty: action
        servers answer as recorded.
    :param max_orders: the most orders of nearly simultaneous events that a re-run tries.
    """

    workspace: Path | None = None
    played: frozenset[str] = frozenset()
    tolerance: Tolerance = NARROW
    launch: tuple[str, ...] = ()
    max_orders: int = MAX_ORDERS


@dataclass(frozen=True)
class ReplayResult:
    """The result of a replay.

    :param divergence: the first one; None without one.
    :param orders: the number of event orders that a re-run has tried.
    """

    divergence: Divergence | None
    orders: int = 1

    def __str__(self) -> str:
        text = "as recorded" if self.divergence is None else str(self.divergence)
        return text if self.orders == 1 else f"{text}\n{self.orders} event orders were tried"
