"""The bar with the next step of a system that cannot move a robot yet."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from python_qt_binding.QtGui import QFontDatabase, QGuiApplication
from python_qt_binding.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QSizePolicy, QWidget

from skiros2_gui.app.events import ConnectionChanged, ManagersChanged, WorldChanged
from skiros2_gui.app.next_step import ADD, LOAD, NextStep, next_step
from skiros2_gui.app.widgets.controls import push_button, text_label, timer
from skiros2_gui.app.widgets.theme import tint
from skiros2_gui.app.window import Window

#: The parts of a system come up one after the other; a step is shown if it is still the next one after this time (ms).
_DELAY = 1500


class NextStepBar(QFrame):
    """Hidden while a skill manager runs.

    :param calls: the functions of the actions.
    """

    def __init__(self, window: Window, calls: Mapping[str, Callable[[], None]], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("nextStep")
        self._window = window
        self._step: NextStep | None = None
        self.text = text_label("nextStepText")
        self.command = text_label("nextStepCommand")
        self.command.setFont(QFontDatabase.systemFont(QFontDatabase.FixedFont))
        for label in (self.text, self.command):
            label.setSizePolicy(QSizePolicy.Ignored, QSizePolicy.Preferred)
        self._copy = push_button("Copy", "nextStepCopy", self._copy_command, "Copies the command")
        self._buttons = {
            LOAD: push_button("Load a scene…", "nextStepLoad", calls[LOAD], "Replaces the scene with that of a file"),
            ADD: push_button("Add a robot…", "nextStepAdd", calls[ADD], "Adds a template with all its parts"),
        }
        buttons = QHBoxLayout()
        for button in (*self._buttons.values(), self._copy):
            buttons.addWidget(button)
        grid = QGridLayout(self)
        grid.setContentsMargins(9, 6, 6, 6)
        grid.setColumnStretch(0, 1)
        grid.addWidget(self.text, 0, 0)
        grid.addWidget(self.command, 1, 0)
        grid.addLayout(buttons, 0, 1, 2, 1)
        self.hide()
        self._timer = timer(self, _DELAY, self._show)
        for kind in (ConnectionChanged, ManagersChanged, WorldChanged):
            window.subscribe(kind, lambda _: self._check())
        self._check()

    def set_dark(self, dark: bool) -> None:
        """Switches between the dark and the light theme."""
        tint(self, background="notice", dark=dark)

    def close_timer(self) -> None:
        """Stops the timer."""
        self._timer.stop()

    def _check(self) -> None:
        """Hides a step that is done at once, and shows another one after the delay."""
        if self._window.system.managers:
            self._timer.stop()
            self._step = None
            self.hide()
        elif not self._timer.isActive():
            self._timer.start()

    def _show(self) -> None:
        step = next_step(self._window.system, self._window.tasks.cell)
        if step == self._step:
            return
        self._step = step
        self.setVisible(step is not None)
        if step is None:
            return
        self.text.setText(step.text)
        self.command.setText(step.command)
        for widget in (self.command, self._copy):
            widget.setVisible(bool(step.command))
        for action, button in self._buttons.items():
            button.setVisible(action in step.actions)

    def _copy_command(self) -> None:
        QGuiApplication.clipboard().setText(self.command.text())
