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
    :param on_light, on_dark: the colour on a light and on a dark ground (Okabe and Ito's palette, made lighter or
        darker until text of it is readable).
    """

    symbol: str
    word: str
    on_light: str
    on_dark: str


LOOKS = {
    SUCCESS: Look("✓", "succeeded", "#00795A", "#2FC99B"),
    FAILURE: Look("✗", "failed", "#C04A00", "#FF8A4C"),
    RUNNING: Look("▶", "running", "#0068A8", "#6CBEF2"),
    IDLE: Look("○", "idle", "#70757A", "#9AA0A6"),
}

#: Of a state that nobody has heard of: a manager may say anything.
_UNKNOWN = Look("?", "in an unknown state", "#8A4F7D", "#D79BC8")


def look_of(state: int) -> Look:
    """How a state looks; one that is none of the four too."""
    return LOOKS.get(state, _UNKNOWN)
