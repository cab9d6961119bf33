"""The status of the system's parts as text."""

from __future__ import annotations

import time
from collections.abc import Sequence

from skiros2_gui.app.system import MANAGER, MASTER, TASK_MANAGER, WORLD_MODEL, Part


def short(part: Part) -> str:
    """Returns the name of a part for the status line."""
    return f"{part.kind} {part.name.lstrip('/')}" if part.kind == MANAGER else part.kind


def sign(part: Part) -> tuple[str, str]:
    """Returns the status symbol of a part and its colour role."""
    if part.is_up:
        return "●", "success"
    return ("✕", "failure") if part.since else ("○", "idle")


def sentence(part: Part) -> str:
    """Describes the status of a part in one sentence."""
    if not part.is_up and not part.since:
        return f"{_never(part.kind)} {part.text}".rstrip()
    name = f"The {part.kind} {part.name}" if part.kind in (MASTER, MANAGER) else f"The {part.kind}"
    since = clock(part.since)
    if part.is_up:
        return f"{name} has been there since {since}."
    more = f" {part.text}" if part.text else ""
    return f"{name} has not been there since {since}.{more}"


def clock(stamp: float) -> str:
    """Formats a time (s since the epoch); with the date unless it is today."""
    then = time.localtime(stamp)
    is_today = then[:3] == time.localtime()[:3]
    return time.strftime("%H:%M:%S" if is_today else "%Y-%m-%d %H:%M:%S", then)


def missing(parts: Sequence[Part], needs: Sequence[str]) -> str:
    """Describes the required parts that are missing; "" if none is.

    :param needs: the kinds of parts required. One part of each kind is enough.
    """
    kinds = {p.kind: p for p in parts}
    if MASTER in kinds and not kinds[MASTER].is_up:
        return sentence(kinds[MASTER]) + " The window reconnects when it is back."
    sentences = []
    for kind in needs:
        of_kind = [p for p in parts if p.kind == kind]
        if any(p.is_up for p in of_kind):
            continue
        sentences += [sentence(p) for p in of_kind] or [_never(kind)]
    return " ".join(sentences)


def _never(kind: str) -> str:
    return {
        WORLD_MODEL: "The world model is not there yet.",
        MANAGER: "No robot is there yet: no skill manager runs.",
        TASK_MANAGER: "The task manager is not there yet.",
    }.get(kind, f"There is no {kind} yet.")
