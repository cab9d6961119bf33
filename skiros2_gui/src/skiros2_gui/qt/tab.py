"""What the main widget expects of a tab."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol


class Tab(Protocol):
    """A widget that shows one side of the system. It is made with the window (`core.window.Window`)."""

    #: What stands on the tab.
    title: str
    #: The kinds of parts (`core.system`) without which there is nothing to be done in it: it is greyed out then.
    needs: tuple[str, ...]

    def settings(self) -> dict[str, Any]:
        """What is to be the same the next time, as JSON has it."""

    def restore(self, settings: Mapping[str, Any]) -> None:
        """Takes what `settings` gave some time, maybe in another version, or after somebody has edited it."""

    def find(self) -> None:
        """Ctrl+F: the search gets the focus."""

    def toggle(self) -> None:
        """The space bar, where no editor has the focus: starts or stops; nothing where that makes no sense."""

    def close_tab(self) -> None:
        """The window closes: no timer and no thread of the tab goes on."""
