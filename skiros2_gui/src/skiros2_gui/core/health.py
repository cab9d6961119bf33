"""What is up, in words for people."""

from __future__ import annotations

import time
from collections.abc import Sequence

from skiros2_gui.core.system import MANAGER, MASTER, TASK_MANAGER, WORLD_MODEL, Part


def short(part: Part) -> str:
    """A part as it stands in the status line."""
    return f"{part.kind} {part.name.lstrip('/')}" if part.kind == MANAGER else part.kind


def sign(part: Part) -> tuple[str, str]:
    """What stands before a part in the status line, and the name of its colour."""
    if part.is_up:
        return "●", "success"
    return ("✕", "failure") if part.since else ("○", "idle")


def sentence(part: Part) -> str:
    """How a part is, in one sentence."""
    if not part.is_up and not part.since:
        return f"{_never(part.kind)} {part.text}".rstrip()
    name = f"The {part.kind} {part.name}" if part.kind in (MASTER, MANAGER) else f"The {part.kind}"
    since = clock(part.since)
    if part.is_up:
        return f"{name} has been there since {since}."
    more = f" {part.text}" if part.text else ""
    return f"{name} has not been there since {since}.{more}"


def clock(stamp: float) -> str:
    """A time (s since the epoch) as people read it; with the day where that is not today."""
    then = time.localtime(stamp)
    is_today = then[:3] == time.localtime()[:3]
    return time.strftime("%H:%M:%S" if is_today else "%Y-%m-%d %H:%M:%S", then)


def missing(parts: Sequence[Part], needs: Sequence[str]) -> str:
    """What is missing of what is needed, as a line to be shown; "" when nothing is.

    :param needs: kinds of parts. Of a kind with several, one that is up is enough.
    """
    kinds = {p.kind: p for p in parts}
    if MASTER in kinds and not kinds[MASTER].is_up:
        return sentence(kinds[MASTER]) + " The window goes on when it is there again."
    told = []
    for kind in needs:
        of_kind = [p for p in parts if p.kind == kind]
        if any(p.is_up for p in of_kind):
            continue
        told += [sentence(p) for p in of_kind] or [_never(kind)]
    return " ".join(told)


def _never(kind: str) -> str:
    return {
        WORLD_MODEL: "The world model is not there yet.",
        MANAGER: "No robot is there yet: no skill manager runs.",
        TASK_MANAGER: "The task manager is not there yet.",
    }.get(kind, f"There is no {kind} yet.")
