"""The bar of stopped robots, above the tabs."""

from __future__ import annotations

from python_qt_binding.QtWidgets import QFrame, QHBoxLayout, QPushButton, QSizePolicy, QVBoxLayout, QWidget

from skiros2_gui.app.stops import StoppedRobot, Stops
from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip, push_button, text_label
from skiros2_gui.app.widgets.theme import tint
from skiros2_gui.app.window import Window

#: The tooltip of the button.
_TIP = "Starts the skill RecoverFromStop, which calls the robot's driver and waits for the end of the stop"


class StopBar(QFrame):
    """A row for each robot with an active stop; hidden without one."""

    def __init__(self, window: Window, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("stop_bar")
        self._rows: dict[str, _Row] = {}
        self._column = QVBoxLayout(self)
        self._column.setContentsMargins(9, 5, 5, 5)
        self._dark = False
        self._stops = Stops(window, self.show_stops)
        self.show_stops()

    def set_dark(self, dark: bool) -> None:
        """Switches between the dark and the light theme."""
        self._dark = dark
        tint(self, background="error", dark=dark)
        for row in self._rows.values():
            tint(row.sign, text="failure", dark=dark)

    def show_stops(self) -> None:
        """Updates the rows."""
        robots = {robot.manager: robot for robot in self._stops.robots}
        for name in self._rows.keys() - robots.keys():
            self._rows.pop(name).deleteLater()
        for name, robot in robots.items():
            if name not in self._rows:
                self._rows[name] = row = _Row(self._stops, name)
                self._column.addWidget(row)
                tint(row.sign, text="failure", dark=self._dark)
            self._rows[name].show_stop(robot)
        self.setVisible(bool(robots))


class _Row(QWidget):
    def __init__(self, stops: Stops, name: str) -> None:
        super().__init__()
        self.sign = PlainLabel("■")
        self._text = text_label(f"stop_{name.lstrip('/')}")
        self._text.setSizePolicy(QSizePolicy.Ignored, QSizePolicy.Preferred)
        self._button: QPushButton = push_button("Recover", f"recover_{name.lstrip('/')}", lambda: stops.recover(name))
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.sign)
        row.addWidget(self._text, 1)
        row.addWidget(self._button)

    def show_stop(self, robot: StoppedRobot) -> None:
        failure = f"\nThe recovery failed: {robot.failure}" if robot.failure else ""
        self._text.setText(f"{robot.manager}: {robot.kind}. {robot.text}{failure}")
        self._button.setEnabled(not robot.obstacle)
        self._button.setToolTip(plain_tip(robot.obstacle or _TIP))
