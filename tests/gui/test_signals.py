"""The tab "Signals" beside the tree."""

from __future__ import annotations

from collections.abc import Iterator

import pyqtgraph as pg
import pytest
from pytestqt.qtbot import QtBot
from python_qt_binding.QtCore import Qt, QTimer
from python_qt_binding.QtGui import QPalette
from python_qt_binding.QtWidgets import QTreeWidget

from skiros2_gui.app.widgets.theme import palette_of
from skiros2_gui.app.window import Window
from skiros2_gui.run.widgets.tab import RunTab
from support.window.driver import Driver
from support.window.press_cell import TOPIC, PressCell


@pytest.fixture
def cell(window: Window) -> PressCell:
    return PressCell(window)


@pytest.fixture
def tab(window: Window, cell: PressCell, qtbot: QtBot) -> Iterator[RunTab]:
    made = RunTab(window)
    qtbot.addWidget(made, before_close_func=RunTab.close_tab)
    made.resize(1300, 700)
    made.show()
    news = QTimer()
    news.timeout.connect(window.process_events)
    news.start(10)
    yield made
    news.stop()


@pytest.fixture
def driver(tab: RunTab) -> Driver:
    made = Driver(tab)
    made.open_tab("Signals")
    return made


def drawn(driver: Driver) -> list[float]:
    """The values of all lines, those of limits included."""
    curves = [c for c in driver.widget("signalPlots").scene().items() if isinstance(c, pg.PlotDataItem)]
    return [float(value) for curve in curves if curve.yData is not None for value in curve.yData]


def labels(driver: Driver) -> list[str]:
    items = driver.widget("signalPlots").scene().items()
    return [item.toPlainText() for item in items if isinstance(item, pg.TextItem)]


def uncheck(driver: Driver, text: str) -> None:
    rows: QTreeWidget = driver.widget("signalList")
    (item,) = rows.findItems(text, Qt.MatchExactly)
    item.setCheckState(0, Qt.Unchecked)


def test_values_are_listed_with_their_units_and_drawn(cell: PressCell, driver: Driver) -> None:
    for force in (1.0, 2.0, 12.5):
        cell.publish(force, 0.5)
    driver.wait_for_row("signalList", "wrist force", "12.5 N")
    driver.wait_for_row("signalList", "wrist torque", "0.5 Nm")
    driver.wait_until(lambda: {12.5, 0.5} <= set(drawn(driver)), "the values in the plots")


def test_violated_limit_is_drawn_and_marked(cell: PressCell, driver: Driver) -> None:
    cell.publish(1.0)
    cell.press()
    driver.wait_until(lambda: "≤ 30 N  ForceBelowLimit" in labels(driver), "the limit")
    assert "violated" not in labels(driver)
    cell.publish(41.0)
    driver.wait_until(lambda: "violated" in labels(driver), "the mark of the violation")
    assert {30.0, 41.0} <= set(drawn(driver))


def test_deselected_signal_is_removed_from_the_plots(cell: PressCell, driver: Driver) -> None:
    cell.publish(12.5, 0.5)
    driver.wait_until(lambda: 12.5 in drawn(driver), "the value in the plot")
    uncheck(driver, "wrist force")
    driver.wait_until(lambda: 12.5 not in drawn(driver), "an empty plot")
    assert 0.5 in drawn(driver)


def test_paused_plots_do_not_move(cell: PressCell, driver: Driver) -> None:
    cell.publish(12.5)
    driver.wait_until(lambda: 12.5 in drawn(driver), "the value in the plot")
    driver.click("signalPause")
    cell.publish(99.0)
    driver.wait_for_row("signalList", "wrist force", "99 N")
    assert 99.0 not in drawn(driver)
    driver.click("signalPause")
    driver.wait_until(lambda: 99.0 in drawn(driver), "the new value")


def test_hidden_plots_draw_nothing_and_unsubscribe(cell: PressCell, tab: RunTab, driver: Driver) -> None:
    assert cell.system.signals.topics() == [TOPIC]
    driver.open_tab("Messages")
    assert cell.system.signals.topics() == []
    assert not tab._signals._draw_timer.isActive() and not tab._signals._read_timer.isActive()
    driver.open_tab("Signals")
    tab.hide()
    assert cell.system.signals.topics() == []


def test_plots_follow_the_theme(cell: PressCell, tab: RunTab, driver: Driver) -> None:
    cell.publish(12.5)
    for dark in (True, False):
        tab.setPalette(palette_of(dark))
        driver.wait_until(lambda: 12.5 in drawn(driver), "the value in the plot")
        area = driver.widget("signalPlots")
        assert area.backgroundBrush().color() == tab.palette().color(QPalette.Base)


def test_scene_without_signals_shows_a_hint(cell: PressCell, driver: Driver) -> None:
    for signal in (cell.force, cell.torque):
        cell.wm.remove_element(signal)
    driver.wait_until(lambda: "skiros:Signal" in driver.widget("signalNote").text(), "the hint")


def test_span_is_stored(tab: RunTab, driver: Driver) -> None:
    driver.choose("signalSpan", "10 s")
    assert tab.settings()["signal_span"] == 10.0
    tab.restore({"signal_span": 30.0})
    assert driver.widget("signalSpan").currentText() == "30 s"
    tab.restore({"signal_span": 7.0})
    assert driver.widget("signalSpan").currentText() == "30 s"
