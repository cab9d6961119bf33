"""The tabs beside the tree: the selected node, messages, durations and breakpoints."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape

from python_qt_binding.QtCore import Qt, Signal
from python_qt_binding.QtGui import QColor, QPalette
from python_qt_binding.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QTextBrowser,
    QVBoxLayout,
    QWidget,
)

from skiros2_common.core.names import local_name
from skiros2_common.core.wording import in_words, label_text
from skiros2_gui.app.names import Names
from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip, push_button
from skiros2_gui.app.widgets.tables import Row, RowsModel, RowsView
from skiros2_gui.app.widgets.theme import role_colour
from skiros2_gui.run.breakpoints import CHOICES
from skiros2_gui.run.node import ConditionText, NodeText, clock_text, duration_text
from skiros2_gui.run.presenter import RunPresenter
from skiros2_runs.core.message_log import LogLine
from skiros2_runs.core.states import FAILURE, SUCCESS, StateStyle, style_of
from skiros2_runs.core.task_run import TaskRun
from skiros2_skill.core.runtime.history import one_line

#: An element in a text: its id, then its label.
_ELEMENT = re.compile(r"([A-Za-z_]\w*:\w+-\d+)(?:-|$)")

_EMPTY = "Click a node of the tree to see its state, its parameters and its conditions."


class NodeDetails(QTextBrowser):
    """A node as text that can be selected and copied.

    :param names: of the elements in its texts.
    """

    #: The id of an element that was clicked.
    element = Signal(str)

    def __init__(self, names: Names, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._names = names
        self.setObjectName("nodeDetails")
        self.setAccessibleName("the selected node")
        self.setOpenLinks(False)
        self.anchorClicked.connect(lambda link: self.element.emit(link.fragment()))
        self._shown = ""
        self.show_node(None)

    def show_node(self, node: NodeText | None) -> None:
        """Shows a node, or a hint for None. Keeps the scroll position; does nothing while text is selected."""
        html = self._page(node) if node is not None else f"<p style='color:{self._faint()}'>{_EMPTY}</p>"
        if html == self._shown or self.textCursor().hasSelection():
            return
        self._shown = html
        bar = self.verticalScrollBar()
        at = bar.value()
        self.setHtml(html)
        bar.setValue(at)

    def _page(self, node: NodeText) -> str:
        parts = [f"<h3 style='margin-bottom:4px'>{escape(node.title)}</h3>", self._table(node.facts, node.state)]
        if node.why:
            parts.append("<h4>Why it failed</h4>")
            lines = [_spaced(self._names.readable(line)) for line in node.why]
            parts += [f"<p style='margin:0 0 3px 0'>{line}</p>" for line in (f"<b>{lines[0]}</b>", *lines[1:])]
        if node.conditions:
            parts.append("<h4>Conditions</h4>")
            parts.append(self._conditions(node.conditions))
        if node.params:
            parts.append("<h4>Parameters</h4><table cellspacing='0' cellpadding='2'>")
            for key, value, origin in node.params:
                faint = f"<br><span style='color:{self._faint()}'>{escape(origin)}</span>" if origin else ""
                shown = self._linked(value)
                parts.append(f"<tr><td>{escape(key)}&nbsp;&nbsp;</td><td>{shown}{faint}</td></tr>")
            parts.append("</table>")
        if node.note:
            parts.append(f"<p style='color:{self._faint()}'>{escape(node.note)}</p>")
        return "".join(parts)

    def _table(self, facts: list[tuple[str, str]], state: int) -> str:
        rows = []
        for name, value in facts:
            first, *more = value.split("\n")
            shown = "<br>".join([f"<b>{escape(first)}</b>" if more else escape(first), *map(_spaced, more)])
            if name == "state":
                shown = f"<b style='color:{self._colour(style_of(state))}'>{shown}</b>"
            rows.append(f"<tr><td style='color:{self._faint()}'>{escape(name)}&nbsp;&nbsp;</td><td>{shown}</td></tr>")
        return f"<table cellspacing='0' cellpadding='2'>{''.join(rows)}</table>"

    def _conditions(self, conditions: list[ConditionText]) -> str:
        styles = {"✓": style_of(SUCCESS), "✗": style_of(FAILURE)}
        rows, last = [], ""
        for condition in conditions:
            if condition.stage != last:
                rows.append(f"<tr><td colspan='2' style='color:{self._faint()}'>{escape(condition.stage)}</td></tr>")
                last = condition.stage
            symbol = condition.symbol
            colour = self._colour(styles[symbol]) if symbol in styles else self._faint()
            text = _with_links(condition.text, condition.elements)
            but = f"<br><i>but {_with_links(condition.found, condition.elements)}</i>" if condition.found else ""
            rows.append(f"<tr><td width='20'><b style='color:{colour}'>{symbol}</b></td><td>{text}{but}</td></tr>")
        return f"<table cellspacing='0' cellpadding='2'>{''.join(rows)}</table>"

    def _linked(self, value: str) -> str:
        """Formats a value; an element as a link."""
        found = _ELEMENT.match(value)
        if found is None:
            return f"<b>{escape(value)}</b>"
        label = value[found.end() :]
        if not label or self._names.is_unique(label):
            return _link(value)
        return f"{_link(value)} <span style='color:{self._faint()}'>{escape(local_name(found.group(1)))}</span>"

    def _colour(self, style: StateStyle) -> str:
        return str(role_colour(style.colour_role, self).name())

    def _faint(self) -> str:
        """A colour between text and background."""
        text, base = self.palette().color(QPalette.Text), self.palette().color(QPalette.Base)
        mixed = [(3 * a + 2 * b) // 5 for a, b in zip(text.getRgb()[:3], base.getRgb()[:3], strict=True)]
        return QColor(*mixed).name()


def _link(element: str) -> str:
    """Returns a link to an element `id-label`: its label, with the id as tooltip."""
    found = _ELEMENT.match(element)
    if found is None:
        return escape(element)
    eid, label = escape(found.group(1), quote=True), element[found.end() :]
    return f"<a href='#{eid}' title='{eid}'>{escape(label_text(label)) or local_name(eid)}</a>"


def _with_links(text: str, elements: list[str]) -> str:
    """Returns a text with links to its elements, and words instead of the names of ontologies."""
    if not elements:
        return escape(in_words(text))
    parts = re.split(f"({'|'.join(re.escape(e) for e in sorted(elements, key=len, reverse=True))})", text)
    return "".join(_link(part) if part in elements else escape(in_words(part)) for part in parts)


def _spaced(line: str) -> str:
    """Returns a line with its indentation."""
    text = line.lstrip(" ")
    return "&nbsp;" * (2 * max(0, len(line) - len(text) - 2)) + escape(text)


_HINTS = {
    "node": "label or type of a node; * matches any text",
    "condition": "label of a condition; * matches any text",
    "world": "id or label of an element, or a relation",
}


class _List(RowsView):
    """A list that emits `picked` on a click or Return."""

    #: The item of a row.
    picked = Signal(object)

    def __init__(self, name: str, accessible_name: str) -> None:
        super().__init__(RowsModel(("",)), 0)
        self.setObjectName(name)
        self.setAccessibleName(accessible_name)
        self.horizontalHeader().hide()
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarAlwaysOff)
        for signal in (self.clicked, self.activated):
            signal.connect(lambda index: self.picked.emit(self.rows.rows[index.row()].item))


class MessageList(_List):
    """The messages of a task's nodes; `picked` emits a `LogLine`. Stays at its end unless the user has scrolled.

    :param names: of the elements in the messages.
    """

    def __init__(self, names: Names) -> None:
        super().__init__("messages", "progress messages")
        self._names = names
        self._shown: tuple[TaskRun | None, int] = (None, 0)

    def show_log(self, run: TaskRun | None) -> None:
        """Shows the messages of a task."""
        shown = (run, run.log.count if run is not None else 0)
        if shown == self._shown:
            return
        self._shown = shown
        bar = self.verticalScrollBar()
        is_at_end = bar.value() >= bar.maximum() - 1
        self.rows.show_rows([self._row(line) for line in run.log.lines] if run is not None else [])
        if is_at_end:
            self.scrollToBottom()

    def _row(self, line: LogLine) -> Row:
        style = style_of(line.state)
        message = self._names.readable(one_line(line.message))
        said = f": {message}" if message else f" {style.word}"
        text = f"{clock_text(line.time)}  {style.symbol} {line.name}{said}"
        return Row((text,), line.message or text, line, style.colour_role)


class TimeList(_List):
    """The durations of the skills; `picked` emits the id of a node."""

    def __init__(self) -> None:
        super().__init__("times", "time of each skill")

    def show_times(self, presenter: RunPresenter) -> None:
        """Shows the durations in the shown tree."""
        frame = presenter.frame
        pairs: Sequence[tuple[int, float]] = presenter.by_time()
        self.rows.show_rows([
            Row(
                (f"{duration_text(seconds)}   {frame.shape.name(index)}",),
                item=frame.shape.id(index),
                colour=style_of(frame.state(index)).colour_role,
            )
            for index, seconds in pairs
            if frame is not None
        ])  # fmt: skip


class BreakpointPanel(QWidget):
    """Lists, adds and removes breakpoints of the shown task's robot."""

    def __init__(self, presenter: RunPresenter) -> None:
        super().__init__()
        self._presenter = presenter
        self._title = PlainLabel()
        self._title.setWordWrap(True)
        self._list = QListWidget()
        self._list.setObjectName("breakpoints")
        self._list.currentItemChanged.connect(lambda *_: self._enable())
        self._when = QComboBox()
        self._when.setObjectName("breakpointKind")
        for text, kind, when in CHOICES:
            self._when.addItem(f"Pause {text}", (kind, when))
        self._when.currentIndexChanged.connect(lambda _: self._hint())
        self._pattern = QLineEdit()
        self._pattern.setObjectName("breakpointPattern")
        self._pattern.setClearButtonEnabled(True)
        self._pattern.returnPressed.connect(self._add)
        self._pattern.textChanged.connect(lambda _: self._enable())
        self._add_button = push_button("Add", "breakpointAdd", self._add)
        self._remove_button = push_button("Remove", "breakpointRemove", self._remove)
        row = QHBoxLayout()
        row.addWidget(self._pattern, 1)
        row.addWidget(self._add_button)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.addWidget(self._title)
        column.addWidget(self._list, 1)
        column.addWidget(self._remove_button, 0, Qt.AlignRight)
        column.addWidget(self._when)
        column.addLayout(row)
        self._hint()
        self.show_breakpoints()

    def show_breakpoints(self) -> None:
        """Shows the breakpoints of the presenter's robot."""
        robot = self._presenter.robot
        self._title.setText(f"Tasks of {robot.lstrip('/')} pause:" if robot else "No robot is running.")
        known = list(self._presenter.breakpoints.of(robot))
        chosen = self._list.currentRow()
        self._list.clear()
        for one in known:
            item = QListWidgetItem(str(one))
            item.setData(Qt.UserRole, one)
            self._list.addItem(item)
        self._list.setCurrentRow(min(chosen, len(known) - 1))
        self._enable()

    def _hint(self) -> None:
        kind, _ = self._when.currentData()
        self._pattern.setPlaceholderText(_HINTS.get(kind, ""))
        self._pattern.setToolTip(plain_tip(_HINTS.get(kind, "")))

    def _add(self) -> None:
        text, robot = self._pattern.text().strip(), self._presenter.robot
        if text and robot:
            kind, when = self._when.currentData()
            self._presenter.breakpoints.add(robot, kind, text, when)
            self._pattern.clear()

    def _remove(self) -> None:
        item = self._list.currentItem()
        if item is not None:
            self._presenter.breakpoints.remove(item.data(Qt.UserRole))

    def _enable(self) -> None:
        self._add_button.setEnabled(bool(self._presenter.robot and self._pattern.text().strip()))
        self._remove_button.setEnabled(self._list.currentItem() is not None)
