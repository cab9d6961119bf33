"""How the states of nodes look and are called: told apart by symbol and word too, not by colour alone."""

from __future__ import annotations

from dataclasses import dataclass

#: The states on the wire.
SUCCESS, FAILURE, RUNNING, IDLE = 1, 2, 3, 4


@dataclass(frozen=True)
class Look:
    """
    :param symbol: one character.
    :param word: in a sentence after "is" or "has".
    :param signal: the name of its colour, as `qt.theme.signal_colour` takes it.
    """

    symbol: str
    word: str
    signal: str


LOOKS = {
    SUCCESS: Look("✓", "succeeded", "success"),
    FAILURE: Look("✗", "failed", "failure"),
    RUNNING: Look("▶", "running", "running"),
    IDLE: Look("○", "idle", "idle"),
}

#: Of a state that nobody has heard of: a manager may say anything.
_UNKNOWN = Look("?", "in an unknown state", "changed")


def look_of(state: int) -> Look:
    """How a state looks; one that is none of the four too."""
    return LOOKS.get(state, _UNKNOWN)
