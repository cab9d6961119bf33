"""Settings of a replay."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from skiros2_bags.core.tolerance import NARROW, Tolerance


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
    """

    workspace: Path | None = None
    played: frozenset[str] = frozenset()
    tolerance: Tolerance = NARROW
    launch: tuple[str, ...] = ()
