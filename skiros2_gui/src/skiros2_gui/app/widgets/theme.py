"""The dark and light themes, and the colours of states."""

from __future__ import annotations

from python_qt_binding.QtGui import QBrush, QColor, QPalette
from python_qt_binding.QtWidgets import QApplication, QStyleFactory, QTreeWidgetItem, QWidget

from skiros2_runs.core.states import ROLE_COLOURS

#: The themes.
SYSTEM, LIGHT, DARK = "system", "light", "dark"
CHOICES = (SYSTEM, LIGHT, DARK)

_LIGHT = {
    QPalette.Window: "#f4f4f2", QPalette.WindowText: "#1d1f21", QPalette.Base: "#ffffff",
    QPalette.AlternateBase: "#f5f6f8", QPalette.Text: "#1d1f21", QPalette.Button: "#ebebe9",
    QPalette.ButtonText: "#1d1f21", QPalette.BrightText: "#b3261e", QPalette.Highlight: "#1f6fb2",
    QPalette.HighlightedText: "#ffffff", QPalette.ToolTipBase: "#ffffff", QPalette.ToolTipText: "#1d1f21",
    QPalette.Link: "#1f6fb2", QPalette.PlaceholderText: "#75797d", QPalette.Light: "#ffffff",
    QPalette.Midlight: "#f7f7f5", QPalette.Mid: "#c3c5c7", QPalette.Dark: "#9a9c9e", QPalette.Shadow: "#6f7173",
}  # fmt: skip
_DARK = {
    QPalette.Window: "#26292d", QPalette.WindowText: "#e6e7e8", QPalette.Base: "#1c1e21",
    QPalette.AlternateBase: "#22252a", QPalette.Text: "#e6e7e8", QPalette.Button: "#33373c",
    QPalette.ButtonText: "#e6e7e8", QPalette.BrightText: "#ff8a80", QPalette.Highlight: "#3d8fd1",
    QPalette.HighlightedText: "#ffffff", QPalette.ToolTipBase: "#33373c", QPalette.ToolTipText: "#e6e7e8",
    QPalette.Link: "#6db3f2", QPalette.PlaceholderText: "#8b9095", QPalette.Light: "#4a4f55",
    QPalette.Midlight: "#3d4147", QPalette.Mid: "#565b61", QPalette.Dark: "#17191b", QPalette.Shadow: "#0c0d0e",
}  # fmt: skip
_DISABLED = (QPalette.WindowText, QPalette.Text, QPalette.ButtonText, QPalette.HighlightedText)

#: The background colours of banners in the light and the dark theme.
_BACKGROUNDS = {"notice": ("#fff3d1", "#4a3a12"), "error": ("#fbe4e2", "#4a2624")}


def is_dark(widget: QWidget | None = None) -> bool:
    """Returns whether a widget has a dark background."""
    palette = widget.palette() if widget is not None else QApplication.palette()
    return bool(palette.color(QPalette.Window).lightness() < 128)


def role_colour(name: str, widget: QWidget | None = None) -> QColor:
    """Returns the colour of a role, readable on the base colour of the widget's theme.

    :param name: `success`, `failure`, `running`, `paused`, `idle` or `changed`.
    """
    return QColor(ROLE_COLOURS[name][is_dark(widget)])


def palette_of(dark: bool) -> QPalette:
    """Returns the palette of the dark or the light theme."""
    palette = QPalette()
    for role, colour in (_DARK if dark else _LIGHT).items():
        palette.setColor(role, QColor(colour))
    for role in _DISABLED:
        palette.setColor(QPalette.Disabled, role, QColor("#7c8186" if dark else "#9a9da0"))
    palette.setColor(QPalette.Disabled, QPalette.Highlight, QColor("#4a4f55" if dark else "#c3c5c7"))
    return palette


def apply_theme(application: QApplication, choice: str) -> None:
    """Applies a theme to an application.

    :param choice: one of `CHOICES`; any other value selects the desktop's.
    """
    if application.property("desktop_palette") is None:
        application.setProperty("desktop_palette", application.palette())
        application.setProperty("desktop_style", application.style().objectName())
    desktop = application.property("desktop_palette")
    if choice in (LIGHT, DARK):
        application.setStyle(QStyleFactory.create("Fusion"))
        application.setPalette(palette_of(choice == DARK))
    else:
        application.setStyle(QStyleFactory.create(application.property("desktop_style")))
        application.setPalette(desktop)


def tint(widget: QWidget, background: str = "", text: str = "", dark: bool = False) -> None:
    """Colours a widget by its palette, as a style sheet would keep its children from following the theme.

    :param background: a key of `_BACKGROUNDS`; "" keeps the parent's.
    :param text: see `role_colour`; "" keeps the default.
    """
    palette = QPalette()
    if background:
        palette.setColor(QPalette.Window, QColor(_BACKGROUNDS[background][dark]))
        widget.setAutoFillBackground(True)
    if text:
        for role in (QPalette.WindowText, QPalette.ButtonText):
            palette.setColor(role, QColor(ROLE_COLOURS[text][dark]))
    widget.setPalette(palette)


#: The colour role of each state of a task or step; of other states it is `idle`.
STATE_COLOURS = {
    "running": "running",
    "paused": "paused",
    "stopped": "paused",
    "preempted": "paused",
    "succeeded": "success",
    "failed": "failure",
    "lost": "failure",
}


def colour_state(item: QTreeWidgetItem, column: int, state: str, widget: QWidget) -> None:
    """Gives a cell the colour of a state."""
    colour = role_colour(STATE_COLOURS.get(state, "idle"), widget)
    if item.foreground(column).color() != colour:
        item.setForeground(column, QBrush(colour))


def colour_label(label: QWidget, role: str) -> None:
    """Gives a label the colour of a role; "" restores the default."""
    palette = QWidget.palette(label.parentWidget() or label)
    if role:
        palette.setColor(label.foregroundRole(), role_colour(role, label))
    if label.palette() != palette:
        label.setPalette(palette)
