"""The symbol, word and colour role of each node state."""

from __future__ import annotations

from dataclasses import dataclass

#: The values of `SkillProgress.state`.
SUCCESS, FAILURE, RUNNING, IDLE = 1, 2, 3, 4


@dataclass(frozen=True)
class StateStyle:
    """:param symbol: one character.
    :param word: fits after "is" or "has".
    :param colour_role: see `role_colour`.
    """

    symbol: str
    word: str
    colour_role: str


STYLES = {
    SUCCESS: StateStyle("✓", "succeeded", "success"),
    FAILURE: StateStyle("✗", "failed", "failure"),
    RUNNING: StateStyle("▶", "running", "running"),
    IDLE: StateStyle("○", "idle", "idle"),
}

#: The style of any other value.
_UNKNOWN = StateStyle("?", "in an unknown state", "changed")


def style_of(state: int) -> StateStyle:
    """Returns the style of a state; unknown states have one too."""
    return STYLES.get(state, _UNKNOWN)
