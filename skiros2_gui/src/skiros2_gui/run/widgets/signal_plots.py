"""The live plots of signals, drawn with pyqtgraph."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyqtgraph as pg
from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QColor, QPalette
from python_qt_binding.QtWidgets import QWidget

from skiros2_gui.app.widgets.theme import is_dark, role_colour
from skiros2_gui.run.signals import Limit, PlottedSignal, SignalPlots
from skiros2_runs.core.values import MINIMUM

#: The colours of lines in the light and the dark theme: Okabe and Ito's, which colour-blind people tell apart.
_COLOURS = (
    ("#0072b2", "#56b4e9"),
    ("#d55e00", "#e69f00"),
    ("#009e73", "#2fd0a5"),
    ("#a3507f", "#cc79a7"),
    ("#6b6b00", "#f0e442"),
    ("#555555", "#bbbbbb"),
)

#: The margin at the right edge, as a share of the shown time.
_MARGIN = 0.02

#: The height of the label of a violation, as a share of the plot.
_LABEL_HEIGHT = 0.1


def line_colour(number: int, widget: QWidget) -> QColor:
    """Returns the colour of the signal with a number in the list."""
    return QColor(_COLOURS[number % len(_COLOURS)][is_dark(widget)])


class PlotArea(pg.GraphicsLayoutWidget):  # type: ignore[misc]
    """A plot for each unit, above each other, with one axis of time: seconds before now.

    :ivar owner: the widget that the colours are taken from, as pyqtgraph's widgets do not follow the palette.
    """

    def __init__(self, plots: SignalPlots, owner: QWidget) -> None:
        super().__init__()
        self.owner = owner
        self.setObjectName("signalPlots")
        self._plots = plots
        self._panels: dict[str, _Panel] = {}
        self.set_colours()

    def set_colours(self) -> None:
        """Follows the theme."""
        self.setBackground(self.owner.palette().color(QPalette.Base))
        self.clear()
        self._panels = {}

    def draw(self, numbers: dict[str, int]) -> None:
        """Draws the chosen signals.

        :param numbers: the number of each signal in the list, by id; it chooses the colour.
        """
        panels = self._plots.panels()
        if list(panels) != list(self._panels):
            self.clear()
            self._panels = {unit: _Panel(self, unit, row) for row, unit in enumerate(panels)}
            first, *others = [panel.plot for panel in self._panels.values()] or [None]
            for plot in others:
                plot.setXLink(first)
            for panel in list(self._panels.values())[:-1]:
                panel.plot.getAxis("bottom").setStyle(showValues=False)
            if self._panels:
                list(self._panels.values())[-1].plot.setLabel("bottom", "seconds before now")
        for unit, signals in panels.items():
            self._panels[unit].draw(self._plots, signals, numbers)

    def set_movable(self, is_movable: bool) -> None:
        """Sets whether the mouse moves and zooms the plots."""
        for panel in self._panels.values():
            panel.plot.setMouseEnabled(x=is_movable, y=is_movable)
            if not is_movable:
                panel.plot.enableAutoRange(axis="y")


class _Panel:
    """The plot of the signals with one unit."""

    def __init__(self, area: PlotArea, unit: str, row: int) -> None:
        self._area = area
        self._curves: dict[str, Any] = {}
        self._marks: list[Any] = []
        self.plot: Any = area.addPlot(row=row, col=0)
        self.plot.setMenuEnabled(False)
        self.plot.hideButtons()
        self.plot.setMouseEnabled(x=False, y=False)
        self.plot.showGrid(x=True, y=True, alpha=0.25)
        text = area.owner.palette().color(QPalette.Text)
        for side in ("left", "bottom"):
            axis = self.plot.getAxis(side)
            axis.enableAutoSIPrefix(False)
            axis.setPen(text)
            axis.setTextPen(text)
        self.plot.setLabel("left", unit or "no unit")
        self.plot.getAxis("left").setWidth(int(4.5 * area.fontMetrics().height()))
        self._span = 0.0

    def draw(self, plots: SignalPlots, signals: list[PlottedSignal], numbers: dict[str, int]) -> None:
        end = plots.end
        self._span = plots.span
        shown = [-plots.span, _MARGIN * plots.span]
        if not np.allclose(self.plot.viewRange()[0], shown):
            self.plot.setXRange(*shown, padding=0.0)
        for eid in self._curves.keys() - {signal.eid for signal in signals}:
            self.plot.removeItem(self._curves.pop(eid))
        for mark in self._marks:
            self.plot.removeItem(mark)
        self._marks = []
        for signal in signals:
            colour = line_colour(numbers.get(signal.eid, 0), self._area.owner)
            if signal.eid not in self._curves:
                # 1 pixel wide: wider lines take 5 times longer
                self._curves[signal.eid] = self.plot.plot(pen=pg.mkPen(colour), connect="finite")
            times, values = plots.line(signal)
            self._curves[signal.eid].setData(times - end, values)
            for limit in plots.limits(signal.eid):
                self._draw_limit(limit, signal, end, colour)

    def _draw_limit(self, limit: Limit, signal: PlottedSignal, end: float, colour: QColor) -> None:
        assert signal.signal is not None
        is_violated = bool(limit.bound.violated)
        shown = role_colour("failure", self._area.owner) if is_violated else colour
        begin = max(limit.begin - end, -self._span)
        ends = np.array([begin, min(limit.end - end, 0.0)])
        line = self.plot.plot(
            ends, np.full(2, limit.bound.value), pen=pg.mkPen(shown, width=2 if is_violated else 1, style=Qt.DashLine)
        )
        side = "≥" if limit.bound.side == MINIMUM else "≤"
        label = pg.TextItem(f"{side} {signal.signal.text(limit.bound.value)}  {limit.bound.condition}", color=shown)
        is_right = begin > -self._span / 2.0  # there is more space on the left
        label.setAnchor((float(is_right), 0.0 if limit.bound.side == MINIMUM else 1.0))
        label.setPos(ends[1] if is_right else begin, limit.bound.value)
        self.plot.addItem(label, ignoreBounds=True)
        self._marks += [line, label]
        if is_violated:
            mark = pg.InfiniteLine(limit.bound.violated - end, pen=pg.mkPen(shown, width=2), label="violated")
            mark.label.setColor(shown)
            mark.label.setPosition(_LABEL_HEIGHT)
            self.plot.addItem(mark, ignoreBounds=True)
            self._marks.append(mark)
