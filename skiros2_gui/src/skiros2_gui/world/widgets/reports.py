"""SPARQL queries, the validation report, and the history of the selected element."""

from __future__ import annotations

from typing import Any

from python_qt_binding.QtCore import QModelIndex, Qt
from python_qt_binding.QtGui import QColor, QKeySequence, QTextCursor, QTextFormat
from python_qt_binding.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLabel,
    QPlainTextEdit,
    QPushButton,
    QShortcut,
    QSplitter,
    QTextEdit,
    QVBoxLayout,
    QWidget,
)

from skiros2_common.core.names import local_name
from skiros2_gui.app.widgets import theme
from skiros2_gui.app.widgets.controls import PlainLabel, push_button
from skiros2_gui.app.widgets.tables import Row, RowsModel, RowsView, fixed_font
from skiros2_gui.world.presenter import WorldPresenter
from skiros2_gui.world.queries import CONTEXTS, WorldQueries
from skiros2_world_model.core.formatting import format_time, format_value
from skiros2_world_model.core.history import changed_lines
from skiros2_world_model.core.report import VIOLATION, WARNING

_CONTEXT_TEXTS = ("the scene and the ontologies", "the scene", "the ontologies")
_EXAMPLES = (
    ("All elements of a class", "SELECT ?element ?label WHERE {\n  ?element a skiros:Location .\n"
     "  OPTIONAL { ?element rdfs:label ?label }\n}"),
    ("What contains what", "SELECT ?container ?thing WHERE {\n  ?container skiros:contain ?thing\n}"),
    ("Where things are (m)", "SELECT ?element ?x ?y ?z WHERE {\n  ?element skiros:PositionX ?x ; skiros:PositionY ?y ;"
     " skiros:PositionZ ?z\n}"),
    ("How many of each class", "SELECT ?class (COUNT(?element) AS ?number) WHERE {\n  ?element a ?class\n}"
     " GROUP BY ?class ORDER BY DESC(?number)"),
)  # fmt: skip


class QueryPanel(QWidget):
    """Executes queries with Ctrl+Enter. A double click on an element in the result selects it."""

    def __init__(self, presenter: WorldPresenter, queries: WorldQueries, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self._queries = queries
        self.box = QPlainTextEdit()
        self.box.setObjectName("sparqlBox")
        self.box.setFont(fixed_font())
        self.box.setTabChangesFocus(True)
        self.box.setPlaceholderText("SELECT ?element WHERE { ?element a skiros:Location }")
        self.box.setPlainText(_EXAMPLES[0][1])
        self.examples = QComboBox()
        self.examples.setToolTip("Examples and earlier queries")
        self.examples.activated.connect(self._take_example)
        self.context = QComboBox()
        self.context.addItems(_CONTEXT_TEXTS)
        self.context.setToolTip("The context of the query")
        self.run = push_button("Run", "sparqlRun", lambda: self.ask(), "Executes the query (Ctrl+Enter)")
        for key in (Qt.Key_Return, Qt.Key_Enter):
            QShortcut(QKeySequence(Qt.CTRL + key), self, self.ask, context=Qt.WidgetWithChildrenShortcut)
        self.table = RowsView(RowsModel(()))
        self.table.setObjectName("sparqlResult")
        self.table.doubleClicked.connect(self._go_to)
        self.message = PlainLabel()
        self.message.setObjectName("sparqlSaid")
        self.message.setWordWrap(True)
        self.message.setTextInteractionFlags(Qt.TextSelectableByMouse)
        row = QHBoxLayout()
        row.addWidget(self.examples, 1)
        row.addWidget(PlainLabel("of"))
        row.addWidget(self.context)
        row.addWidget(self.run)
        top = QWidget()
        above = QVBoxLayout(top)
        above.setContentsMargins(0, 0, 0, 0)
        above.addWidget(self.box, 1)
        above.addLayout(row)
        above.addWidget(self.message)
        splitter = QSplitter(Qt.Vertical)
        splitter.addWidget(top)
        splitter.addWidget(self.table)
        splitter.setStretchFactor(1, 2)
        column = QVBoxLayout(self)
        column.addWidget(splitter)
        queries.on_answer = self._show
        self._fill_examples()

    def ask(self) -> None:
        """Executes the query."""
        text = self.box.toPlainText()
        if text.strip():
            self.message.setText("Executing…")
            self._queries.ask(text, CONTEXTS[self.context.currentIndex()])

    def _show(self) -> None:
        answer, diagnostic = self._queries.answer, self._queries.diagnostic
        rows = () if answer is None else answer.rows
        self.table.rows.show_rows(
            [Row(tuple("" if v is None else format_value(v) for v in row), "", row) for row in rows],
            answer.names if answer is not None else (),
        )
        self.table.resizeColumnsToContents()
        self._highlight_line(diagnostic.line if diagnostic is not None else 0)
        if diagnostic is not None:
            self.message.setText(f"⚠ {diagnostic.text}")
        else:
            self.message.setText("1 row" if len(rows) == 1 else f"{len(rows)} rows" if rows else "No rows")
        self._fill_examples()

    def _highlight_line(self, line: int) -> None:
        highlights = []
        block = self.box.document().findBlockByNumber(line - 1) if line else None
        if block is not None and block.isValid():
            selection = QTextEdit.ExtraSelection()
            colour = QColor(theme.role_colour("failure", self))
            colour.setAlpha(50)
            selection.format.setBackground(colour)
            selection.format.setProperty(QTextFormat.FullWidthSelection, True)
            selection.cursor = QTextCursor(block)
            highlights.append(selection)
        self.box.setExtraSelections(highlights)

    def _go_to(self, index: QModelIndex) -> None:
        cell = self.table.rows.rows[index.row()].item[index.column()]
        hierarchy = self._presenter.hierarchy
        if hierarchy is not None and isinstance(cell, str) and cell in hierarchy.scene:
            self._presenter.select(cell)

    def _fill_examples(self) -> None:
        self.examples.clear()
        self.examples.addItem("Examples and earlier queries")
        for name, text in _EXAMPLES:
            self.examples.addItem(name, text)
        for text in self._queries.queries:
            self.examples.addItem(" ".join(text.split())[:80], text)

    def _take_example(self, row: int) -> None:
        text = self.examples.itemData(row)
        if text:
            self.box.setPlainText(text)
            self.box.setFocus(Qt.ShortcutFocusReason)
        self.examples.setCurrentIndex(0)


_COLOURS = {VIOLATION: "failure", WARNING: "paused"}


class ReportPanel(QWidget):
    """Violations of ontologies and shapes; a click selects the element."""

    def __init__(self, presenter: WorldPresenter, queries: WorldQueries, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self._queries = queries
        self.message = PlainLabel("Not validated yet.")
        self.message.setObjectName("validationSaid")
        self.message.setWordWrap(True)
        self.again = push_button(
            "Validate",
            "validateButton",
            lambda: queries.validate(),
            "Validates the scene against ontologies and shapes",
        )
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
        self.message = PlainLabel()
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
