"""Operates a window by mouse and keys, for tests and screenshots."""

from __future__ import annotations

import faulthandler
import re
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from python_qt_binding.QtCore import QEventLoop, QModelIndex, QPoint, Qt
from python_qt_binding.QtTest import QTest
from python_qt_binding.QtWidgets import (
    QAbstractItemView,
    QApplication,
    QComboBox,
    QListView,
    QTabWidget,
    QTreeView,
    QWidget,
)

from skiros2_common.core.errors import TimedOut

T = TypeVar("T")

#: The default timeout (s).
TIMEOUT = 90.0


class Driver:
    """Used in the Qt thread. Widgets are found by their object names.

    :param window: the window; it has to be shown.
    :param timeout: of waiting (s).
    :param check: called regularly while events are processed; raises to end the wait. Not called from Qt, which would
        print its exceptions and continue.
    """

    def __init__(self, window: QWidget, timeout: float = TIMEOUT, check: Callable[[], None] = lambda: None) -> None:
        self.window = window
        self.timeout = timeout
        self._check = check

    def widget(self, name: str) -> Any:
        """Returns the visible widget of that name, or else the first one.

        :raises LookupError: there is none; the message lists the visible widgets.
        """
        found = self.window.findChildren(QWidget, name)
        if not found:
            there = {child.objectName() for child in self.window.findChildren(QWidget) if child.isVisible()}
            raise LookupError(f"no widget {name!r} in the window; visible are {sorted(there - {''})}")
        return next((child for child in found if child.isVisible()), found[0])

    def open_tab(self, title: str) -> None:
        """Selects the first tab whose title starts with `title`.

        :raises LookupError: there is none.
        """
        for tabs in self.window.findChildren(QTabWidget):
            for number in range(tabs.count()):
                if tabs.tabText(number).replace("&", "").startswith(title):
                    tabs.setCurrentIndex(number)
                    return
        raise LookupError(f"no tab {title!r}")

    def click(self, name: str) -> None:
        """Clicks a widget once it is enabled and visible.

        :raises TimedOut: it stays disabled or hidden.
        """
        self.wait_until(lambda: self.widget(name).isEnabled() and self.widget(name).isVisible(), f"{name} to click")
        QTest.mouseClick(self.widget(name), Qt.LeftButton)

    def write(self, name: str, text: str, key: int | None = None) -> None:
        """Replaces the text of an editor by typing, then presses `key`, if given."""
        editor = self.widget(name)
        editor.setFocus()
        QTest.keyClick(editor, Qt.Key_A, Qt.ControlModifier)
        QTest.keyClick(editor, Qt.Key_Delete)
        QTest.keyClicks(editor, text)
        if key is not None:
            QTest.keyClick(editor, key)

    def choose(self, name: str, text: str) -> None:
        """Selects the entry of a tree, list, table or combo box whose text starts with `text`, symbols such as ▶ not
        counted.

        :raises TimedOut: there is none.
        """
        widget = self.widget(name)
        if isinstance(widget, QComboBox):
            number = self.wait_until(lambda: _number_of(widget, text) + 1, f"{text!r} in {name}") - 1
            widget.setCurrentIndex(number)
            widget.activated.emit(number)
            return
        view: QAbstractItemView = widget
        entries = self.wait_until(lambda: [e for e in _entries(view) if _begins(e.data(), text)], f"{text!r} in {name}")
        self.click_entry(view, entries[0])

    def click_entry(self, view: QAbstractItemView, entry: QModelIndex) -> None:
        """Clicks an entry of a tree, list or table; expands its ancestors."""
        above = entry.parent()
        while isinstance(view, QTreeView) and above.isValid():
            view.expand(above)
            above = above.parent()
        view.scrollTo(entry)
        QTest.mouseClick(view.viewport(), Qt.LeftButton, Qt.NoModifier, view.visualRect(entry).center() + QPoint(1, 0))

    def rows(self, name: str) -> list[str]:
        """Returns the rows of a tree, list or table; columns are joined with two spaces."""
        view = self.widget(name)
        columns = 1 if isinstance(view, QListView) else view.model().columnCount()
        return ["  ".join(_texts(entry, columns)) for entry in _entries(view)]

    def wait_for_row(self, name: str, *texts: str) -> None:
        """Waits until a row of a tree, list or table contains all of the texts.

        :raises TimedOut: there is none; the message has the rows.
        """
        try:
            self.wait_until(lambda: any(all(text in row for text in texts) for row in self.rows(name)), "")
        except TimedOut:
            shown = "\n".join(self.rows(name))
            raise TimedOut(f"the window: no row of {name} has {texts}:\n{shown}") from None

    def process_for(self, seconds: float) -> None:
        """Processes events for that time (s)."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._process()

    def wait_until(self, condition: Callable[[], T], what: str, timeout: float | None = None) -> T:
        """Processes events until the condition is true; returns its value.

        :param timeout: s; None: that of the driver.
        :raises TimedOut: it is not true within the timeout; the stacks of all threads are dumped to stderr.
        """
        timeout = self.timeout if timeout is None else timeout
        end = time.monotonic() + timeout
        while not (value := condition()):
            if time.monotonic() > end:
                faulthandler.dump_traceback()
                raise TimedOut(f"the window: {what}: not within {timeout:g} s")
            self._process()
        return value

    def _process(self) -> None:
        """Processes pending events."""
        self._check()
        QApplication.processEvents(QEventLoop.AllEvents, 20)
        time.sleep(0.005)


def _entries(view: QAbstractItemView, above: QModelIndex | None = None) -> Iterator[QModelIndex]:
    model = view.model()
    parent = QModelIndex() if above is None else above
    for row in range(model.rowCount(parent)):
        entry = model.index(row, 0, parent)
        yield entry
        yield from _entries(view, entry)


def _number_of(box: QComboBox, text: str) -> int:
    return next((number for number in range(box.count()) if _begins(box.itemText(number), text)), -1)


def _texts(entry: QModelIndex, columns: int) -> list[str]:
    return [str(entry.sibling(entry.row(), column).data() or "") for column in range(columns)]


def _begins(shown: Any, text: str) -> bool:
    return re.sub(r"^\W+", "", str(shown or "")).startswith(text)
