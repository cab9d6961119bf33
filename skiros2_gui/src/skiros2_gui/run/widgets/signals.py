"""The tab "Signals" beside the tree: live plots, and the list of signals to choose from."""

from __future__ import annotations

from typing import Any

from python_qt_binding.QtCore import QEvent, Qt
from python_qt_binding.QtGui import QPalette
from python_qt_binding.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QHBoxLayout,
    QHeaderView,
    QSplitter,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.app.widgets.controls import plain_tip, push_button, text_label, timer
from skiros2_gui.app.widgets.theme import role_colour
from skiros2_gui.app.window import Window
from skiros2_gui.run.presenter import RunPresenter
from skiros2_gui.run.signals import SPANS, PlottedSignal, SignalPlots

#: The periods of drawing, and of reading signals and limits (ms).
_DRAW_PERIOD, _READ_PERIOD = 50, 400

_NO_SIGNALS = (
    "The scene has no signals. Elements of class skiros:Signal that are parts of a robot (skiros:hasA) are plotted."
)
_NO_LIBRARY = "The plots need pyqtgraph, which cannot be imported here: {}"


class SignalPanel(QWidget):
    """Draws, and is subscribed to topics, only while it is visible."""

    def __init__(self, window: Window, run: RunPresenter) -> None:
        super().__init__()
        self.plots = SignalPlots(window, run)
        self._area: Any = None  # made when first shown: importing pyqtgraph takes 0.15 s
        self._problem = ""
        self._shown: list[str] = []
        self._note = text_label("signalNote")
        self._list = QTreeWidget()
        self._list.setObjectName("signalList")
        self._list.setAccessibleName("signals")
        self._list.setHeaderHidden(True)
        self._list.setColumnCount(2)
        self._list.setRootIsDecorated(False)
        self._list.setSelectionMode(QAbstractItemView.NoSelection)
        self._list.header().setSectionResizeMode(0, QHeaderView.ResizeToContents)
        self._list.itemChanged.connect(self._on_item)
        self._span = QComboBox()
        self._span.setObjectName("signalSpan")
        self._span.setToolTip("The time span of the plots")
        for span in SPANS:
            self._span.addItem(f"{span:g} s", span)
        self._span.setCurrentIndex(SPANS.index(self.plots.span))
        self._span.currentIndexChanged.connect(lambda _: self.set_span(self._span.currentData()))
        self._pause = push_button(
            "Pause", "signalPause", self._on_pause, "Stops the plots; the mouse then moves them, the wheel zooms"
        )
        self._pause.setCheckable(True)
        row = QHBoxLayout()
        row.addWidget(self._pause)
        row.addWidget(self._span)
        row.addStretch(1)
        top = QWidget()
        self._column = QVBoxLayout(top)
        self._column.setContentsMargins(0, 0, 0, 0)
        self._column.addLayout(row)
        self._column.addWidget(self._note)
        self._column.addStretch(1)
        splitter = QSplitter(Qt.Vertical)
        splitter.addWidget(top)
        splitter.addWidget(self._list)
        splitter.setStretchFactor(0, 4)
        splitter.setStretchFactor(1, 1)
        splitter.setSizes([450, 120])
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.addWidget(splitter)
        self._draw_timer = timer(self, _DRAW_PERIOD, self._draw, repeats=True)
        self._read_timer = timer(self, _READ_PERIOD, self._read, repeats=True)

    def set_span(self, span: float) -> None:
        """Sets the time span of the plots (s), one of `SPANS`."""
        if span in SPANS:
            self.plots.span = span
            self._span.setCurrentIndex(SPANS.index(span))
            self._draw_paused()

    def shut_down(self) -> None:
        """Ends the panel: the window closes. Plots that Python frees later crash Qt at the next change of the theme."""
        self.close_timers()
        if self._area is not None:
            self._area.close()
            self._area = None

    def close_timers(self) -> None:
        """Stops drawing and unsubscribes."""
        self._draw_timer.stop()
        self._read_timer.stop()
        self.plots.hide()

    def showEvent(self, event: Any) -> None:
        super().showEvent(event)
        if self._area is None and not self._problem:
            self._make_area()
        self.plots.show()
        self._read()
        self._draw_paused()
        self._read_timer.start()
        self._draw_timer.start()

    def hideEvent(self, event: Any) -> None:
        super().hideEvent(event)
        self.close_timers()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.PaletteChange and self._area is not None:
            self._area.set_colours()
            self._shown = []
            self._read()
            self._draw_paused()

    # -- drawing -----------------------------------------------------------------------------------------------------

    def _make_area(self) -> None:
        try:
            from skiros2_gui.run.widgets.signal_plots import PlotArea
        except ImportError as error:
            self._problem = _NO_LIBRARY.format(error)
            return
        self._area = PlotArea(self.plots, self)
        self._column.takeAt(self._column.count() - 1)
        self._column.addWidget(self._area, 1)

    def _draw(self) -> None:
        if self._area is not None and not self.plots.is_paused:
            self._area.draw(self._numbers())

    def _draw_paused(self) -> None:
        if self._area is not None and self.isVisible():
            self._area.draw(self._numbers())

    def _numbers(self) -> dict[str, int]:
        return {eid: number for number, eid in enumerate(self._shown)}

    def _read(self) -> None:
        """Reads the signals and limits, and shows the list."""
        self.plots.refresh()
        signals = self.plots.signals
        self._note.setText(self._problem or self.plots.problem or ("" if signals else _NO_SIGNALS))
        self._note.setVisible(bool(self._note.text()))
        self._list.setVisible(bool(signals))
        self._list.blockSignals(True)
        if [signal.eid for signal in signals] != self._shown:
            self._shown = [signal.eid for signal in signals]
            self._list.clear()
            self._list.addTopLevelItems([QTreeWidgetItem() for _ in signals])
        for number, signal in enumerate(signals):
            self._show_row(self._list.topLevelItem(number), number, signal)
        self._list.blockSignals(False)

    def _show_row(self, item: QTreeWidgetItem, number: int, signal: PlottedSignal) -> None:
        is_usable = signal.signal is not None
        is_chosen = is_usable and self.plots.is_chosen(signal.eid)
        item.setFlags(Qt.ItemIsEnabled | (Qt.ItemIsUserCheckable if is_usable else Qt.NoItemFlags))
        item.setCheckState(0, Qt.Checked if is_chosen else Qt.Unchecked)
        item.setText(0, signal.label)
        item.setText(1, self.plots.status(signal) if is_chosen or not is_usable else "")
        topic = f"{signal.signal.topic} {signal.signal.path}" if signal.signal is not None else signal.problem
        item.setToolTip(0, plain_tip(f"{signal.eid}\n{topic}\n{signal.robot}".rstrip()))
        item.setToolTip(1, plain_tip(item.text(1)))
        colour = self.palette().color(QPalette.Text)
        if is_chosen and self._area is not None:
            from skiros2_gui.run.widgets.signal_plots import line_colour

            colour = line_colour(number, self)
        item.setForeground(0, colour)
        item.setForeground(1, colour if is_usable else role_colour("failure", self))

    # -- what the user does ------------------------------------------------------------------------------------------

    def _on_item(self, item: QTreeWidgetItem, column: int) -> None:
        if column == 0:
            eid = self._shown[self._list.indexOfTopLevelItem(item)]
            self.plots.choose(eid, item.checkState(0) == Qt.Checked)
            self._read()
            self._draw_paused()

    def _on_pause(self) -> None:
        self.plots.pause(self._pause.isChecked())
        if self._area is not None:
            self._area.set_movable(self._pause.isChecked())
            self._draw_paused()
