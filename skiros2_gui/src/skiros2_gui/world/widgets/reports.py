"""The validation report, and the history of the selected element."""

from __future__ import annotations

from typing import Any

from python_qt_binding.QtWidgets import QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from skiros2_common.core.names import local_name
from skiros2_gui.app.widgets.tables import Row, RowsModel, RowsView
from skiros2_gui.world.presenter import WorldPresenter
from skiros2_gui.world.queries import WorldQueries
from skiros2_world_model.core.formatting import format_time
from skiros2_world_model.core.history_entry import changed_lines
from skiros2_world_model.core.report import VIOLATION, WARNING

_COLOURS = {VIOLATION: "failure", WARNING: "paused"}


class ReportPanel(QWidget):
    """Violations of ontologies and shapes; a click selects the element."""

    def __init__(self, presenter: WorldPresenter, queries: WorldQueries, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self._queries = queries
        self.message = QLabel("Not validated yet.")
        self.message.setObjectName("validationSaid")
        self.message.setWordWrap(True)
        self.again = QPushButton("Validate")
        self.again.setObjectName("validateButton")
        self.again.setToolTip("Validates the scene against ontologies and shapes")
        self.again.clicked.connect(lambda: queries.validate())
        self.table = RowsView(RowsModel(("Severity", "Element", "Property", "Message")))
        self.table.setObjectName("validationTable")
        self.table.selectionModel().selectionChanged.connect(lambda *_: self._go_to())
        _lay_out(self, self.message, self.again, self.table)
        queries.on_report = self._show

    def _show(self) -> None:
        report = self._queries.report
        if report is None:
            return
        self.message.setText(f"{format_time(report.stamp)}: {report.summary}")
        self.table.rows.show_rows(
            [
                Row(
                    (f.severity, local_name(f.element), local_name(f.property), f.text),
                    str(f),
                    f,
                    _COLOURS.get(f.severity, ""),
                )
                for f in report.findings
            ]
        )
        self.table.resizeColumnsToContents()
        self.table.horizontalHeader().setStretchLastSection(True)

    def _go_to(self) -> None:
        hierarchy = self._presenter.hierarchy
        for finding in self.table.chosen():
            if hierarchy is not None and finding.element in hierarchy.scene:
                self._presenter.select(finding.element)


class HistoryPanel(QWidget):
    """The changes of the selected element with time and author. Read while visible."""

    def __init__(self, presenter: WorldPresenter, queries: WorldQueries, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self._queries = queries
        self.message = QLabel()
        self.message.setObjectName("historySaid")
        self.message.setWordWrap(True)
        self.again = QPushButton("Refresh")
        self.again.setToolTip("Reads the history again")
        self.again.clicked.connect(lambda: self.show_element(is_changed=True))
        self.table = RowsView(RowsModel(("Time", "Author", "Changes")))
        self.table.setObjectName("historyTable")
        _lay_out(self, self.message, self.again, self.table)
        queries.on_history = self._show

    def showEvent(self, event: Any) -> None:
        super().showEvent(event)
        self.show_element(is_changed=True)

    def show_element(self, is_changed: bool = False) -> None:
        """Shows the history of the selected element.

        :param is_changed: reads it again if it is shown already.
        """
        if self.isVisible() and (is_changed or self._queries.history.eid != self._presenter.selected):
            self._queries.fetch_history(self._presenter.selected)

    def _show(self) -> None:
        past = self._queries.history
        name = local_name(past.eid)
        if not past.eid:
            self.message.setText("No element is selected.")
        elif past.entries is None:
            self.message.setText(f"{name}: reading…")
            return
        elif past.text:
            self.message.setText(past.text[:1].upper() + past.text[1:])
        else:
            self.message.setText(f"{name}: {len(past.entries)} changes, the newest first")
        rows = []
        for entry in past.entries or ():
            lines = [*([] if entry.action == "change" else [entry.action]), *changed_lines(entry)]
            own = [line.replace(f"~ {past.eid} ", "~ ") for line in lines]
            author = "this window" if entry.author == self._presenter.author() else entry.author.strip("/")
            tip = "\n".join([f"{format_time(entry.stamp)}, {entry.author}", *own])
            rows.append(Row((format_time(entry.stamp), author, "   ".join(own)), tip, entry.number))
        self.table.rows.show_rows(rows)
        self.table.resizeColumnsToContents()
        most = self.table.fontMetrics().averageCharWidth() * 24
        self.table.setColumnWidth(1, min(self.table.columnWidth(1), most))
        self.table.horizontalHeader().setStretchLastSection(True)


def _lay_out(panel: QWidget, message: QLabel, button: QPushButton, table: RowsView) -> None:
    row = QHBoxLayout()
    row.addWidget(message, 1)
    row.addWidget(button)
    column = QVBoxLayout(panel)
    column.addLayout(row)
    column.addWidget(table, 1)
