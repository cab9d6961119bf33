"""The driver of tests and screenshots: a termination signal ends it, wherever it hits."""

from __future__ import annotations

import signal

import pytest
from pytestqt.qtbot import QtBot
from python_qt_binding.QtCore import QAbstractTableModel, QModelIndex
from python_qt_binding.QtWidgets import QTableView

from skiros2_common.core.processes import Terminated, TerminationSignals
from support.window.driver import Driver


class Interrupted(QAbstractTableModel):
    """Is terminated once in a virtual method: Qt's bindings print an exception raised there and continue."""

    is_terminated = False

    def rowCount(self, parent: QModelIndex = QModelIndex()) -> int:  # noqa: B008
        return 1

    columnCount = rowCount

    def data(self, index: QModelIndex, role: int = 0) -> str | None:
        return "text" if role == 0 else None

    def headerData(self, section: int, orientation: int, role: int = 0) -> str | None:
        if not self.is_terminated:
            self.is_terminated = True
            signal.raise_signal(signal.SIGTERM)
        return "title" if role == 0 else None


def test_signal_within_a_virtual_method_ends_the_wait(qtbot: QtBot) -> None:
    table = QTableView()
    qtbot.addWidget(table)
    with pytest.raises(Terminated) as ended, TerminationSignals() as signals, signals.deferred():
        driver = Driver(table, 30.0, signals.raise_received)
        table.setModel(Interrupted())
        table.show()
        driver.wait_until(lambda: False, "an event that does not occur")
    assert ended.value.number == signal.SIGTERM
