"""The slider over the ticks of a task."""

from __future__ import annotations

from python_qt_binding.QtCore import QEvent, Qt
from python_qt_binding.QtWidgets import QHBoxLayout, QLabel, QSlider, QToolButton, QWidget

from skiros2_gui.app.widgets.media_icons import BACK, STEP, media_icon
from skiros2_gui.run.node_text import clock_text, duration_text
from skiros2_gui.run.presenter import RunPresenter


class HistoryBar(QWidget):
    """A slider, buttons for single steps, and a button for live."""

    def __init__(self, presenter: RunPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self._slider = QSlider(Qt.Horizontal)
        self._slider.setObjectName("historySlider")
        self._slider.setAccessibleName("tick of the task")
        self._slider.setToolTip("the ticks of the task; the arrow keys go one back or on")
        self._slider.setPageStep(25)
        self._slider.valueChanged.connect(self._go)
        self._back = _button("one tick back", "historyBack")
        self._on = _button("one tick on", "historyOn")
        self._back.clicked.connect(lambda: presenter.step(-1))
        self._on.clicked.connect(lambda: presenter.step(1))
        self._live = QToolButton()
        self._live.setObjectName("historyLive")
        self._live.setText("Live")
        self._live.setToolTip("show the task live")
        self._live.clicked.connect(lambda: presenter.go_to(None))
        self._label = QLabel()
        self._label.setObjectName("historyLabel")
        self._label.setTextInteractionFlags(Qt.TextSelectableByMouse)
        row = QHBoxLayout(self)
        row.setContentsMargins(6, 2, 6, 2)
        for widget in (self._back, self._slider, self._on, self._live, self._label):
            row.addWidget(widget, 1 if widget is self._slider else 0)
        self._draw_icons()
        self.show_history()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.PaletteChange:
            self._draw_icons()

    def _draw_icons(self) -> None:
        self._back.setIcon(media_icon(BACK, self))
        self._on.setIcon(media_icon(STEP, self))

    def show_history(self) -> None:
        """Shows the index of the tick and the number of ticks."""
        presenter, run = self._presenter, self._presenter.run
        count = len(run) if run is not None else 0
        tick = count - 1 if presenter.tick is None else presenter.tick
        self.setEnabled(count > 0)
        self._slider.blockSignals(True)
        self._slider.setRange(0, max(0, count - 1))
        self._slider.setValue(max(0, tick))
        self._slider.blockSignals(False)
        self._back.setEnabled(tick > 0)
        self._on.setEnabled(presenter.tick is not None and tick < count - 1)
        self._live.setEnabled(presenter.tick is not None and presenter.bag is None)
        if run is None:
            self._label.setText("")
            return
        moment = run.times[tick] if presenter.tick is not None else run.latest.time
        live = "live: " if presenter.is_live else ""
        text = f"{live}tick {run.dropped + tick + 1} of {run.dropped + count}, {clock_text(moment)}, "
        self._label.setText(text + duration_text(max(0.0, moment - run.start)))
        self._label.setToolTip(
            f"{run.dropped} older ticks were discarded to limit memory" if run.dropped else "since the task began"
        )

    def _go(self, tick: int) -> None:
        is_last = self._presenter.run is not None and tick >= len(self._presenter.run) - 1
        self._presenter.go_to(None if is_last and self._presenter.bag is None else tick)


def _button(tip: str, name: str) -> QToolButton:
    button = QToolButton()
    button.setObjectName(name)
    button.setToolTip(tip)
    button.setAccessibleName(tip)
    button.setAutoRaise(True)
    button.setAutoRepeat(True)
    return button
