"""The details of the selected node."""

from __future__ import annotations

import re
from html import escape

from python_qt_binding.QtCore import Signal
from python_qt_binding.QtGui import QColor, QPalette
from python_qt_binding.QtWidgets import QTextBrowser, QWidget

from skiros2_gui.app.widgets.theme import role_colour
from skiros2_gui.run.node_text import ConditionText, NodeText
from skiros2_runs.core.states import FAILURE, SUCCESS, StateStyle, style_of

#: An element in a text: its id, then its label.
_ELEMENT = re.compile(r"([A-Za-z_]\w*:\w+-\d+)(?:-|$)")

#: The prefix of names that are not ids.
_DEFAULT_PREFIX = re.compile(r"\bskiros:(?=\w+\b(?!-\d))")

_EMPTY = "Click a node of the tree to see its state, its parameters and its conditions."


class NodeDetails(QTextBrowser):
    """A node as text that can be selected and copied."""

    #: The id of an element that was clicked.
    element = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
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
            lines = [_spaced(line) for line in node.why]
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
            rows.append(
                f"<tr><td width='20'><b style='color:{colour}'>{symbol}</b></td><td>{text}{but}</td></tr>"
            )
        return f"<table cellspacing='0' cellpadding='2'>{''.join(rows)}</table>"

    def _linked(self, value: str) -> str:
        """Formats a value; an element as a link."""
        found = _ELEMENT.match(value)
        if found is None:
            return f"<b>{escape(value)}</b>"
        eid = escape(found.group(1)) if found.end() < len(value) else ""
        return f"{_link(value)} <span style='color:{self._faint()}'>{eid}</span>"

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
    return f"<a href='#{eid}' title='{eid}'>{escape(label) or eid}</a>"


def _with_links(text: str, elements: list[str]) -> str:
    """Returns a text with links to its elements; the default prefix of relations and properties is left out."""
    if not elements:
        return escape(_DEFAULT_PREFIX.sub("", text))
    parts = re.split(f"({'|'.join(re.escape(e) for e in sorted(elements, key=len, reverse=True))})", text)
    return "".join(_link(part) if part in elements else escape(_DEFAULT_PREFIX.sub("", part)) for part in parts)


def _spaced(line: str) -> str:
    """Returns a line with its indentation."""
    text = line.lstrip(" ")
    return "&nbsp;" * (2 * max(0, len(line) - len(text) - 2)) + escape(text)
