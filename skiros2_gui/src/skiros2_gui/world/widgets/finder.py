"""The search above the tree of the scene."""

from __future__ import annotations

from python_qt_binding.QtCore import QTimer
from python_qt_binding.QtWidgets import QHBoxLayout, QLabel, QLineEdit, QWidget

from skiros2_gui.world.presenter import WorldPresenter
from skiros2_gui.world.widgets.scene_model import SceneModel

#: The delay after a key (ms).
_DELAY = 150


class ElementFinder(QWidget):
    """Searches while the user types, and goes through the results."""

    def __init__(self, presenter: WorldPresenter, model: SceneModel, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self._model = model
        self._found: list[str] = []
        self.line = QLineEdit()
        self.line.setObjectName("worldSearch")
        self.line.setPlaceholderText("Find an element (Ctrl+F)")
        self.line.setToolTip("Words in ids, labels and values; Enter, F3: next result, Shift+F3: previous")
        self.line.setClearButtonEnabled(True)
        self.line.returnPressed.connect(lambda: self.go_to_next())
        self.message = QLabel()
        self._timer = QTimer(self)
        self._timer.setInterval(_DELAY)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self.search)
        self.line.textChanged.connect(lambda _: self._timer.start())
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.line, 1)
        row.addWidget(self.message)
        self.setFocusProxy(self.line)

    def close_finder(self) -> None:
        """Stops the timer."""
        self._timer.stop()

    def search(self) -> None:
        """Updates the results."""
        self._timer.stop()
        self._found = self._presenter.find(self.line.text())
        self._model.show_found(self._found)
        self._show_count()

    def go_to_next(self, step: int = 1) -> None:
        """Selects the next result.

        :param step: -1 for the previous one.
        """
        if self._timer.isActive():
            self.search()
        if not self._found:
            return
        selected = self._presenter.selected
        if selected in self._found:
            at = (self._found.index(selected) + step) % len(self._found)
        else:
            at = 0 if step > 0 else -1
        self._presenter.select(self._found[at])
        self._show_count()

    def _show_count(self) -> None:
        count, selected = len(self._found), self._presenter.selected
        if not self.line.text().strip():
            self.message.setText("")
        elif not count:
            self.message.setText("none")
        else:
            text = f"{self._found.index(selected) + 1} of {count}" if selected in self._found else f"{count} found"
            self.message.setText(text)
