"""The tab "World model"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from python_qt_binding.QtWidgets import QWidget

from skiros2_gui.core.system import WORLD_MODEL
from skiros2_gui.core.window import Window


class WorldTab(QWidget):
    """The tab; see `qt.tab.Tab`."""

    title = "World model"
    needs = (WORLD_MODEL,)

    def __init__(self, window: Window, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._window = window

    def settings(self) -> dict[str, Any]:
        return {}

    def restore(self, settings: Mapping[str, Any]) -> None: ...

    def find(self) -> None: ...

    def toggle(self) -> None: ...

    def close_tab(self) -> None: ...
