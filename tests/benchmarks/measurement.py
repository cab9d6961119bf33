"""A figure beside its peer's: medians over several runs of both, taken in turn."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Measurement:
    """One row of the table.

    :param name: what was measured.
    :param median: of our runs, in `unit`.
    :param runs: how many of each.
    :param peer: what it is compared with.
    :param ratio: `median / peer_median`.
    :param target: what the ratio should be at most, None where no target is set yet.
    """

    name: str
    median: float
    unit: str
    runs: int
    peer: str
    peer_median: float
    ratio: float
    target: float | None = None

    def as_json(self) -> dict[str, object]:
        return {key: value for key, value in asdict(self).items() if value is not None}


def paired(
    name: str,
    ours: Callable[[], float],
    peer_name: str,
    peer: Callable[[], float],
    *,
    unit: str,
    runs: int,
    warm_up: int = 1,
    target: float | None = None,
    limit: float | None = None,
) -> Measurement:
    """Runs both in turn, so that a machine whose speed drifts slows both. Each returns its figure.

    :param limit: the target as a figure, where it is not one of the ratio.
    """
    for _ in range(warm_up):
        ours(), peer()
    pairs = [(ours(), peer()) for _ in range(runs)]
    median = statistics.median(p[0] for p in pairs)
    peer_median = statistics.median(p[1] for p in pairs)
    ratio = statistics.median(p[0] / p[1] for p in pairs)
    if limit is not None:
        target = round(limit / peer_median, 2)
    return Measurement(name, median, unit, runs, peer_name, peer_median, ratio, target)


def seconds_per_call(call: Callable[[], object], calls: int) -> float:
    """The mean time of a call (s)."""
    start = time.perf_counter()
    for _ in range(calls):
        call()
    return (time.perf_counter() - start) / calls


def cpu_seconds(pid: int) -> float:
    """The CPU time that a process has taken so far (s)."""
    return time.clock_gettime(~pid << 3 | 2)  # the clock that clock_getcpuclockid(3) returns


def table(measurements: list[Measurement]) -> str:
    """The measurements as text, a line each."""
    header = ("what", "median", "peer", "peer's median", "ratio", "target")
    rows = [
        (
            m.name,
            f"{m.median:.3g} {m.unit}",
            m.peer,
            f"{m.peer_median:.3g} {m.unit}",
            f"{m.ratio:.2f}",
            "" if m.target is None else f"<= {m.target:g}{'' if m.ratio <= m.target else '  MISSED'}",
        )
        for m in measurements
    ]
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in (header, *rows)]
    lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(line.rstrip() for line in lines)
